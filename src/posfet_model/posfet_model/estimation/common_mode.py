# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Common-mode component of the forces, interpreted as film temperature ahead of the chip sensors.

The chip sensors report at 10 Hz, and the film may lag or generate charge otherwise than described. But the film has one
temperature, and a touch can only push. So the least-loaded taxels give the temperature of all.

While nothing touches, the common-mode component is attributed to temperature at once. The next three sensor readings
(0.3 s) must confirm it; otherwise it was a press on the whole array, which is then reported, 0.3 s late. A component
within the uncertainty of the film temperature and of the pyroelectric coefficient needs no confirmation. While
something touches, only as much is attributed to temperature: while the chip temperature is steady, a touch on the whole
array loses nothing. Where even the least-loaded taxels read far more than that, all are pressed, and nothing is
attributed to temperature.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.estimation.film_temperature import FilmTemperature

NOTICEABLE: Final = 0.05
"""Least common-mode force that is processed [contact threshold]."""

TRIAL: Final = 0.3
"""Time within which the chip sensors must confirm a correction [s]: three of their readings."""

CONFIRMED: Final = 0.3
"""Share of the correction that the chip sensors must show by then [1]."""

LEAST_LOADED: Final = 0.2
"""Quantile of the forces that represents the least-loaded taxels [1]: the other taxels may be touched."""

FEWEST: Final = 5
"""With fewer usable taxels the common mode is not observable: a fingertip presses them all."""

DEVIATIONS: Final = 3.0
"""Standard deviations of the film temperature that a correction may reach while something touches [1]."""

PYROELECTRIC_UNCERTAINTY: Final = 0.3
"""Relative uncertainty of the pyroelectric coefficient [1]: allows this share of the temperature change since the touch
began in addition."""

PRESSED: Final = 2.0
"""All taxels are pressed when the least-loaded read more than this many times the limit of the correction [1]."""

STILL_PRESSED: Final = 0.5
"""They stay pressed until the least-loaded read less than this share of that force [1] (hysteresis)."""

SMOOTHING: Final = 5e-3
"""Time constant of the average under a touch, so that noise is not attributed to temperature [s]. A steady ramp is
followed without lag."""

LEAST_LIMIT: Final = 5.0
"""Temperature errors that cause less than this many times `NOTICEABLE` are not corrected under a touch [1]."""

QUANTILE_BIAS: Final = 0.5
"""Bias of the least-loaded quantile below the mean, in standard deviations of the noise [1]: the normal distribution's
quantile at `LEAST_LOADED` of all when a third of the taxels is pressed."""


