# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A simulated readout board with an array: from loads to scans and their ground truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.units import NANOSECONDS
from posfet_model._lib.validation import whole_number
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.defaults import SEED_MAX
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.film import Film, chip_warming
from posfet_sim.device.ground_truth import Truth
from posfet_sim.device.readout import BLOCK, Readout
from posfet_sim.device.sample_clock import SampleClock
from posfet_sim.device.taxel_charge import TaxelCharge
from posfet_sim.device.taxel_variation import draw_taxel_parameters
from posfet_sim.device.temperature_sensors import TemperatureSensors
from posfet_sim.loads import Loads, ObjectsState, Patch

OVERTEMPERATURE: Final = 85.0
"""Chip temperature above which the board sets STATUS_OVERTEMPERATURE [degC]; assumed."""
MIN_FORCE: Final = 1e-9
"""Force on a taxel that does not count as contact [N]: the rounding error at the end of a path."""

MAX_BATCH: Final = 32
"""Maximum number of scans computed at once while something touches."""

SKIP_STEPS: Final = 64
"""Maximum number of steps in which `SimulatedBoard.skip_to` advances."""

_SKIPPED_BATCH: Final = 16_384  # taxels times scans computed at once for scans that are not read
_MEMORY: Final = 30.0  # time constants after which the initial state has decayed: exp(-30) = 1e-13
_NEGLIGIBLE_LAG: Final = 1e-12  # lag of the film temperature [K] that counts as none: 1e-12 N on a taxel
_OK: Final = int(ScanStatus.OK)
_HOT: Final = int(ScanStatus.OVERTEMPERATURE)


class _Batch(NamedTuple):
    """Consecutive scans that were computed at once."""

    first: int
    """Index of the first one."""
    times: list[float]
    """Sampling time of each [s]."""
    force: NDArray[np.float64]
    """Force on each taxel [N], shape [scans, rows * cols]."""
    chip: list[float]
    """Temperature of the chip at each [degC]."""
    film: list[float]
    """Temperature of the film at each [degC]."""
    sensed: list[float]
    """Temperature of the sensors on the chip at each, without their offsets [degC]."""
    active: NDArray[np.intp]
    """Taxels with charge."""
    charge: NDArray[np.float64]
    """Their charge density [C/m2], shape [1 + scans, active]; the first row is that of the previous scan."""
    outputs: NDArray[np.float64]
    """Result of `Readout.outputs` [LSB], shape [scans, active]."""

    @property
    def last(self) -> int:
        """Index of the last one."""
        return self.first + len(self.times) - 1


