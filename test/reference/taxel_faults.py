# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the tests of the taxels, in NumPy; posfet_core/taxel_faults.hpp says what they find."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_model.reconstruction.taxel_faults import TaxelStatus, coarse, longest_run
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import force_noise_rms, volts_per_count
from posfet_model.sensor.skin_response import LEAST_SPREAD
from reference.neighbour_estimate import NeighbourInterpolation
from reference.reductions import any_true, upper_median
from reference.skin_response import SkinResponse
from reference.telegraph_noise import TelegraphDetector

MOST_SCANS: Final = 64
"""Greatest number of scans that are kept for the noise estimate."""

PERIOD: Final = 0.055
"""Period of the tests for noise and response [s], or that number of scans: every third block of 20 ms."""

INFORMATIVE: Final = 5.0
"""Standard deviations of noise from which a force is informative about that of its neighbour [1]."""

COARSE_LOUD: Final = 1.5
"""Noise variance over the described one from which it is measured, with coarse codes [1]: a signal between two codes
switches between them, which is three times the variance of quantisation that is described, in all taxels at once."""


# Plain integers: comparing an array with a member of an enumeration takes ten times as long.
_OK: Final = int(TaxelStatus.OK)
_DEAD: Final = int(TaxelStatus.DEAD)
_STUCK: Final = int(TaxelStatus.STUCK)
_NOISY: Final = int(TaxelStatus.NOISY)


@dataclass(frozen=True)
class TaxelFaultSettings:
    """Settings of the detection of faulty taxels and of their recovery. All values are assumed."""

    confirm: float = 0.2
    """Time after which a taxel that is noisy, or holds a force alone, counts as faulty; also the time constant of the
    noise estimate [s]."""
    confirm_dead: float = 0.1
    """Time after which a taxel without response under load is dead, and one that alone is at the end of its range is
    stuck [s]."""
    recovery: float = 1.0
    """Time without fault, while nothing touches, after which a taxel is usable again [s]."""
    noisy: float = 3.0
    """Noise of a noisy taxel over that of the others [1]."""
    quiet: float = 2.0
    """Noise below which it has recovered, over that of the others [1]."""
    neighbours: float = 20.0
    """A touch moves some neighbour by at least one part in this many [1]."""
    alone: float = 50.0
    """A taxel at the end of its range is there alone when no neighbour shows one part in this many of it [1]."""
    certainty: float = 4.0
    """Standard deviations by which the neighbours of a held force must miss what they must feel of it [1]."""
    common_touch: float = 10.0
    """A noisy taxel reads at most this many times as much as a neighbour of a touch on both [1]."""
    dead: float = 0.05
    """Share of the expected force below which a taxel is dead [1]."""
    dead_load: float = 5.0
    """Least expected force from which a taxel is tested for response [contact threshold]."""
    leaked: float = 5.0
    """Time constants of the leakage after which even the greatest force is no longer at the end of the range [1]."""


