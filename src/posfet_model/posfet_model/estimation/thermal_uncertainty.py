# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Effect of the film temperature on forces, offsets and their uncertainty.

The film has one temperature, but the taxels differ in their pyroelectric response (mismatch). The charge that a
temperature change leaves in the signals leaks away as the charge of a force does, and looks like an offset meanwhile.
The uncertainty of the film temperature is common to all forces.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import upper_median
from posfet_model.estimation.common_mode import CommonModeTemperature
from posfet_model.estimation.film_temperature import FilmTemperature
from posfet_model.estimation.settings import (
    LEAST_MISMATCH,
    MISMATCH_MEMORY,
    PRIOR_WARMING_TIME,
    REDUCED_UNCERTAINTY,
)


class ThermalUncertainty:
    """Uncertainty of the forces due to the film temperature, and the pyroelectric charge left in the signals.

    State variables: compensated temperature rise [K], its part that has not leaked yet [K] per taxel, mismatch
    deviation of the forces [N], greatest uncertainty of the film temperature since offsets are estimated [K].

    Parameters
    ----------
    film : FilmTemperature
        Film temperature.
    common : CommonModeTemperature
        Common-mode correction of the film temperature.
    per_kelvin : ndarray of float64, shape [taxels]
        Pyroelectric signal of each taxel [N/K].
    mismatch : float
        Relative standard deviation of that signal [1].
    calibrated : bool
        Whether the signals come from a recorded calibration, so that taxels without response are known.
    """

    def __init__(
        self,
        film: FilmTemperature,
        common: CommonModeTemperature,
        per_kelvin: NDArray[np.float64],
        mismatch: float,
        calibrated: bool,
    ) -> None:
        self.film = film
        self.common = common
        self.per_kelvin = per_kelvin
        self.mismatch_deviation = 0.0
        """Standard deviation of each force that the last block's temperature change causes by mismatch [N]."""
        self.rise = 0.0
        """Film temperature rise since the start that was compensated in the forces [K]; written by others."""
        self._before = 0.0  # the same when the block began
        self._unleaked = np.zeros(len(per_kelvin))
        self._leaked_before = np.zeros(len(per_kelvin))  # part of the rise that had leaked when the touch began [K]
        self._leaked_observed = np.zeros(len(per_kelvin))  # and when the common mode was last observable
        self._typical = abs(upper_median(per_kelvin))
        self._mismatch = mismatch
        self._calibrated = calibrated
        self._swing = 0.0  # greatest temperature change since the touch began [K]
        self._transient = False
        self._greatest_deviation = 0.0  # of the film temperature since offsets are estimated [K]
        self._age = 0.0  # time since the first scan [s]

    @property
    def common_variance(self) -> float:
        """Variance common to all forces, due to the film temperature [N2]."""
        return self.common.residual_variance if self._observable else self.film_variance

    @property
    def film_variance(self) -> float:
        """Variance of the forces due to the film temperature according to the sensors [N2]."""
        return (self.film.standard_deviation * self._typical) ** 2

    @property
    def mismatch_variance(self) -> float:
        """Variance of each force due to mismatch since the last correction, independent between taxels [N2]."""
        # Until the next correction the mismatch adds up, by as much as in the last block.
        return (2.0 * self.mismatch_deviation) ** 2

    @property
    def _observable(self) -> bool:
        # A taxel without response shows no temperature either; without calibration it is not known.
        return self.common.observable and self._calibrated

    @property
    def observed_leakage(self) -> NDArray[np.float64]:  # numpydoc ignore=RT01
        """Leakage of the pyroelectric charge since the touch began, where the common mode was observable [N].

        An error of the common leakage time constant does not affect it: the other taxels would show that error.
        """
        leaked: NDArray[np.float64] = (self._leaked_observed - self._leaked_before) * self.per_kelvin
        return leaked

    def begin_touch(self, where: NDArray[np.bool_]) -> None:
        """Record that a touch begins on the masked taxels."""
        leaked = self.rise - self._unleaked[where]
        self._leaked_before[where] = self._leaked_observed[where] = leaked

    @property
    def residual_signal(self) -> NDArray[np.float64]:
        """Pyroelectric charge left in the signals up to the last block [N]; the rest of an offset is older."""
        residual: NDArray[np.float64] = self._unleaked * self.per_kelvin
        return residual

    def close_block(self, elapsed: float, tau: NDArray[np.float64], least: float, touched: bool) -> float:
        """End a block; return the standard deviation that its temperature change adds to each force [N].

        Parameters
        ----------
        elapsed : float
            Duration of the block [s].
        tau : ndarray of float64, shape [taxels]
            Leakage time constants [s].
        least : float
            Contact threshold [N]; a mismatch deviation far below it is dropped.
        touched : bool
            Whether something touched in the block.
        """
        change = self.rise - self._before
        self._before = self.rise
        self._unleaked += change
        self._unleaked *= np.exp(-elapsed / tau)
        if touched and self._observable:
            np.subtract(self.rise, self._unleaked, out=self._leaked_observed)
        if touched:
            # Nothing is corrected under a touch: the temperature change since the touch began matters.
            before, self._swing = self._swing, max(self._swing, self.common.change_since_touch)
            change = self._swing - before
        else:
            self._swing = 0.0
        if not change and not self.mismatch_deviation:
            return 0.0
        # The error of the pyroelectric gain is constant: deviations add up, not variances.
        now = abs(change) * self._typical * self._mismatch
        carried = max(now, MISMATCH_MEMORY * self.mismatch_deviation)
        self.mismatch_deviation = carried if now > LEAST_MISMATCH * least else now
        return self.mismatch_deviation

    def learnt_during_warming(self, elapsed: float) -> tuple[bool, bool]:
        """Return whether offsets were estimated from a temperature change, once per block of `elapsed` [s].

        Parameters
        ----------
        elapsed : float
            Duration of the block [s].

        Returns
        -------
        unknown : bool
            Whether this may be so for offsets that are not known yet.
        known : bool
            Whether this may be so for known offsets.
        """
        film, was_transient = self.film, self._transient
        deviation = film.standard_deviation
        self._transient = not film.steady
        reduced = was_transient and (film.steady or deviation < REDUCED_UNCERTAINTY * self._greatest_deviation)
        begins = self._transient and not was_transient
        self._greatest_deviation = deviation if reduced or begins else max(self._greatest_deviation, deviation)
        self._age += elapsed
        return reduced or begins, begins and self._age < PRIOR_WARMING_TIME
