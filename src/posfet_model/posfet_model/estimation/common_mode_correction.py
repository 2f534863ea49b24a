# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Removal of the common-mode component from the forces and from the baseline tracking of each taxel."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import any_true, upper_median
from posfet_model._lib.types import Array, Mask
from posfet_model.estimation.drift_filter import DriftFilter
from posfet_model.estimation.leakage_identification import LeakageIdentifier
from posfet_model.estimation.multiple_model_filter import DISTURBANCE_TIME, BlockObservation, CommonOffsetFilter
from posfet_model.estimation.thermal_uncertainty import ThermalUncertainty

RESIDUAL: Final = 5e-3
"""Standard deviation of the median signal due to residual hum and the like [contact threshold]."""

OFTEN: Final = 5
SELDOM: Final = 20
"""While no random walk of the film temperature is found, one of this many blocks is processed; seldom when the film is
surely at rest."""

FEW: Final = 3
"""With fewer untouched taxels the common mode is not estimated."""


class CommonModeCorrector:
    """Estimates the common-mode signal as the median, robust to touches on fewer than half of the taxels.

    State variables: the filter of the common offset, the film temperature rise that forces follow [K], signal [N] and
    noise variance [N2] of the block, time at rest [leakage time constants].

    Parameters
    ----------
    force : ndarray of float64, shape [taxels]
        Forces [N]; corrected in place.
    drift : DriftFilter
        Offsets and their uncertainty.
    leakage : LeakageIdentifier
        Leakage time constants.
    thermal : ThermalUncertainty
        Effect of the film temperature.
    threshold : float
        Contact threshold [N].
    """

    def __init__(
        self,
        force: Array,
        drift: DriftFilter,
        leakage: LeakageIdentifier,
        thermal: ThermalUncertainty,
        threshold: float,
    ) -> None:
        self._force, self._drift, self._leakage, self._thermal = force, drift, leakage, thermal
        self._film, self._common, per_kelvin = thermal.film, thermal.common, thermal.per_kelvin
        self._per_kelvin = per_kelvin
        self._typical = upper_median(per_kelvin)
        random_walk = drift.random_walk / len(force)
        time_constant = float(leakage.time_constant.mean())
        self.offset = CommonOffsetFilter(time_constant, self._film.time_constant, self._typical, random_walk)
        self.film_rise = 0.0
        """Film temperature rise since the start, without corrections under a touch [K]; written by others."""
        self._residual = (RESIDUAL * threshold) ** 2
        self._usable = np.ones(len(force), np.bool_)
        self._count = len(force)
        self._rested = DISTURBANCE_TIME  # time without touch, in leakage time constants [1]
        self._leaked = np.zeros(len(force))
        self._signal = self._noise = 0.0
        self._skipped, self._passed = 0, 0.0  # blocks not processed, and the time since one was processed [s]

    @property
    def due(self) -> bool:
        """Whether the block that begins is processed, so that `begin_block` is required."""
        if self.offset.random_walk_found or self.offset.holding:
            return True
        return self._skipped + 1 >= (SELDOM if self.offset.at_rest else OFTEN)

    def begin_block(self, leaked: Array) -> None:
        """Record the accumulated leakage of each taxel [N], up to a constant, when a block begins."""
        self._leaked = leaked

    def compensate(self, force: Array, touched: bool) -> None:
        """Attribute the common-mode component of the usable taxels' forces [N] in a scan to the film temperature.

        Parameters
        ----------
        force : ndarray of float64, shape [taxels]
            Forces of the scan [N].
        touched : bool
            Whether something touches.
        """
        if touched:
            self._apply_rise(self._common.update_touched(force))
        else:
            self._apply_untouched_rise(self._common.update_untouched(force))

    def close_block(
        self, mean: Array, touched: bool, signal: Array, offset_known: Mask, valid: bool, duration: float
    ) -> None:
        """End a block: process its mean forces and correct the forces.

        Parameters
        ----------
        mean : ndarray of float64, shape [taxels]
            Mean forces of the block [N].
        touched : bool
            Whether something touched in the block.
        signal : ndarray of float64, shape [taxels]
            Signals at the end of the block [N].
        offset_known : ndarray of bool, shape [taxels]
            Taxels whose offset is known.
        valid : bool
            Whether all forces are valid.
        duration : float
            Duration of the block [s].
        """
        self._update_common_mode(mean[self._usable], touched, duration)
        if touched:
            self._end_rest()
        else:
            self._update_at_rest(signal, offset_known, valid, duration)

    def learnt_during_warming(self, duration: float) -> tuple[bool, bool]:
        """Return `ThermalUncertainty.learnt_during_warming` once per block; false where a random walk is found."""
        unknown, known = self._thermal.learnt_during_warming(duration)
        return unknown and not self.offset.random_walk_found, known and not self.offset.random_walk_found

    def _update_common_mode(self, mean: Array, touched: bool, duration: float) -> None:
        """Update the common-mode temperature by a block, and revert a correction that was not confirmed."""
        if not touched:
            self._common.end_touch()
        change = self._common.update(mean, duration, touched)
        if change:
            self._apply_untouched_rise(change)
            self._thermal.mismatch_deviation = 0.0
            self._drift.reset_force_error(slice(None), self._drift.noise_variance)

    def _apply_rise(self, change: float) -> None:
        """Compensate a temperature change [K] in the forces."""
        if change:
            self._force -= change * self._per_kelvin
            self._thermal.rise += change

    def _apply_untouched_rise(self, change: float) -> None:
        self._apply_rise(change)
        self.film_rise += change

    def set_usable(self, usable: Mask) -> None:
        """Set the taxels that work; all do initially."""
        self._usable = usable
        self._count = int(np.count_nonzero(usable))
        self.offset.reset()

    def measure(self, leaked: Array, duration: float, scans: int) -> None:
        """Measure the common-mode signal of a block from the accumulated leakage [N], before offsets are corrected.

        Parameters
        ----------
        leaked : ndarray of float64, shape [taxels]
            Accumulated leakage [N].
        duration : float
            Duration of the block [s].
        scans : int
            Number of scans in the block.
        """
        if not self._count:
            return
        # The leakage over a block gives the mean of its signals.
        charge = (leaked - self._leaked) * self._leakage.time_constant / duration
        self._signal = upper_median(charge[self._usable]) + float(self._drift.offset.mean(where=self._usable))
        # The variance of a median of many is pi/2 times that of their mean.
        self._noise = self._residual + 0.5 * np.pi * float(self._drift.noise_variance.mean()) / (scans * self._count)

    def subtract_common_mode(self, mean: Array, touched: Mask, observable: bool) -> None:
        """Subtract the common mode from mean forces [N], in place, so that no baseline absorbs it.

        `observable`: the untouched taxels give the temperature.

        Parameters
        ----------
        mean : ndarray of float64, shape [taxels]
            Mean force over the block [N].
        touched : ndarray of bool, shape [taxels]
            Taxels that are touched.
        observable : bool
            Whether the untouched taxels give the temperature.
        """
        touches = any_true(touched)
        if not (observable if touches else self.offset.random_walk_found):
            return
        free = self._usable & ~touched
        if np.count_nonzero(free) >= FEW:
            mean[free if touches else slice(None)] -= upper_median(mean[free])

    def begin_touch(self, begun: Mask, blocks: NDArray[np.intp], duration: float) -> None:
        """Correct the taxels on which a touch begins, which were rolled back by `blocks` blocks, shape [begun].

        Parameters
        ----------
        begun : ndarray of bool, shape [taxels]
            Taxels on which a touch begins.
        blocks : ndarray of intp, shape [begun]
            Number of blocks by which each of these taxels was rolled back.
        duration : float
            Duration of the block [s].
        """
        if not self.offset.random_walk_found:
            return
        touch = self.offset.begin_touch(self.film_rise, duration)
        blocks = np.minimum(blocks, len(touch.force) - 1)
        self._force[begun] += touch.force[blocks] - touch.rise[blocks] * self._per_kelvin[begun]
        self._drift.set_mean_offset(self._usable, touch.offset)

    def update_touched(self, duration: float) -> None:
        """Correct all forces at the end of a block of `duration` [s] under a touch."""
        if not self.offset.holding:
            return
        found = self.offset.update_touched(self.film_rise, self._film.reading, self._film.age, duration)
        self._force += found.force - found.rise * self._per_kelvin
        self._drift.set_mean_offset(self._usable, found.offset)

    def _end_rest(self) -> None:
        """Record that something touched in a block."""
        self._rested = self._passed = 0.0
        self._skipped = 0
        if not (self.offset.holding or self.offset.variance):
            self.offset.reset()

    def _update_at_rest(self, signal: Array, offset_known: Mask, valid: bool, duration: float) -> None:
        """Update the offset filter by a block without touch; correct all forces where a random walk is found."""
        self._rested += duration / self.offset.time_constant
        self._passed += duration
        if not self._count or not self._typical:
            return
        known = np.count_nonzero(offset_known & self._usable)
        disturbed = known == self._count and not valid
        given_up = self.offset.variance > 0.0 and not self.offset.holding
        if disturbed or given_up or (self._film.ramping and not (self.offset.random_walk_found and valid)):
            self.offset.reset()
            return
        if not self.due:
            self._skipped += 1
            return
        passed, self._passed, self._skipped = self._passed, 0.0, 0
        found = self.offset.update_at_rest(self._observe(signal), duration, passed, 2 * known > self._count)
        if not found:
            return
        if found.begins:
            self._restart(self._usable & ~offset_known, signal, found.charge)
            self._drift.inflate_offset_variance(self._usable & offset_known, found.charge_variance)
        self._apply_untouched_rise(found.rise)
        self._force += found.force
        self._drift.record_correction(found.force)
        self._drift.set_mean_offset(self._usable, found.offset)

    def _restart(self, new: Mask, signal: Array, charge: float) -> None:
        """Restart offsets that are not known yet, without the pyroelectric charge in the signals."""
        noise = self._drift.noise_variance[new]
        offset = signal[new] - charge / self._typical * self._per_kelvin[new]
        self._drift.restart(new, offset, noise, noise, -noise)
        self._force[new] = 0.0

    def _observe(self, signal: Array) -> BlockObservation:
        usable, noise, residual = self._usable, self._noise, 0.0
        offset = float(self._drift.offset.mean(where=usable))
        if self._rested < DISTURBANCE_TIME:
            # The charge that a touch left leaks away, as fast as the leakage is known.
            residual = float(signal.mean(where=usable)) - offset
            noise += (self._leakage.standard_deviation * self._rested * residual) ** 2
        force = upper_median(self._force[usable])
        film = self._film
        return BlockObservation(self._signal, noise, residual, force, offset, self.film_rise, film.reading, film.age)
