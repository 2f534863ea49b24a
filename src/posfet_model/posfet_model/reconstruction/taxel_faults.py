"""Taxels that do not work, found while the array runs, and found again when they do.

- Stuck: the counts stay the same although noise must move them, or although a charge so far from the zero would leak,
  or at the end of the range while no neighbour feels anything. Or a force is held that no neighbour feels.
- Noisy: the second differences of the counts are far above the noise described, that of most taxels, and what any
  neighbour shows. A touch is felt by the neighbours too: the cover spreads it.
- Dead: the taxel reads next to nothing while all around it tells that it is pressed.

A dead taxel in a corner has one square of neighbours to speak for it, and none in a single row of taxels: there it is
not found. A hole in an object, smaller than a cell, would be taken for a dead taxel. A stuck taxel whose noise hides
between two codes of a coarse converter is found as a dead one, when it is pressed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import any_true, upper_median
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.neighbour_estimate import NeighbourInterpolation
from posfet_model.sensor.signal_chain import COARSEST_BITS, force_noise_rms, volts_per_count

MOST_SCANS: Final = 64
"""Scans of a block that are looked at, and of several blocks in which noise is looked for."""

PERIOD: Final = 0.055
"""Noise and answers are judged once so much time has passed, or so many scans [s]: every third block of 20 ms."""

LEAST_SPREAD: Final = 0.3
"""Spread of the cover, in pitches, from which every touch is felt by a neighbour [1]."""

TELLING: Final = 5.0
"""Standard deviations of noise from which a force tells something of its neighbour's [1]."""

CERTAINTY: Final = 1e-12
"""Probability that noise leaves a working taxel's counts alone for as long as it takes to be called stuck [1]."""

LONGEST_RUN: Final = 100_000
"""Scans after which unchanged counts mean nothing any more: noise much below a step need never move them."""


class TaxelStatus(IntEnum):
    """Status of a taxel; the values are those of TAXEL_* in posfet_msgs/TactileImage."""

    OK = 0
    DEAD = 1
    STUCK = 2
    SATURATED = 3
    ABSENT = 4
    NOISY = 5


# Plain numbers: an array compared with a member of an enumeration takes ten times as long.
_OK: Final = int(TaxelStatus.OK)
_DEAD: Final = int(TaxelStatus.DEAD)
_STUCK: Final = int(TaxelStatus.STUCK)
_NOISY: Final = int(TaxelStatus.NOISY)


@dataclass(frozen=True)
class WatchSettings:
    """When a taxel is given up, and when it is taken back. All values are assumed."""

    confirm: float = 0.2
    """A taxel is noisy, or holds a force alone, once it has done so for this long; also the memory of the noise [s]."""
    confirm_dead: float = 0.1
    """A taxel is dead once it has read nothing under load for this long, and stuck once it alone has been at the end of
    its range for this long [s]."""
    heal: float = 1.0
    """A stuck or noisy taxel is taken back after it has been well for this long [s]."""
    noisy: float = 3.0
    """Noise of a noisy taxel, in that of others [1]."""
    quiet: float = 2.0
    """Noise below which it is well again, in that of others [1]."""
    neighbours: float = 20.0
    """A touch moves some neighbour by at least one part in this many [1]."""
    alone: float = 50.0
    """A taxel holds a force alone when no neighbour feels one part in this many of it [1]."""
    shared: float = 10.0
    """A noisy taxel shows at most this many times what a neighbour does of a touch on both [1]."""
    dead: float = 0.05
    """Share of the force to be expected, below which a taxel is dead [1]."""
    dead_load: float = 5.0
    """Force to be expected at least, before a taxel is judged by it, in thresholds of contact [1]."""
    leaked: float = 5.0
    """Time constants of the leak after which even the greatest force is no longer at the end of the range [1]."""