class SimulatedBoard:
    """Computes the scans of a board from loads; the same seed gives the same bytes.

    The board starts without charge: that of forces which act from the start on has leaked away before.
    Noise depends on the seed and the index of the scan only. Force and temperature are piecewise linear between scans
    (first-order hold); charge leakage and the first-order lag of the film temperature behind the chip temperature, with
    the thermal time constant of the sensor, are exact for that. Both temperature sensors measure the chip. Effects
    faster than the scan rate - lag and slew of the followers, their noise above half the scan rate - are in closed
    form.

    Only what the loads require is computed. Taxels without charge are inactive and cost only their conversion. While
    the loads are constant, the charge is advanced in one step when it is next read, and after its decay (30 time
    constants) not at all. Consecutive scans are computed ahead in batches of up to 32 (64 under constant
    loads while no taxel has charge): the first one of a batch takes the time, or `prepare` before it. Loads that are
    `live` are never asked for the time of a scan before that is read.

    A film with effects of its own (`ErrorModel.film`) never rests: every taxel is computed in every scan.

    Link faults and resets are applied outside the board, by `posfet_sim.emulation.link_faults`.

    Not simulated: tangential force as a signal, friction and viscosity of the elastomer skin, temperature gradients
    over the chip other than under a contact, field dependence of the permittivity, crosstalk beyond the four
    neighbours, an anti-aliasing filter, nonlinearity of the ADC other than missing codes, supply faults, taxels that
    fail during operation, and a changing clock drift.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    loads : Loads
        Forces and chip temperature over time: those of a scene (`SceneLoads`) or any other.
    seed : int
        Seed of everything random, in [0, 1e9].
    error_model : ErrorModel, optional
        Non-idealities; default: an ideal board.
    compute_all : bool
        Whether to compute every taxel in every scan, for comparison.
    single_precision : bool
        Whether to compute charge and readout in float32, for comparison.

    Raises
    ------
    ValueError
        The seed is out of range.
    """

    def __init__(
        self,
        sensor: Sensor,
        loads: Loads,
        seed: int,
        error_model: ErrorModel | None = None,
        *,
        compute_all: bool = False,
        single_precision: bool = False,
    ) -> None:
        seed = whole_number("seed", seed, 0, SEED_MAX)
        self.sensor = sensor
        self.loads = loads
        self.error_model = error_model or ErrorModel.none()
        self.clock = SampleClock(
            sensor.can.scan_rate, self.error_model.clock_drift, self.error_model.clock_jitter, seed
        )
        """Sampling times."""
        taxels = draw_taxel_parameters(sensor, self.error_model, seed)
        self._taxels = taxels.single_precision() if single_precision else taxels
        effects = self.error_model.film
        self._force = self._forces([0.0])[1][0]
        self._chip = self.loads.temperatures([0.0])[0]
        self._chip_warming = chip_warming(effects)
        if self._chip_warming is not None and self._force.any():
            total = self._force.sum(keepdims=True)
            self._chip_warming.start_under(total)
            self._chip += self._chip_warming.respond(total[None], np.zeros(1)).item()
        self._start_temperature = self._chip
        film = Film(sensor, effects, self._start_temperature, seed) if effects.any_on else None
        self._charge = TaxelCharge(sensor, self._taxels, self.error_model.hysteresis, compute_all, film)
        self._readout = Readout(sensor, self.error_model, self._taxels, self.clock, seed)
        self._readout.activate(self._charge.active)
        self._compute_all = compute_all
        self._changes_at_rest = film is not None  # films creep and drift while the loads are constant
        self._film_lag = 0.0
        self._sensors = TemperatureSensors(self.error_model.board, self._chip, seed)
        if self._force.any():
            self._charge.start_under(self._force)
        self._memory = math.ceil(
            _MEMORY
            * max(
                self._taxels.leak_time_constant.max(),
                sensor.device.thermal_time_constant,
                self.error_model.board.sensor_lag,
            )
            / self.clock.interval
        )
        self._end = -1  # last scan that loads, film and charge were advanced to
        self._constant_end = -1  # scan up to which nothing changes
        self._batch = 1  # scans computed at once
        self._skipped_batch = max(_SKIPPED_BATCH // sensor.layout.taxels, MAX_BATCH)  # the same for scans not read
        force, charge = self._force[None], np.zeros((2, self._charge.active.size))
        chip = [self._chip]
        start = _Batch(-1, [self.clock.time(0)], force, chip, chip, chip, self._charge.active, charge, charge)
        self._next = self._with_outputs(start, self.clock.steps(-1, 1))
        self._counts = self._readout.counts(0, self._next.outputs)  # of `_next`
        self._now = self._next, -1  # the batch of the last scan, and its index

    @property
    def taxel_updates(self) -> int:
        """Number of updates of the charge of one taxel so far; at most taxels times scans."""
        return self._charge.updates

    @property
    def index(self) -> int:
        """Index of the last scan; -1 before the first."""
        return self._now[1]

    @property
    def time(self) -> float:
        """Sampling time of the last scan [s] since the board started. Thread-safe."""
        batch, index = self._now
        return batch.times[index - batch.first]

    @property
    def in_contact(self) -> bool:
        """Whether there was a force on a taxel in the last scan."""
        batch, index = self._now
        return bool(batch.force[index - batch.first].max() > MIN_FORCE)

    @property
    def taxel_status(self) -> NDArray[np.uint8]:
        """Fault of each taxel (TaxelStatus), shape [rows * cols]."""
        return self._taxels.status

    def scan(self, index: int, out: Scan) -> None:
        """Compute one scan.

        After a gap the state is the one that the skipped scans would have led to, within 1e-12 of full scale; only the
        hysteresis of an ideal film has no memory of more than 30 time constants before. Those of a real film
        (`ErrorModel.film`) are computed.

        Parameters
        ----------
        index : int
            Index of the scan, above the last one.
        out : Scan
            Receives the scan; its stamp counts from the start of the board.

        Raises
        ------
        ValueError
            `index` is not above the last one.
        """
        self._prepare(index)
        batch = self._next
        self._now = batch, index
        row = index - batch.first
        out.counts[:] = self._counts[row]
        out.stamp = round(batch.times[row] * NANOSECONDS)
        out.stamp_uncertainty = 0.0
        out.layout_id = self.sensor.layout.id
        out.sequence = index
        out.device_time = round(index / self.sensor.can.scan_rate * 1e6)
        offsets = self._sensors.offsets
        out.temperatures[:] = batch.sensed[row] if offsets is None else batch.sensed[row] + offsets
        out.status = _HOT if batch.chip[row] > OVERTEMPERATURE else _OK

    def prepare(self, index: int) -> None:
        """Compute scan `index` in advance unless the loads are live. Ground truth and state stay those of the last one.

        Parameters
        ----------
        index : int
            Index of the scan.

        Raises
        ------
        ValueError
            `index` is not above the last one.
        """
        if not self.loads.live:
            self._prepare(index)

    def _prepare(self, index: int) -> None:
        if index <= self._now[1]:
            raise ValueError(f"index must be above {self._now[1]}, the last scan, got {index}")
        if index > self._next.last:
            self._next = self._compute(index)
            self._counts = self._readout.counts(index, self._next.outputs)
            self._charge.deactivate_discharged()

    def skip_to(self, index: int, step: float = 0.0) -> None:
        """Let the time pass until the scan before `index`, in `SKIP_STEPS` steps at most.

        Each step takes as long to compute as a scan. Over a gap of more scans loads are piecewise linear between these
        steps, not between scans: for a board in real time. `scan` alone computes a gap of any length as it describes,
        whatever time that takes.

        Parameters
        ----------
        index : int
            Index of the scan that is computed next.
        step : float, default 0.0
            Least duration of a step [s]: more than it takes to compute, lest a board that is late be later afterwards.
        """
        gap = index - 1 - self._end
        steps = min(SKIP_STEPS, math.ceil(gap * self.clock.interval / step)) if step else SKIP_STEPS
        if gap <= steps:
            return
        for left in range(steps, 0, -1):
            target = self._end + math.ceil((index - 1 - self._end) / left)
            if target > self._end:
                self._hold(target, target) if target <= self._constant_end else self._advance(target, target)

    def truth(self) -> Truth:
        """Return the ground truth of the last scan. Thread-safe."""
        batch, index = self._now
        row = index - batch.first
        return Truth(
            sequence=index,
            time=batch.times[row],
            force=batch.force[row],
            chip_temperature=batch.chip[row],
            film_temperature=batch.film[row],
            taxel_status=self._taxels.status,
            loads=self.loads,
        )

    def objects(self, time: float) -> ObjectsState:
        """Return the objects at a time [s] since the board started. Thread-safe."""
        return self.loads.objects(time)

    def volts(self) -> NDArray[np.float64]:
        """Return the follower outputs at the last scan without noise [V], shape [rows * cols]."""
        batch, index = self._now
        return self._readout.volts(batch.active, batch.outputs[index - batch.first])

    def charge(self) -> NDArray[np.float64]:
        """Return the charge density at each gate at the last scan [C/m2], shape [rows * cols]."""
        batch, index = self._now
        charge = np.zeros(self.sensor.layout.taxels)
        charge[batch.active] = batch.charge[1 + index - batch.first]
        return charge

    def _compute(self, index: int) -> _Batch:
        """Advance to scan `index` and, when scans are read consecutively, to more scans after it."""
        constant = index <= self._constant_end
        limit = MAX_BATCH if self._charge.active.size or not constant else BLOCK
        alone = self._compute_all or self.loads.live or index != self._next.last + 1
        self._batch = 1 if alone else min(2 * self._batch, limit)
        self._approach(index)
        last = min(index + self._batch, (index // BLOCK + 1) * BLOCK) - 1
        return self._hold(index, min(last, self._constant_end)) if constant else self._advance(index, last)

    def _approach(self, index: int) -> None:
        """Advance to the scan before `index`, or to the start of constant loads that last until then."""
        if index - self._end > self._memory and self._constant_end < index and not self._changes_at_rest:
            # By then the state before has decayed, and so has the error of a linear force over the jump.
            self._advance(index - self._memory, index - self._memory)
        while self._end < index - 1 and self._constant_end < index:
            if self._constant_end > self._end:
                end = min(self._constant_end, index - 1)
                self._hold(end, end)
            else:
                self._advance(self._end + 1, min(self._end + self._skipped_batch, index - 1))

    def _advance(self, first: int, last: int) -> _Batch:
        """Advance loads, film and charge by several scans in which force or temperature may change."""
        count = last - first + 1
        times = self.clock.times(first, count).tolist()
        steps = self.clock.steps(first, count)
        steps[0] = self.clock.between(self._end, first)
        patches, all_forces = self._forces(times)
        chip = list(self.loads.temperatures(times))
        if self._chip_warming is not None:
            rises = self._chip_warming.respond(all_forces.sum(axis=1)[:, None], steps)
            chip = [each + rise for each, rise in zip(chip, rises[:, 0].tolist(), strict=True)]
        lag, steady = self._film_lags(chip, steps)
        film = [each - behind for each, behind in zip(chip, lag, strict=True)]
        sensed = self._sensors.advance(chip, steps)
        self._charge.activate(patches)
        if not steady:
            self._charge.activate_all()
        charge = self._charge.advance(all_forces, np.array(film) - self._start_temperature, steps)
        self._force, self._chip, self._film_lag, self._end = all_forces[-1], chip[-1], lag[-1], last
        constant_end = self.clock.last_by(self.loads.constant_until(times[-1]))
        settled = self._film_lag == self._sensors.lag == 0.0
        if settled and constant_end > last and not (self._compute_all or self._changes_at_rest):
            self._constant_end = constant_end
        return self._with_outputs(
            _Batch(first, times, all_forces, chip, film, sensed, self._charge.active, charge, charge), steps
        )

    def _forces(self, times: list[float]) -> tuple[Sequence[Patch], NDArray[np.float64]]:
        """Return the patches at several times [s], and the force on every taxel [N], shape [times, rows * cols]."""
        layout = self.sensor.layout
        patches = self.loads.forces(times)
        force = np.zeros((len(times), layout.rows, layout.cols))
        for patch in patches:
            force[:, patch.rows, patch.cols] += patch.force
        force.flags.writeable = False  # a ground truth may keep it
        return patches, force.reshape(len(times), -1)

    def _hold(self, first: int, last: int) -> _Batch:
        """Advance the charge by several scans under constant loads."""
        count = last - first + 1
        times = self.clock.times(first, count).tolist()
        force = np.broadcast_to(self._force, (count, self._force.size))
        chip = [self._chip] * count
        charge = self._charge.decay(self.clock.spans(self._end, first - 1, count + 1))
        self._end = last
        batch = _Batch(first, times, force, chip, chip, chip, self._charge.active, charge, charge)
        return self._with_outputs(batch, self.clock.steps(first, count))

    def _with_outputs(self, batch: _Batch, steps: NDArray[np.float64]) -> _Batch:
        """Return the batch with the outputs of the followers."""
        if self._readout.active is not batch.active:
            self._readout.activate(batch.active)
        return batch._replace(outputs=self._readout.outputs(batch.charge, steps))

    def _film_lags(self, chip: list[float], steps: NDArray[np.float64]) -> tuple[list[float], bool]:
        """Return the lag of the film temperature behind the chip temperature [K], and whether the latter is constant.

        The chip temperature [degC] is linear over each of `steps` [s]. The lag l of a first-order system is exact for
        that: ``l1 = l0 + (slope*tau - l0)*(1 - exp(-h/tau))``.
        """
        time_constant = self.sensor.device.thermal_time_constant
        before, behind = self._chip, self._film_lag
        steady = all(each == before for each in chip)
        if time_constant == 0 or (steady and behind == 0):
            return [0.0] * len(chip), steady
        lag = []
        for each, step in zip(chip, steps.tolist(), strict=True):
            behind -= math.expm1(-step / time_constant) * ((each - before) * time_constant / step - behind)
            if abs(behind) < _NEGLIGIBLE_LAG:
                behind = 0.0
            lag.append(behind)
            before = each
        return lag, False