class CommonModeTemperature:
    """Corrects the film temperature by the common-mode component of the forces.

    State variables: remaining time of the trial [s], sum of the corrections in the trial [K], correction since the
    touch began [K] and its rate [K/s], force of the least-loaded taxels when all were pressed [N].

    Parameters
    ----------
    film : FilmTemperature
        Film temperature, which is corrected.
    newton_per_kelvin : float
        Pyroelectric signal of a taxel [N/K].
    threshold : float
        Contact threshold [N].
    noise : float
        Standard deviation of a reading [N].
    """

    def __init__(self, film: FilmTemperature, newton_per_kelvin: float, threshold: float, noise: float) -> None:
        self._bias = QUANTILE_BIAS * noise
        self.observable = False
        """Whether the least-loaded taxels gave the temperature recently, within the limit of the correction."""
        self._correction = 0.0
        self._pressed = 0.0  # force of the least-loaded taxels when all were pressed [N]
        self._rate = 0.0  # rate of change of the film temperature according to the taxels [K/s]
        self._base = 0.0
        self._film = film
        self._newton_per_kelvin = newton_per_kelvin
        self._noticeable = NOTICEABLE * threshold
        self._trial_left = 0.0
        self._trial_chip = self._trial_rise = 0.0  # temperatures of chip and film when the trial began [K]
        self._accepted = 0.0
        self._rejected = False

    @property
    def residual_variance(self) -> float:
        """Variance of the forces that remains where the common mode is observable [N2]."""
        return self._noticeable**2

    @property
    def active(self) -> bool:
        """Whether `update_untouched` is needed."""
        return self._trial_left > 0.0 or self._film.in_transient

    @property
    def change_since_touch(self) -> float:
        """Magnitude of the film's temperature change since the touch began [K]."""
        return abs(self._film.rise_from_sensors + self._correction - self._base)

    def update(self, mean: NDArray[np.float64], duration: float, touched: bool) -> float:
        """Process a block; return the change of the film temperature [K] that reverts an unconfirmed correction.

        Parameters
        ----------
        mean : ndarray of float64, shape [usable taxels]
            Mean forces of the usable taxels over the block [N].
        duration : float
            Duration of the block [s].
        touched : bool
            Whether something touches.
        """
        if self._newton_per_kelvin == 0.0 or len(mean) < FEWEST:
            return 0.0
        on_trial = self._trial_left > 0.0
        self._trial_left -= duration
        noticeable = abs(_least_loaded(mean)) > self._noticeable
        if on_trial and self._trial_left <= 0.0:
            warmed = self._film.chip - self._trial_chip
            confirmed = warmed * self._accepted >= CONFIRMED * self._accepted**2
            confirmed |= abs(self._film.correction) <= self._limit(self._trial_rise)
            self._rejected = not confirmed and abs(self._accepted * self._newton_per_kelvin) > self._noticeable
            return self._film.revert_correction() if self._rejected else 0.0
        if self._rejected:
            self._rejected = noticeable or touched
        elif not on_trial and noticeable and not touched:
            self._trial_left, self._accepted = TRIAL, 0.0
            self._trial_chip, self._trial_rise = self._film.chip, self._film.rise_from_sensors
        return 0.0

    def update_untouched(self, force: NDArray[np.float64]) -> float:
        """Return the correction [K] for a scan without touch, from the forces [N] of the usable taxels."""
        if len(force) < FEWEST:
            return 0.0
        wanted = _least_loaded(force) / self._newton_per_kelvin
        limit = DEVIATIONS * self._film.standard_deviation
        accepted = self._film.common_mode_correction(wanted, limit, extend=self._trial_left > 0.0)
        self._accepted += accepted
        self.observable = abs(wanted - accepted) * abs(self._newton_per_kelvin) <= self._noticeable
        return accepted

    def end_touch(self) -> None:
        """Record a block without touch."""
        self._base, self._correction, self._rate = self._film.rise_from_sensors, 0.0, self._film.rate
        self._pressed = 0.0
        self.observable &= self.active
        if self._trial_left <= 0.0:
            self._film.keep_correction()

    def update_touched(self, force: NDArray[np.float64]) -> float:
        """Return the correction [K] for a scan under a touch, from the forces [N] of the usable taxels."""
        film = self._film
        film.keep_correction()  # a touch that is detected does not reject an earlier correction
        self._trial_left = 0.0
        limit = self._limit(self._base)
        self.observable = len(force) >= FEWEST and limit * abs(self._newton_per_kelvin) > LEAST_LIMIT * self._noticeable
        if not self.observable:
            self._rate = film.rate
            return 0.0
        least = _least_loaded(force) + self._bias
        level = least + self._correction * self._newton_per_kelvin
        if level > PRESSED * limit * abs(self._newton_per_kelvin):
            self._pressed = level
        elif level < STILL_PRESSED * self._pressed:
            self._pressed = 0.0
        pressed = self._pressed > 0.0
        if pressed:
            least = -self._correction * self._newton_per_kelvin  # no temperature explains it: all taxels are pressed
        error = least / self._newton_per_kelvin
        share = min(film.step / SMOOTHING, 1.0)
        wanted = self._correction + (self._rate - film.rate) * film.step + share * error
        correction = min(max(wanted, -limit), limit)
        self.observable = correction == wanted and not pressed
        self._rate = self._rate + 0.25 * share * error / SMOOTHING if self.observable else film.rate
        change, self._correction = correction - self._correction, correction
        return change

    def _limit(self, since: float) -> float:
        """Return the greatest plausible error of the film temperature [K], given its value `since` [K] when known."""
        film = self._film
        return DEVIATIONS * film.standard_deviation + PYROELECTRIC_UNCERTAINTY * abs(film.rise_from_sensors - since)


def _least_loaded(force: NDArray[np.float64]) -> float:
    """Return the force of the least-loaded taxels: a touch on all other taxels does not affect it."""
    return float(np.sort(force)[int(LEAST_LOADED * len(force))])
