"""What all taxels show together: the film's own temperature, ahead of the chip's sensors.

The chip's sensors speak ten times a second, and the film may lag or charge otherwise than described. But all of it is
at one temperature, and a touch can only push. So the taxels that read least tell the temperature of all.

While nothing touches, what they show is taken for warmth at once. The sensors have the last word: when their next
readings do not bear it out, it was a press on the whole array, which then comes to light, 0.3 s late; unless it is no
more than may come of what is not known of the film's temperature and of its pyroelectric coefficient. Only so far it
is taken for warmth while something touches, too: while the chip rests, a touch on the whole array loses nothing. Where
even those that read least read far more than that, all are pressed, and nothing is taken for warmth.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.estimation.film_temperature import FilmTemperature

NOTICED: Final = 0.05
"""Force common to all taxels that is noticed, in thresholds of contact [1]."""

TRIAL: Final = 0.3
"""How long it is taken for warmth before the chip's sensors have to bear it out: three of their readings [s]."""

BORNE_OUT: Final = 0.3
"""Share of what was taken for warmth that the chip's sensors must show by then [1]."""


LEAST_PRESSED: Final = 0.2
"""The taxels that read least are so many of all [1]: the rest may be touched."""

FEWEST: Final = 5
"""Fewer usable taxels tell no temperature: a fingertip presses them all."""

DOUBTS: Final = 3.0
"""While something touches, so many standard deviations of the film's temperature are believed [1]."""

PYROELECTRIC_DOUBT: Final = 0.3
"""And this share of what the film warmed since the touch began: the pyroelectric coefficient may be wrong [1]."""

PRESSED: Final = 2.0
"""When those that read least read more than this many times what is believed, all are pressed [1]."""

STILL_PRESSED: Final = 0.5
"""And all stay pressed until they read less than this share of what they did then [1], whatever the film does."""

SMOOTHED: Final = 5e-3
"""Time over which that is averaged, so that noise is not taken for warmth [s]. A steady warming does not lag behind."""

WORTH_IT: Final = 5.0
"""Errors of the temperature are left alone that make less than this many times what is noticed [1]."""

BELOW: Final = 0.5
"""By so many standard deviations of noise the taxels that read least read less than their mean [1]: the normal
distribution's quantile of `LEAST_PRESSED` of all, when a third is pressed."""


class CommonMode:
    """Lets the film follow what all taxels show together."""

    def __init__(self, film: FilmTemperature, newton_per_kelvin: float, threshold: float, noise: float) -> None:
        """Take the film, its signal of a taxel per temperature [N/K], the threshold of contacts and the noise [N]."""
        self._bias = BELOW * noise
        self.told = False
        """Whether the taxels that read least told the temperature lately, as far as they are believed."""
        self._shift = 0.0
        self._pressed = 0.0  # what those that read least read when all were surely pressed [N]
        self._pace = 0.0  # how fast the film warms by what the taxels show [K/s]
        self._base = 0.0
        self._film = film
        self._newton_per_kelvin = newton_per_kelvin
        self._noticed = NOTICED * threshold
        self._left = 0.0
        self._chip = self._warmth = 0.0  # of chip and film when a trial began [K]
        self._believed = 0.0
        self._refuted = False

    @property
    def told_variance(self) -> float:
        """Variance of the forces [N2] that the taxels leave open when they tell the temperature."""
        return self._noticed**2

    @property
    def active(self) -> bool:
        """Whether to call `follow`."""
        return self._left > 0.0 or self._film.changing

    @property
    def since_touch(self) -> float:
        """By how much the film changed since something touches [K]."""
        return abs(self._film.warmth + self._shift - self._base)

    def look(self, mean: NDArray[np.float64], duration: float, touched: bool) -> float:
        """Take each usable taxel's mean force [N] over a block of `duration` [s], and whether something touches.

        Return by how much [K] the film has to be taken for warmer, as what it was taken for was not borne out.
        """
        if self._newton_per_kelvin == 0.0 or len(mean) < FEWEST:
            return 0.0
        on_trial = self._left > 0.0
        self._left -= duration
        noticed = abs(_least(mean)) > self._noticed
        if on_trial and self._left <= 0.0:
            warmed = self._film.chip - self._chip
            borne_out = warmed * self._believed >= BORNE_OUT * self._believed**2
            borne_out |= abs(self._film.nudged) <= self._doubtful(self._warmth)
            self._refuted = not borne_out and abs(self._believed * self._newton_per_kelvin) > self._noticed
            return self._film.forget_nudges() if self._refuted else 0.0
        if self._refuted:
            self._refuted = noticed or touched
        elif not on_trial and noticed and not touched:
            self._left, self._chip, self._warmth, self._believed = TRIAL, self._film.chip, self._film.warmth, 0.0
        return 0.0

    def follow(self, force: NDArray[np.float64]) -> float:
        """Return by how much [K] the film has to be taken for warmer, by the force [N] of each usable taxel."""
        if len(force) < FEWEST:
            return 0.0
        wanted = _least(force) / self._newton_per_kelvin
        believed = self._film.nudge(wanted, DOUBTS * self._film.standard_deviation, further=self._left > 0.0)
        self._believed += believed
        self.told = abs(wanted - believed) * abs(self._newton_per_kelvin) <= self._noticed
        return believed

    def rest(self) -> None:
        """Take note that nothing touched for a block."""
        self._base, self._shift, self._pace = self._film.warmth, 0.0, self._film.rate
        self._pressed = 0.0
        self.told &= self.active
        if self._left <= 0.0:
            self._film.keep_nudges()

    def hold(self, force: NDArray[np.float64]) -> float:
        """Return the same while something touches."""
        film = self._film
        film.keep_nudges()  # a touch that is felt apart from the others refutes none
        self._left = 0.0
        most = self._doubtful(self._base)
        self.told = len(force) >= FEWEST and most * abs(self._newton_per_kelvin) > WORTH_IT * self._noticed
        if not self.told:
            self._pace = film.rate
            return 0.0
        least = _least(force) + self._bias
        level = least + self._shift * self._newton_per_kelvin
        if level > PRESSED * most * abs(self._newton_per_kelvin):
            self._pressed = level
        elif level < STILL_PRESSED * self._pressed:
            self._pressed = 0.0
        pressed = self._pressed > 0.0
        if pressed:
            least = -self._shift * self._newton_per_kelvin  # no warmth does that: all are pressed, and tell none
        error = least / self._newton_per_kelvin
        share = min(film.step / SMOOTHED, 1.0)
        wanted = self._shift + (self._pace - film.rate) * film.step + share * error
        shift = min(max(wanted, -most), most)
        self.told = shift == wanted and not pressed
        self._pace = self._pace + 0.25 * share * error / SMOOTHED if self.told else film.rate
        change, self._shift = shift - self._shift, shift
        return change

    def _doubtful(self, since: float) -> float:
        """Return how far [K] the film may be from where the sensors have it, known at a warmth `since` [K]."""
        film = self._film
        return DOUBTS * film.standard_deviation + PYROELECTRIC_DOUBT * abs(film.warmth - since)


def _least(force: NDArray[np.float64]) -> float:
    """Return what the taxels read that are pressed least: a touch on all but those does not move it."""
    return float(np.sort(force)[int(LEAST_PRESSED * len(force))])