class TaxelFaultDetector:
    """Tests the taxels of one array block by block; the counts of each scan are added to `history`.

    State variables per taxel: status; length of the current run of constant counts, in scans [1] and time [s]; noise
    variance [counts2]; duration of each suspected fault and of the recovery [s].

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    settings : TaxelFaultSettings, optional
        Settings; None: the defaults.
    known_dead : ndarray of bool, shape [rows * cols], optional
        Taxels known not to respond: these stay dead.
    """

    def __init__(
        self, sensor: Sensor, settings: TaxelFaultSettings | None = None, known_dead: NDArray[np.bool_] | None = None
    ) -> None:
        layout, taxels = sensor.layout, sensor.layout.taxels
        self._settings = settings or TaxelFaultSettings()
        self.surroundings = NeighbourInterpolation(layout)
        self._skin = SkinResponse(sensor)
        self._telegraph = TelegraphDetector(taxels, sensor.device.leak_time_constant, self._skin, self.surroundings)
        self._known_dead = np.zeros(taxels, np.bool_) if known_dead is None else known_dead
        self.status = np.where(self._known_dead, TaxelStatus.DEAD, TaxelStatus.OK).astype(np.uint8)
        """Values of TaxelStatus, OK, DEAD, STUCK or NOISY, shape [rows * cols]."""
        self.faulty = self._known_dead.copy()
        """Taxels whose signal is meaningless, shape [rows * cols]."""
        self.any_faulty = bool(self.faulty.any())
        """Whether a taxel is faulty."""
        self._all = np.arange(taxels)
        self.history = scan_path.CountHistory(MOST_SCANS + 2, taxels)
        """Counts of the last scans."""
        self._counts, self._close = self.history.counts, self.history.close
        self._last = 0  # row of the last scan of the previous block
        self._elapsed = 0.0
        self._touched = np.zeros(taxels, np.bool_)  # since the last tests for noise and response, like the elapsed time
        self._threshold = sensor.contact.threshold
        self._release_threshold = sensor.contact.threshold - sensor.contact.deadband
        self._informative = INFORMATIVE * force_noise_rms(sensor)
        self._force_max = sensor.device.force_max
        self._tau = sensor.device.leak_time_constant
        self._newton_per_count = volts_per_count(sensor) / sensor.volts_per_newton
        self._newton2_per_count2 = self._newton_per_count**2
        self.usual_change = np.zeros(taxels)
        """Median difference of two consecutive changes of each taxel [N], shape [rows * cols]."""
        self._noise = force_noise_rms(sensor) ** 2 / self._newton2_per_count2
        self._measured_from = COARSE_LOUD if coarse(sensor) else self._settings.quiet**2
        self._run_limit = longest_run(sensor)
        spread = sensor.device.contact_spread / max(layout.pitch_x, layout.pitch_y)
        self._spread_by_skin = spread >= LEAST_SPREAD
        self._run = np.zeros(taxels)
        self._run_time = np.zeros(taxels)
        self._level = np.full(taxels, self._noise)  # variance of the noise where nothing touches [counts2]
        self._level_overall = np.full(taxels, self._noise)
        self._noisy_for = np.zeros(taxels)
        self._quiet_for = np.zeros(taxels)
        self._alone_for = np.zeros(taxels)
        self._contradicted = np.zeros(taxels, np.bool_)  # noisy taxels whose force their neighbours contradict
        self._silent_for = np.zeros(taxels)
        self._responding_for = np.zeros(taxels)
        self._noisy, self._calm, self._dead = np.zeros((3, taxels), np.bool_)

    @property
    def noise_variance(self) -> NDArray[np.float64]:
        """Variance of a reading of each taxel [N2], shape [rows * cols]: measured if loud, else as described."""
        loud = self._level > self._measured_from * self._noise
        variance: NDArray[np.float64] = np.where(loud, self._level, self._noise) * self._newton2_per_count2
        return variance

    def informative(self, deviation: float) -> NDArray[np.bool_]:
        """Return the noisy taxels whose readings are still informative.

        Their neighbours must show part of any signal beyond that noise, as they would of a touch.

        Parameters
        ----------
        deviation : float
            Greatest standard deviation of the noise [N].

        Returns
        -------
        ndarray of bool, shape [rows * cols]
            Noisy taxels with at most that noise.
        """
        noisy: NDArray[np.bool_] = (self.status == _NOISY) & ~self._telegraph.found & ~self._contradicted
        if not any_true(noisy):
            return noisy
        most = deviation**2 / self._newton2_per_count2
        around = self.surroundings.max_neighbour(np.where(self.faulty, 0.0, self._level_overall))
        as_touch = self._level_overall <= np.maximum(most, self._settings.common_touch**2 * around)
        return noisy & (self._level <= most) & as_touch

    def close_block(
        self,
        duration: float,
        force: NDArray[np.float64],
        variance: NDArray[np.float64],
        charge: NDArray[np.float64],
        saturated: NDArray[np.bool_],
        touched: NDArray[np.bool_],
        offset_known: NDArray[np.bool_],
    ) -> bool:
        """End a block: test all taxels, and update their status.

        Parameters
        ----------
        duration : float
            Duration of the block [s].
        force : ndarray of float64, shape [rows * cols]
            Mean forces of the block [N].
        variance : ndarray of float64, shape [rows * cols]
            Variance of each force at rest [N2].
        charge : ndarray of float64, shape [rows * cols]
            Charge at each gate, as a force [N].
        saturated : ndarray of bool, shape [rows * cols]
            Taxels at the end of their range.
        touched : ndarray of bool, shape [rows * cols]
            Taxels in or near a contact.
        offset_known : ndarray of bool, shape [rows * cols]
            Taxels whose force is known, not only its changes.

        Returns
        -------
        bool
            Whether the set of faulty taxels changed.
        """
        self._elapsed += duration
        self._touched |= touched
        touches = any_true(self._touched)
        self._test_levels(duration)
        stuck, changed = self._test_runs(duration, charge, saturated)
        stuck |= self._alone_for >= self._settings.confirm
        if self._period_over:
            self._test_noise(saturated)
            variance = self._with_shown_errors(force, variance, offset_known)
            self._test_response(force, variance, offset_known)
            self._test_alone(force, variance, offset_known)
            self._start_period()
        self._last = max(self._filled - 1, 0)
        s, status, dead, telegraph = self._settings, self.status, self._dead, self._telegraph.found
        noisy = self._noisy | telegraph
        if self.any_faulty or any_true(stuck | noisy | dead):
            alive = self._responding_for >= s.confirm_dead
            sound = self._calm & np.select([status == _STUCK, status == _DEAD], [changed, alive], ~telegraph)
            self._quiet_for = np.where(sound & ~touches, self._quiet_for + duration, 0.0)
            back = (status == _DEAD) & (stuck | noisy) | (self._quiet_for >= s.recovery)
            status[back] = _OK
            status[noisy & (status == _OK) | telegraph & (status == _STUCK) & changed] = _NOISY
            status[dead & (status == _OK)] = _DEAD
            status[stuck] = _STUCK
            status[self._known_dead] = _DEAD
        faulty = status != 0
        different = any_true(faulty != self.faulty)
        if different:
            self.faulty[:] = faulty
            self.any_faulty = any_true(faulty)
        return different

    def measure_noise(self, duration: float, saturated: NDArray[np.bool_], touched: NDArray[np.bool_]) -> None:
        """End a block without a test: measure the noise of all taxels, and leave their status as it is.

        Parameters
        ----------
        duration : float
            Duration of the block [s].
        saturated : ndarray of bool, shape [rows * cols]
            Taxels at the end of their range.
        touched : ndarray of bool, shape [rows * cols]
            Taxels in or near a contact.
        """
        self._elapsed += duration
        self._touched |= touched
        if self._period_over:
            self._test_noise(saturated)
            self._start_period()
        self._last = max(self._filled - 1, 0)

    @property
    def _filled(self) -> int:
        """Number of scans that are kept."""
        return self.history.filled

    @property
    def _period_over(self) -> bool:
        """Whether the tests for noise and response are due."""
        return self._elapsed >= PERIOD or self._filled == len(self._counts)

    def _start_period(self) -> None:
        """Start the next period of the tests for noise and response."""
        self.history.keep(2)  # so that no difference is lost
        self._elapsed = 0.0
        self._touched[:] = False

    def _test_levels(self, duration: float) -> None:
        """Find the taxels with telegraph noise by the mean counts of the block."""
        block = self._counts[self._last + 1 : self._filled]
        if len(block):
            variance = np.maximum(block.var(axis=0), self._noise) / len(block)
            sound = ~self.faulty | self._telegraph.found
            self._telegraph.close_block(block.mean(axis=0), variance, sound, duration, any_true(self._touched))

    def _test_runs(
        self, duration: float, charge: NDArray[np.float64], saturated: NDArray[np.bool_]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the stuck taxels, and the taxels whose counts changed in this block."""
        block = self._counts[self._last : self._filled]
        changed: NDArray[np.bool_] = (block[1:] != block[:-1]).any(axis=0)
        self._run = np.where(changed, 0.0, self._run + max(len(block) - 1, 0))
        self._run_time = np.where(changed, 0.0, self._run_time + duration)
        silent = (self._run >= self._run_limit) & ~saturated
        # A constant charge would mean a force that grows at a constant rate, to within the noise.
        impossible = np.abs(charge) * (self._run_time / self._tau) > 0.5 * self._force_max
        if any_true(saturated):
            impossible = np.where(saturated, self._run_time > self._longest_saturation(charge), impossible)
        return silent | impossible, changed

    def _longest_saturation(self, charge: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the longest time that a working taxel may stay at the end of its range [s].

        Until its charge has leaked; much less, where no neighbour shows the force that would be required.
        """
        s = self._settings
        around = self.surroundings.max_neighbour(np.where(self.faulty, 0.0, np.abs(charge)))
        alone = (around < self._force_max / s.alone) & np.isfinite(around) & self._spread_by_skin
        return np.where(alone, s.confirm_dead, s.leaked * self._tau)

    def _test_noise(self, saturated: NDArray[np.bool_]) -> None:
        """Find the noisy taxels, and the taxels that are quiet again."""
        s, duration, touched = self._settings, self._elapsed, self._touched
        usual = max(self._noise, upper_median(self._level))
        now = self._level_overall
        second = self._second_differences()
        if len(second):
            self.usual_change = np.sort(np.abs(second), axis=0)[len(second) // 2] * self._newton_per_count
            # White noise of variance v has second differences of variance 6*v.
            found: NDArray[np.float64] = np.einsum("ij,ij->j", second, second) / (6.0 * len(second))
            share = -math.expm1(-duration / s.confirm)
            now = found.copy()
            self._level_overall += share * (found - self._level_overall)
            # Limited, so that a jump decays soon.
            np.minimum(found, (4.0 * s.noisy) ** 2 * usual, out=found)
            self._level += np.where(touched, 0.0, share) * (found - self._level)
        loud = (self._level > s.noisy**2 * usual) & ~touched
        if self._spread_by_skin and any_true(touched):
            # Statistical uncertainty of a neighbour's noise level, from the second differences in memory.
            uncertainty = 4.0 * math.sqrt(3.9 * duration / (self._filled * s.confirm))
            levels = np.where(self.faulty, 0.0, self._level_overall)
            around = self.surroundings.max_neighbour(levels) + (uncertainty - 1.0) * usual
            least = s.neighbours**2 * np.maximum(around, uncertainty * usual)
            loud |= (self._level_overall > least) & (now > least)  # a single jump is in memory, but not in the present
        more = np.where(loud, duration, -duration)
        more[saturated] = 0.0  # not informative
        self._noisy_for = np.maximum(self._noisy_for + more, 0.0)
        self._noisy, self._calm = self._noisy_for >= s.confirm, self._level < s.quiet**2 * usual

    def _second_differences(self) -> NDArray[np.float64]:
        """Return the second differences of the counts in memory, where scans closely follow each other.

        Their shape is [differences, rows * cols].
        """
        block, close = self._counts[: self._filled], self._close[: self._filled]
        difference = np.subtract(block[1:], block[:-1], dtype=np.float64)
        second: NDArray[np.float64] = difference[1:] - difference[:-1]
        whole = close[2:] & close[1:-1]
        return second if whole.all() else second[whole]

    def _with_shown_errors(
        self, force: NDArray[np.float64], variance: NDArray[np.float64], offset_known: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return the variance of each force [N2] with what negative forces show of the errors around it."""
        shows = offset_known & ~self.faulty & (force < -self._settings.certainty * np.sqrt(variance))
        shown = np.where(shows, -force, 0.0)
        return variance + np.maximum(shown, self.surroundings.max_neighbour(shown)) ** 2

    def _test_response(
        self, force: NDArray[np.float64], variance: NDArray[np.float64], offset_known: NDArray[np.bool_]
    ) -> None:
        """Find by the mean force of the last block [N] the dead taxels, and the dead ones that respond again."""
        s, duration = self._settings, self._elapsed
        load = s.dead_load * self._threshold
        if not any_true(force >= load):
            self._dead[:] = False
            return
        floor = np.maximum(self._informative, s.certainty * np.sqrt(variance))
        least = self.surroundings.lower_bound(force, self.faulty | ~offset_known, self._all, floor)
        loaded = (least >= np.maximum(load, floor)) & offset_known
        silent = loaded & (np.abs(force) < s.dead * least)
        self._silent_for = np.where(silent, self._silent_for + duration, np.where(loaded, 0.0, self._silent_for))
        responding = loaded & (force > 0.5 * least)
        self._responding_for = np.where(
            responding, self._responding_for + duration, np.where(silent, 0.0, self._responding_for)
        )
        self._dead = self._silent_for >= s.confirm_dead

    def _test_alone(
        self, force: NDArray[np.float64], variance: NDArray[np.float64], offset_known: NDArray[np.bool_]
    ) -> None:
        """Update how long taxels have held a force that their neighbours contradict, by the mean of the last block [N].

        Such taxels failed while they were pressed, or their signal is not that of a force.
        """
        forced = force >= self._release_threshold
        sound = offset_known & ~self.faulty
        pressed, noisy = forced & self._touched & sound, forced & (self.status == _NOISY)
        if not any_true(pressed | noisy):
            self._alone_for[:] = 0.0
            self._contradicted[:] = False
            return
        contradicted, _ = self._skin.contradicts(force, variance, sound, self._settings.certainty)
        self._alone_for = np.where(pressed & contradicted, self._alone_for + self._elapsed, 0.0)
        if any_true(noisy):  # of the mean of a block, its noise is a small part
            contradicted, _ = self._skin.contradicts(force, np.zeros_like(variance), sound, 0.0)
        self._contradicted = noisy & contradicted
