"""What all taxels share taken off their forces, and kept out of what each learns of its own zero."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import any_true, upper_median
from posfet_model._lib.types import Array, Mask
from posfet_model.estimation.drift_filter import ZeroFilter
from posfet_model.estimation.leakage_identification import LeakWatch
from posfet_model.estimation.multiple_model_filter import LEAKS, Seen, SharedOffset
from posfet_model.estimation.thermal_uncertainty import Warming

LEFT_IN: Final = 5e-3
"""Standard deviation, in contact thresholds, of what hum and the like leave in the middle of all signals [1]."""

OFTEN: Final = 5
SELDOM: Final = 20
"""While the film is not found to wander, one block of so many is looked at; seldom when it surely rests."""

FEW: Final = 3
"""Fewer untouched taxels than this do not tell what all share."""


class Together:
    """Follows what all taxels share by the middle one, so that a touch on less than half of them does not count."""

    def __init__(self, force: Array, zeros: ZeroFilter, leaks: LeakWatch, warming: Warming, least: float) -> None:
        """Take forces [N], which are written to, what is known of them, and the threshold of contacts [N]."""
        self._force, self._zeros, self._leaks, self._warming = force, zeros, leaks, warming
        self._film, self._common, per_kelvin = warming.film, warming.common, warming.per_kelvin
        self._per_kelvin = per_kelvin
        self._typical = upper_median(per_kelvin)
        wander = zeros.wander / len(force)
        self.offset = SharedOffset(float(leaks.time_constant.mean()), self._film.time_constant, self._typical, wander)
        self.followed = 0.0
        """By how much the film warmed since the start, as it is followed [K]; to be written to."""
        self._left_in = (LEFT_IN * least) ** 2
        self._usable = np.ones(len(force), np.bool_)
        self._count = len(force)
        self._rested = LEAKS  # for so long nothing touched, in time constants of the leak [1]
        self._leaked = np.zeros(len(force))
        self._signal = self._noise = 0.0
        self._skipped, self._passed = 0, 0.0  # blocks that were not looked at, and the time since one was [s]

    @property
    def due(self) -> bool:
        """Whether the block that begins is looked at, so that `begin_block` is to be called."""
        if self.offset.wanders or self.offset.holding:
            return True
        return self._skipped + 1 >= (SELDOM if self.offset.rests else OFTEN)

    def begin_block(self, leaked: Array) -> None:
        """Take what leaked of each taxel's charge so far [N], but for a constant, when a block begins."""
        self._leaked = leaked

    def follow(self, force: Array, touched: bool) -> None:
        """Take what the working taxels' forces [N] show together in a scan as the film's own temperature."""
        if touched:
            self._warm(self._common.hold(force))
        else:
            self._warm_untouched(self._common.follow(force))

    def close(self, mean: Array, touched: bool, signal: Array, settled: Mask, valid: bool, duration: float) -> None:
        """End a block of `duration` [s]: mean forces, signals at its end [N], known offsets, whether all is well."""
        self._share(mean[self._usable], touched, duration)
        if touched:
            self._pause()
        else:
            self._rest(signal, settled, valid, duration)

    def misled(self, duration: float) -> tuple[bool, bool]:
        """Return what `Warming.misled` does, to be called once a block: not so where the film is found to wander."""
        unknown, known = self._warming.misled(duration)
        return unknown and not self.offset.wanders, known and not self.offset.wanders

    def _share(self, mean: Array, touched: bool, duration: float) -> None:
        """Take what all show in a block for warmth or no warmth."""
        if not touched:
            self._common.rest()
        warmer = self._common.look(mean, duration, touched)
        if warmer:
            self._warm_untouched(warmer)
            self._warming.uneven = 0.0
            self._zeros.know_force(slice(None), self._zeros.noise_variance)

    def _warm(self, change: float) -> None:
        """Take the film for warmer by a change [K] than it was followed."""
        if change:
            self._force -= change * self._per_kelvin
            self._warming.warmth += change

    def _warm_untouched(self, change: float) -> None:
        self._warm(change)
        self.followed += change

    def use(self, usable: Mask) -> None:
        """Take which taxels work; all until told."""
        self._usable = usable
        self._count = int(np.count_nonzero(usable))
        self.offset.forget()

    def look(self, leaked: Array, duration: float, scans: int) -> None:
        """Take what leaked up to the end of a block of `duration` [s], before its zeros are corrected."""
        if not self._count:
            return
        # What leaked tells the mean of the signals.
        charge = (leaked - self._leaked) * self._leaks.time_constant / duration
        self._signal = upper_median(charge[self._usable]) + float(self._zeros.offset.mean(where=self._usable))
        # A median of many has pi/2 times the variance of their mean.
        self._noise = self._left_in + 0.5 * np.pi * float(self._zeros.noise_variance.mean()) / (scans * self._count)

    def clear(self, mean: Array, touched: Mask, told: bool) -> None:
        """Take off mean forces [N], in place, what is no error of a taxel's own zero.

        told: the taxels that are not touched tell the temperature.
        """
        touches = any_true(touched)
        if not (told if touches else self.offset.wanders):
            return
        free = self._usable & ~touched
        if np.count_nonzero(free) >= FEW:
            mean[free if touches else slice(None)] -= upper_median(mean[free])

    def touch(self, begun: Mask, blocks: NDArray[np.intp], duration: float) -> None:
        """Correct those that begin to be touched, put back by so many blocks, at the end of one of `duration` [s]."""
        if not self.offset.wanders:
            return
        touch = self.offset.touch(self.followed, duration)
        blocks = np.minimum(blocks, len(touch.force) - 1)
        self._force[begun] += touch.force[blocks] - touch.warmer[blocks] * self._per_kelvin[begun]
        self._zeros.share(self._usable, touch.offset)

    def hold(self, duration: float) -> None:
        """Correct all by what is known better at the end of a block under a touch."""
        if not self.offset.holding:
            return
        hold = self.offset.hold(self.followed, self._film.told, self._film.age, duration)
        self._force += hold.force - hold.warmer * self._per_kelvin
        self._zeros.share(self._usable, hold.offset)

    def _pause(self) -> None:
        """Take note that something touched in a block."""
        self._rested = self._passed = 0.0
        self._skipped = 0
        if not (self.offset.holding or self.offset.variance):
            self.offset.forget()

    def _rest(self, signal: Array, settled: Mask, valid: bool, duration: float) -> None:
        """Learn from a block in which nothing touched, and correct all where the film is found to wander."""
        self._rested += duration / self.offset.time_constant
        self._passed += duration
        if not self._count or not self._typical:
            return
        known = np.count_nonzero(settled & self._usable)
        disturbed = known == self._count and not valid
        given_up = self.offset.variance > 0.0 and not self.offset.holding
        if disturbed or given_up or (self._film.warming and not (self.offset.wanders and valid)):
            self.offset.forget()
            return
        if not self.due:
            self._skipped += 1
            return
        passed, self._passed, self._skipped = self._passed, 0.0, 0
        rest = self.offset.rest(self._seen(signal), duration, passed, 2 * known > self._count)
        if not rest:
            return
        if rest.begins:
            self._begin(self._usable & ~settled, signal, rest.charge)
            self._zeros.doubt(self._usable & settled, rest.charge_variance)
        self._warm_untouched(rest.warmer)
        self._force += rest.force
        self._zeros.move(rest.force)
        self._zeros.share(self._usable, rest.offset)

    def _begin(self, new: Mask, signal: Array, charge: float) -> None:
        """Begin anew with offsets that were not known yet: what the film has left is no part of them."""
        noise = self._zeros.noise_variance[new]
        offset = signal[new] - charge / self._typical * self._per_kelvin[new]
        self._zeros.begin(new, offset, noise, noise, -noise)
        self._force[new] = 0.0

    def _seen(self, signal: Array) -> Seen:
        usable, noise, left = self._usable, self._noise, 0.0
        offset = float(self._zeros.offset.mean(where=usable))
        if self._rested < LEAKS:
            # What a touch has left in the signals leaks, as fast as is known of the leak.
            left = float(signal.mean(where=usable)) - offset
            noise += (self._leaks.doubt * self._rested * left) ** 2
        force = upper_median(self._force[usable])
        return Seen(self._signal, noise, left, force, offset, self.followed, self._film.told, self._film.age)
