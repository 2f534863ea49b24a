"""What all taxels show together while nothing touches: the film's own temperature, ahead of the chip's sensors.

The chip's sensors speak ten times a second, and the film may lag otherwise than described. So while nothing touches,
what half of the taxels show alike is taken for warmth at once. The sensors have the last word: when their next readings
do not bear it out, it was a press on the whole array, which then comes to light, 0.3 s late.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.thermal import FilmTemperature

NOTICED: Final = 0.05
"""Force common to all taxels that is noticed, in thresholds of contact [1]."""

TRIAL: Final = 0.3
"""How long it is taken for warmth before the chip's sensors have to bear it out: three of their readings [s]."""

BORNE_OUT: Final = 0.3
"""Share of what was taken for warmth that the chip's sensors must show by then [1]."""


class CommonMode:
    """Lets the film follow what all taxels show together."""

    def __init__(self, film: FilmTemperature, newton_per_kelvin: float, threshold: float) -> None:
        """Take the film, its signal of a taxel per temperature [N/K], and the threshold of contacts [N]."""
        self._film = film
        self._newton_per_kelvin = newton_per_kelvin
        self._noticed = NOTICED * threshold
        self._left = 0.0
        self._chip = 0.0
        self._believed = 0.0
        self._refuted = False

    @property
    def active(self) -> bool:
        """Whether to call `follow`."""
        return self._left > 0.0 or (self._film.changing and not self._refuted)

    def look(self, mean: NDArray[np.float64], duration: float, touched: bool) -> float:
        """Take each usable taxel's mean force [N] over a block of `duration` [s], and whether something touches.

        Return by how much [K] the film has to be taken for warmer, as what it was taken for was not borne out.
        """
        if self._newton_per_kelvin == 0.0 or not len(mean):
            return 0.0
        on_trial = self._left > 0.0
        self._left -= duration
        noticed = abs(_middle(mean)) > self._noticed
        if on_trial and self._left <= 0.0:
            warmed = self._film.chip - self._chip
            borne_out = warmed * self._believed >= BORNE_OUT * self._believed**2
            self._refuted = not borne_out and abs(self._believed * self._newton_per_kelvin) > self._noticed
            return self._film.settle() if self._refuted else 0.0
        if self._refuted:
            self._refuted = noticed or touched
        elif not on_trial and noticed and not touched:
            self._left, self._chip, self._believed = TRIAL, self._film.chip, 0.0
        return 0.0

    def follow(self, force: NDArray[np.float64]) -> float:
        """Return by how much [K] the film has to be taken for warmer, by the force [N] of each usable taxel."""
        if not len(force):
            return 0.0
        believed = self._film.nudge(_middle(force) / self._newton_per_kelvin)
        self._believed += believed
        return believed


def _middle(values: NDArray[np.float64]) -> float:
    """Return the upper median: a touch not found yet does not move it."""
    return float(np.sort(values)[len(values) // 2])
