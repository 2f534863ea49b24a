"""What all taxels show together taken off their forces, block by block."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.shared_zero import SharedZero
from posfet_model.warming import Warming
from posfet_model.zero_filter import ZeroFilter

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEW: Final = 4
"""Fewer taxels than this do not tell what all show together."""

BESIDE: Final = 1e-3
"""Standard deviation of what a touch elsewhere leaves on taxels that count as untouched [N], assumed."""

BESIDE_MEMORY: Final = 1.0
"""For how long that stays the same [s], assumed."""

HUM: Final = 1e-4
"""Standard deviation of what hum, and whatever else all taxels share, leaves in the mean of a block [N], assumed."""

LIMIT: Final = 3.0
"""A rise of so many standard deviations and more may be a press on the whole array, and is followed slowly [1]."""


class Together:
    """Moves all forces at once."""

    def __init__(
        self, force: Array, per_kelvin: Array, zeros: ZeroFilter, warming: Warming, shared: SharedZero
    ) -> None:
        """Take the forces [N], which are written to, their signals for temperature [N/K], and what is known of them."""
        self._force, self._per_kelvin = force, per_kelvin
        self._zeros, self._warming, self._shared = zeros, warming, shared
        self._variance = 0.0
        self._ahead = 0.0  # what was taken off the forces beyond the temperature of the film [K]
        self._typical = float(per_kelvin.mean())

    @property
    def variance(self) -> float:
        """Variance that all forces share [N2]."""
        return self._variance + self.unseen_variance

    @property
    def unseen_variance(self) -> float:
        """The part of it that what the taxels show together cannot tell [N2]."""
        return self._warming.common_variance if self._shared.following else self._warming.unseen_variance

    def refresh(self) -> None:
        """Reckon `variance` anew: once a block is done, so that scans need not."""
        shared = self._shared
        self._variance = shared.offset_drift if shared.following else shared.variance

    def watch(self, mean: Array, usable: Mask, warmth: float, duration: float, noise: float, quiet: bool) -> None:
        """Learn how fast the film wanders from a block's mean forces [N], each with a variance of `noise` by itself.

        warmth [K] was taken off them, on the mean; quiet: nothing touches. To be called before `grow`.
        """
        taxels = np.count_nonzero(usable)
        if not quiet or taxels < FEW:
            self._shared.wander.forget()
            return
        shown = float((mean - self._zeros.shift).mean(where=usable)) + warmth * self._typical - self._shared.shift
        self._shared.watch(shown, duration, noise / taxels + HUM**2)

    def close(self, duration: float, squares: float, least: float, touched: bool) -> None:
        """Let what is known of each taxel's zero fade over a block; arguments as of `ZeroFilter` and `Warming`."""
        zeros = self._zeros
        zeros.grow(duration, squares)
        uneven = self._warming.close(duration, zeros.time_constant, least, touched)
        if uneven:
            zeros.variance[:] = (np.sqrt(zeros.variance) + uneven) ** 2

    def grow(self, duration: float, squares: float, warmth: float, touched: bool) -> float:
        """Pass a block of that many s, whose steps have that sum of squares [s2]; return what its mean force shows [N].

        warmth [K] was taken off it, on the mean; touched: something touches.
        """
        shared, film = self._shared, self._warming.film
        white = float(self._zeros.noise_variance.mean())
        shared.grow(duration, squares, white, len(self._force), touched)
        warming, common = self._warming, self._warming.common
        if common.active or common.told or not film.sensors:
            shared.follow(film.chip, film.slope, film.followed, film.standard_deviation**2)
            self._ahead = warming.warmth - film.followed
            shows = 0.0
        else:
            shared.feel(film.chip, film.age, film.sensors, duration)
            shows = shared.shows(warmth - self._ahead, duration)
        self._follow()
        self.refresh()
        return shows

    def learn(self, where: Mask, mean: Array, expected: Array, duration: float, slew: float, touched: bool) -> float:
        """Learn from the mean forces [N] of the masked taxels; return what they show together [N].

        expected [N2] is the variance of each alone. A rise that is more than expected is followed by `slew` [N].
        """
        if self._shared.following or np.count_nonzero(where) < FEW:
            return 0.0
        weight = where / expected
        variance = 1.0 / float(weight.sum())
        shown = float(weight @ mean) * variance
        variance += HUM**2
        if touched:
            variance += BESIDE**2 * max(BESIDE_MEMORY / duration, 1.0)
        shared = self._shared
        deviation = math.sqrt(shared.expect(duration) + variance)
        if shown > slew + LIMIT * deviation:
            limit = slew + LIMIT * deviation
            self._force -= limit
            shared.move(limit)
            return shown
        if shown < -LIMIT * deviation:
            shared.shake(shown)
        shared.correct(shown, duration, variance)
        self._follow()
        if not touched:
            shared.keep(shown, variance)
        return shown

    def warm(self, warmer: float, scans: int) -> None:
        """Take the film for warmer by this [K] than it was followed, after so many scans of the block."""
        if warmer:
            self._force -= warmer * self._per_kelvin
            self._warming.warm(warmer, scans)
            self._shared.warm(warmer)

    def share(self, mean: Array, duration: float, touched: bool) -> bool:
        """Take what all taxels show for warmth as `CommonMode` does: the mean force [N] of each usable one tells it.

        Return whether what they were taken for was refuted.
        """
        warming = self._warming
        if not touched:
            warming.common.rest()
        warmer = warming.common.look(mean, duration, touched)
        if warmer:
            self.warm(warmer, 0)
            warming.uneven = 0.0
        return warmer != 0.0

    def undo(self) -> None:
        """Go back to before a touch began."""
        self._force += self._shared.undo()
        self._follow()

    def _follow(self) -> None:
        force, warmer = self._shared.settle(self._warming.warmth - self._ahead)
        self._force -= force + warmer * self._per_kelvin
        self._warming.warmth += warmer