class TaxelWatch:
    """Judges the taxels of one array block by block. `bad` masks those whose signal means nothing."""

    def __init__(
        self, sensor: Sensor, settings: WatchSettings | None = None, known_dead: NDArray[np.bool_] | None = None
    ) -> None:
        """Take the sensor, and the taxels that are known not to answer: those are dead for ever."""
        layout, taxels = sensor.layout, sensor.layout.taxels
        self._settings = settings or WatchSettings()
        self.surroundings = NeighbourInterpolation(layout)
        self._known_dead = np.zeros(taxels, np.bool_) if known_dead is None else known_dead
        self.status = np.where(self._known_dead, TaxelStatus.DEAD, TaxelStatus.OK).astype(np.uint8)
        """Values of TaxelStatus, OK, DEAD, STUCK or NOISY, shape [rows * cols]."""
        self.bad = self._known_dead.copy()
        self.any_bad = bool(self.bad.any())
        self._all = np.arange(taxels)
        self._counts = np.zeros((MOST_SCANS + 2, taxels), np.uint16)
        self._rows = list(self._counts)
        self._filled = 0
        self._last = 0  # row of the last scan of the block before
        self._elapsed = 0.0
        self._touched = np.zeros(taxels, np.bool_)  # since noise and answers were judged, as the time before
        self._threshold = sensor.contact.threshold
        self._tells = TELLING * force_noise_rms(sensor)
        self._force_max = sensor.device.force_max
        self._tau = sensor.device.leak_time_constant
        self._newton2_per_count2 = (volts_per_count(sensor) / sensor.volts_per_newton) ** 2
        self._noise = force_noise_rms(sensor) ** 2 / self._newton2_per_count2
        self._run_limit = longest_run(sensor)
        spread = sensor.device.contact_spread / max(layout.pitch_x, layout.pitch_y)
        self._felt_around = spread >= LEAST_SPREAD
        self._run = np.zeros(taxels)
        self._run_time = np.zeros(taxels)
        self._level = np.full(taxels, self._noise)  # variance of the noise where nothing touches [counts2]
        self._level_always = np.full(taxels, self._noise)
        self._noisy_for = np.zeros(taxels)
        self._well_for = np.zeros(taxels)
        self._alone_for = np.zeros(taxels)
        self._silent_for = np.zeros(taxels)
        self._answering_for = np.zeros(taxels)
        self._noisy, self._calm, self._dead, self._alive = np.zeros((4, taxels), np.bool_)

    @property
    def noise_variance(self) -> NDArray[np.float64]:
        """Variance of a reading of each taxel [N2], shape [rows * cols]: as found where loud, else as described."""
        loud = self._level > self._settings.quiet**2 * self._noise
        variance: NDArray[np.float64] = np.where(loud, self._level, self._noise) * self._newton2_per_count2
        return variance

    def telling(self, deviation: float) -> NDArray[np.bool_]:
        """Return which noisy taxels have noise of at most a standard deviation [N], shape [rows * cols].

        What they show beyond that, their neighbours have to show, too, as a touch would.
        """
        noisy: NDArray[np.bool_] = self.status == _NOISY
        if not any_true(noisy):
            return noisy
        most = deviation**2 / self._newton2_per_count2
        around = self.surroundings.max_neighbour(np.where(self.bad, 0.0, self._level_always))
        as_touch = self._level_always <= np.maximum(most, self._settings.shared**2 * around)
        return noisy & (self._level <= most) & as_touch

    def take(self, counts: NDArray[np.uint16]) -> None:
        """Keep the counts of a scan until the block is judged."""
        if self._filled < len(self._rows):
            self._rows[self._filled][...] = counts
            self._filled += 1

    def judge(
        self,
        duration: float,
        force: NDArray[np.float64],
        leaking: NDArray[np.float64],
        saturated: NDArray[np.bool_],
        touched: NDArray[np.bool_],
    ) -> bool:
        """Judge a block of `duration` [s]; return whether another set of taxels is bad than before.

        force [N] is the block's mean, leaking [N] the charge left at each gate as a force, `saturated` masks taxels at
        the end of their range, `touched` those in or near a contact; shapes [rows * cols].
        """
        self._elapsed += duration
        self._touched |= touched
        stuck, changed = self._judge_runs(duration, leaking, saturated)
        stuck |= self._alone_for >= self._settings.confirm
        if self._elapsed >= PERIOD or self._filled == len(self._counts):
            self._judge_noise(saturated)
            self._judge_answer(force)
            self._judge_alone(force)
            self._begin()
        self._last = max(self._filled - 1, 0)
        s, status, noisy, dead = self._settings, self.status, self._noisy, self._dead
        if self.any_bad or any_true(stuck | noisy | dead):
            well = np.where(status == _STUCK, changed & self._calm, self._calm)
            self._well_for = np.where(well, self._well_for + duration, 0.0)
            back = (status == _DEAD) & (self._alive | stuck | noisy)
            back |= ((status == _STUCK) | (status == _NOISY)) & (self._well_for >= s.heal)
            status[back] = _OK
            status[noisy & (status == _OK)] = _NOISY
            status[dead & (status == _OK)] = _DEAD
            status[stuck] = _STUCK
            status[self._known_dead] = _DEAD
        bad = status != 0
        different = any_true(bad != self.bad)
        if different:
            self.bad[:] = bad
            self.any_bad = any_true(bad)
        return different

    def _begin(self) -> None:
        """Begin to wait for the next judgement of noise and answers."""
        # The last two scans go on, so that no difference is lost.
        keep = min(self._filled, 2)
        self._counts[:keep] = self._counts[self._filled - keep : self._filled]
        self._filled = keep
        self._elapsed = 0.0
        self._touched[:] = False

    def _judge_runs(
        self, duration: float, leaking: NDArray[np.float64], saturated: NDArray[np.bool_]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which taxels are stuck, and which changed in this block."""
        block = self._counts[self._last : self._filled]
        changed: NDArray[np.bool_] = (block[1:] != block[:-1]).any(axis=0)
        self._run = np.where(changed, 0.0, self._run + max(len(block) - 1, 0))
        self._run_time = np.where(changed, 0.0, self._run_time + duration)
        silent = (self._run >= self._run_limit) & ~saturated
        # A held charge that does not leak would be a force that grows evenly, to within the noise.
        impossible = np.abs(leaking) * (self._run_time / self._tau) > 0.5 * self._force_max
        if any_true(saturated):
            impossible = np.where(saturated, self._run_time > self._saturated_for(leaking), impossible)
        return silent | impossible, changed

    def _saturated_for(self, leaking: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return for how long a working taxel may stay at the end of its range [s].

        Until its charge has leaked; a moment, where no neighbour feels what would have to press it.
        """
        s = self._settings
        around = self.surroundings.max_neighbour(np.where(self.bad, 0.0, np.abs(leaking)))
        alone = (around < self._force_max / s.alone) & np.isfinite(around) & self._felt_around
        return np.where(alone, s.confirm_dead, s.leaked * self._tau)

    def _judge_noise(self, saturated: NDArray[np.bool_]) -> None:
        """Judge which taxels are noisy, and which are quiet enough to be taken back."""
        s, duration, touched = self._settings, self._elapsed, self._touched
        usual = max(self._noise, upper_median(self._level))
        now = self._level_always
        if self._filled > 2:
            block = self._counts[: self._filled]
            difference = np.subtract(block[1:], block[:-1], dtype=np.float64)
            second = difference[1:] - difference[:-1]
            # White noise of variance v has second differences of variance 6*v.
            found: NDArray[np.float64] = np.einsum("ij,ij->j", second, second) / (6.0 * len(second))
            share = -math.expm1(-duration / s.confirm)
            now = found.copy()
            self._level_always += share * (found - self._level_always)
            # Limited, so that a jump is soon forgotten.
            np.minimum(found, (4.0 * s.noisy) ** 2 * usual, out=found)
            self._level += np.where(touched, 0.0, share) * (found - self._level)
        loud = (self._level > s.noisy**2 * usual) & ~touched
        if self._felt_around and any_true(touched):
            # What a neighbour shows is known to so much only, from the second differences in memory.
            doubt = 4.0 * math.sqrt(3.9 * duration / (self._filled * s.confirm))
            heard = np.where(self.bad, 0.0, self._level_always)
            around = self.surroundings.max_neighbour(heard) + (doubt - 1.0) * usual
            least = s.neighbours**2 * np.maximum(around, doubt * usual)
            loud |= (self._level_always > least) & (now > least)  # a jump is remembered, but not repeated
        more = np.where(loud, duration, -duration)
        more[saturated] = 0.0  # which tells neither
        self._noisy_for = np.maximum(self._noisy_for + more, 0.0)
        self._noisy, self._calm = self._noisy_for >= s.confirm, self._level < s.quiet**2 * usual

    def _judge_answer(self, force: NDArray[np.float64]) -> None:
        """Judge by the mean force of the last block [N] which taxels are dead, and which dead ones answer again."""
        s, duration = self._settings, self._elapsed
        load = s.dead_load * self._threshold
        if not any_true(force >= load):
            self._dead[:] = self._alive[:] = False
            return
        least = self.surroundings.lower_bound(force, self.bad, self._all, self._tells)
        loaded = least >= load
        silent = loaded & (np.abs(force) < s.dead * least)
        self._silent_for = np.where(silent, self._silent_for + duration, np.where(loaded, 0.0, self._silent_for))
        answering = loaded & (force > 0.5 * least)
        self._answering_for = np.where(
            answering, self._answering_for + duration, np.where(silent, 0.0, self._answering_for)
        )
        self._dead, self._alive = self._silent_for >= s.confirm_dead, self._answering_for >= s.confirm_dead
        self._answering_for[self._alive] = 0.0

    def _judge_alone(self, force: NDArray[np.float64]) -> None:
        """Judge by the mean force of the last block [N] for how long taxels have held one that no neighbour feels.

        They died while they were pressed.
        """
        s = self._settings
        pressed = self._touched & (force >= s.dead_load * self._threshold)
        if not (self._felt_around and any_true(pressed)):
            self._alone_for[:] = 0.0
            return
        around = self.surroundings.max_neighbour(np.where(self.bad, np.inf, np.abs(force)))
        alone = pressed & (around < force / s.alone) & np.isfinite(around)
        self._alone_for = np.where(alone, self._alone_for + self._elapsed, 0.0)


def longest_run(sensor: Sensor) -> float:
    """Return for how many scans the counts of a working taxel may stay the same [1]; inf when for ever.

    A count stays where the noise stays within one step of the converter around its middle, the worst place for it.
    """
    bits = sensor.adc.bits if sensor.can.fd else min(sensor.adc.bits, COARSEST_BITS)
    half = 0.5 * (sensor.adc.high - sensor.adc.low) / ((1 << bits) - 1)
    if sensor.adc.noise == 0.0:
        return math.inf
    leaves = math.erfc(half / (math.sqrt(2.0) * sensor.adc.noise))
    if leaves >= 1.0 or leaves * LONGEST_RUN < -math.log(CERTAINTY):
        return math.inf
    return max(2.0, math.log(CERTAINTY) / math.log1p(-leaves))
