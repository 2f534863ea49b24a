"""A readout board with an array on it, as a model: loads in, scans and their ground truth out."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.validation import whole_number
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.device.ground_truth import Truth
from posfet_sim.device.imperfections import Imperfections
from posfet_sim.device.readout import Readout
from posfet_sim.device.sample_clock import SimClock
from posfet_sim.device.taxel_charge import TaxelCharge
from posfet_sim.device.taxel_variation import draw_spread
from posfet_sim.loads import Loads, ObjectsState

SEED_MAX: Final = 1_000_000_000
OVERTEMPERATURE: Final = 85.0
"""Chip temperature above which the board raises its flag [degC]; assumed."""
LEAST_FORCE: Final = 1e-9
"""Less on a taxel is no touch [N]: the end of a path that rounding left over."""

AHEAD: Final = 32
"""Most scans that are computed at once while something touches."""

_GAP: Final = 16_384  # taxels times scans that are computed at once where nobody reads them
_MEMORY: Final = 30.0  # time constants after which what was is forgotten: exp(-30) = 1e-13
_FILM_AT_REST: Final = 1e-12  # lag of the film's temperature [K] taken as none: 1e-12 N on a taxel
_NANOSECONDS: Final = 1_000_000_000
_OK: Final = int(ScanStatus.OK)
_HOT: Final = int(ScanStatus.OVERTEMPERATURE)


class _Run(NamedTuple):
    """Some scans that were computed at once, one after the other."""

    first: int
    """Number of the first one."""
    times: list[float]
    """When each is taken [s]."""
    force: NDArray[np.float64]
    """Force on each taxel [N], shape [scans, rows * cols]."""
    chip: list[float]
    """Temperature of the chip at each [degC]."""
    film: list[float]
    """Temperature of the film at each [degC]."""
    awake: NDArray[np.intp]
    """Taxels with charge."""
    charge: NDArray[np.float64]
    """Their charge density [C/m2], shape [1 + scans, awake], that of the scan before first."""
    outputs: NDArray[np.float64]
    """What `Readout.outputs` made of it, shape [scans, awake]."""

    @property
    def last(self) -> int:
        """Number of the last one."""
        return self.first + len(self.times) - 1


class SimulatedBoard:
    """Computes the scans of a board from a scene; the same seed gives the same bytes.

    Noise depends on seed and scan number alone. Between two scans forces and temperature move in a straight line, and
    the leak is exact for that. The film's temperature follows the chip's with the sensor's thermal time constant,
    exactly for a straight line too; both temperature sensors read the chip's. What is faster than the scans - lag and
    slew of the followers, their noise above half the scan rate - is folded into them in closed form.

    Only what the scene needs is computed. Taxels without charge sleep and cost nothing but their conversion; while the
    scene rests, the charge is moved on by one jump when it is next read, and once it has leaked out (30 time constants)
    not at all. Scans that are read one after the other are computed ahead, up to 32 at once (64 of a small array at
    rest), in arrays: the first one of them takes the time, or `prepare` before it.

    Not simulated: tangential force as a signal, friction and viscosity of the cover, error of the temperature sensors,
    gradients of temperature over the chip, change of the piezoelectric coefficient with temperature and age, field
    dependence of the permittivity, crosstalk beyond the four neighbours, an anti-aliasing filter, the time the
    converter takes from taxel to taxel, its nonlinearity, supply faults, electromagnetic disturbance other than mains
    hum, a taxel that fails while the board runs, and a clock whose drift changes. Lost, torn and repeated frames and
    resets are put in behind the board, by `sim_faults`.
    """

    def __init__(
        self,
        sensor: Sensor,
        loads: Loads,
        seed: int,
        imperfections: Imperfections | None = None,
        *,
        full: bool = False,
        narrow: bool = False,
    ) -> None:
        """Put a fresh board at the beginning of its `loads`, those of a scene (`SceneLoads`) or any other.

        Without `imperfections` it has none. For comparison, `full` computes every taxel in every scan, and `narrow`
        computes charge and read-out in float32. Raises ValueError for a seed outside [0, 1e9].
        """
        seed = whole_number("seed", seed, 0, SEED_MAX)
        self.sensor = sensor
        self.loads = loads
        self.imperfections = imperfections or Imperfections.none()
        self.clock = SimClock(
            sensor.can.scan_rate, self.imperfections.clock_drift, self.imperfections.clock_jitter, seed
        )
        """When the scans are taken."""
        spread = draw_spread(sensor, self.imperfections, seed)
        self._spread = spread.narrow() if narrow else spread
        self._charge = TaxelCharge(sensor, self._spread, self.imperfections.hysteresis, full)
        self._readout = Readout(sensor, self.imperfections, self._spread, self.clock, seed)
        self._readout.wake(self._charge.awake)
        self._full = full
        self._start_temperature = self._chip = self.loads.temperatures([0.0])[0]
        self._film_lag = 0.0
        self._force = np.zeros(sensor.layout.taxels)
        self._memory = math.ceil(
            _MEMORY
            * max(self._spread.leak_time_constant.max(), sensor.device.thermal_time_constant)
            / self.clock.interval
        )
        self._end = -1  # last scan that scene, film and charge were moved on to
        self._rest_end = -1  # scan up to which nothing changes
        self._ahead = 1  # scans that are computed at once
        self._gap = max(_GAP // sensor.layout.taxels, AHEAD)  # the same where nobody reads them
        nothing, charge = np.zeros((1, sensor.layout.taxels)), np.zeros((2, self._charge.awake.size))
        chip = [self._chip]
        start = _Run(-1, [self.clock.time(0)], nothing, chip, chip, self._charge.awake, charge, charge)
        self._next = self._read_out(start, self.clock.steps(-1, 1))
        self._counts = self._readout.counts(0, self._next.outputs)  # of `_next`
        self._now = self._next, -1  # the run of the last scan, and its number

    @property
    def taxel_updates(self) -> int:
        """How many times a taxel's charge was moved on so far: the work done, to be held against taxels times scans."""
        return self._charge.updates

    @property
    def index(self) -> int:
        """Number of the last scan; -1 before the first."""
        return self._now[1]

    @property
    def time(self) -> float:
        """When the last scan was taken [s] since the board started. Another thread may ask, too."""
        run, index = self._now
        return run.times[index - run.first]

    @property
    def touched(self) -> bool:
        """Whether an object pressed on a taxel in the last scan."""
        run, index = self._now
        return bool(run.force[index - run.first].max() > LEAST_FORCE)

    @property
    def taxel_status(self) -> NDArray[np.uint8]:
        """What is wrong with each taxel (TaxelStatus), shape [rows * cols]."""
        return self._spread.status

    def scan(self, index: int, out: Scan) -> None:
        """Compute scan number `index` into `out`; its stamp counts from the start of the board.

        After a gap the state is the one that every scan in between would have led to, to 1e-12 of full scale; only
        the film's hysteresis forgets what was more than 30 time constants before. Raises ValueError unless `index` is
        above the last one.
        """
        self.prepare(index)
        run = self._next
        self._now = run, index
        row = index - run.first
        out.counts[:] = self._counts[row]
        out.stamp = round(run.times[row] * _NANOSECONDS)
        out.layout_id = self.sensor.layout.id
        out.sequence = index
        out.device_time = round(index / self.sensor.can.scan_rate * 1e6)
        out.temperatures[:] = run.chip[row]
        out.status = _HOT if run.chip[row] > OVERTEMPERATURE else _OK

    def prepare(self, index: int) -> None:
        """Compute what scan number `index` needs, while there is time. Truth and state stay those of the last scan.

        Raises ValueError as `scan` does.
        """
        if index <= self._now[1]:
            raise ValueError(f"index must be above {self._now[1]}, the last scan, got {index}")
        if index > self._next.last:
            self._next = self._compute(index)
            self._counts = self._readout.counts(index, self._next.outputs)
            self._charge.sleep()

    def truth(self) -> Truth:
        """Return the ground truth of the last scan. Another thread may ask, too."""
        run, index = self._now
        row = index - run.first
        return Truth(
            sequence=index,
            time=run.times[row],
            force=run.force[row],
            chip_temperature=run.chip[row],
            film_temperature=run.film[row],
            taxel_status=self._spread.status,
            objects=self.loads.objects(run.times[row]),
        )

    def objects(self, time: float) -> ObjectsState:
        """Return what the objects did at a time [s] since the board started. Another thread may ask, too."""
        return self.loads.objects(time)

    def volts(self) -> NDArray[np.float64]:
        """Return what the followers put out at the last scan, without noise [V], shape [rows * cols]."""
        run, index = self._now
        return self._readout.volts(run.awake, run.outputs[index - run.first])

    def charge(self) -> NDArray[np.float64]:
        """Return the charge density at each gate at the last scan [C/m2], shape [rows * cols]."""
        run, index = self._now
        charge = np.zeros(self.sensor.layout.taxels)
        charge[run.awake] = run.charge[1 + index - run.first]
        return charge

    def _compute(self, index: int) -> _Run:
        """Move on to scan `index` and, when scans are read one after the other, to more behind it."""
        resting, block = index <= self._rest_end, self._readout.block
        most = AHEAD if self._charge.awake.size or not resting else block
        self._ahead = min(2 * self._ahead, most) if index == self._next.last + 1 and not self._full else 1
        self._move_near(index)
        last = min(index + self._ahead, (index // block + 1) * block) - 1
        return self._rest(index, min(last, self._rest_end)) if resting else self._advance(index, last)

    def _move_near(self, index: int) -> None:
        """Move on to the scan before `index`, or as far as the rest that lasts until then."""
        if index - self._end > self._memory and self._rest_end < index:
            # Whatever was before is forgotten by then; the straight line over the jump is, too.
            self._advance(index - self._memory, index - self._memory)
        while self._end < index - 1 and self._rest_end < index:
            if self._rest_end > self._end:
                end = min(self._rest_end, index - 1)
                self._rest(end, end)
            else:
                self._advance(self._end + 1, min(self._end + self._gap, index - 1))

    def _advance(self, first: int, last: int) -> _Run:
        """Move scene, film and charge on to some scans, at which forces or temperature may differ from the last."""
        count, layout = last - first + 1, self.sensor.layout
        times = self.clock.times(first, count).tolist()
        steps = self.clock.steps(first, count)
        steps[0] = self.clock.between(self._end, first)
        patches = self.loads.forces(times)
        force = np.zeros((count, layout.rows, layout.cols))
        for patch in patches:
            force[:, patch.rows, patch.cols] += patch.force
        force.flags.writeable = False  # a ground truth may hold it
        chip = list(self.loads.temperatures(times))
        lag, steady = self._follow(chip, steps)
        film = [each - behind for each, behind in zip(chip, lag, strict=True)]
        self._charge.wake(patches)
        if not steady:
            self._charge.wake_all()
        all_forces = force.reshape(count, -1)
        charge = self._charge.advance(all_forces, np.array(film) - self._start_temperature, steps)
        self._force, self._chip, self._film_lag, self._end = all_forces[-1], chip[-1], lag[-1], last
        rest = self.clock.last_by(self.loads.rests_until(times[-1]))
        if self._film_lag == 0.0 and rest > last and not self._full:
            self._rest_end = rest
        return self._read_out(_Run(first, times, all_forces, chip, film, self._charge.awake, charge, charge), steps)

    def _rest(self, first: int, last: int) -> _Run:
        """Move the charge on to some scans while the scene rests."""
        count = last - first + 1
        times = self.clock.times(first, count).tolist()
        force = np.broadcast_to(self._force, (count, self._force.size))
        chip = [self._chip] * count
        charge = self._charge.rest(self.clock.spans(self._end, first - 1, count + 1))
        self._end = last
        run = _Run(first, times, force, chip, chip, self._charge.awake, charge, charge)
        return self._read_out(run, self.clock.steps(first, count))

    def _read_out(self, run: _Run, steps: NDArray[np.float64]) -> _Run:
        """Return the run with the followers' outputs."""
        if self._readout.awake is not run.awake:
            self._readout.wake(run.awake)
        return run._replace(outputs=self._readout.outputs(run.charge, steps))

    def _follow(self, chip: list[float], steps: NDArray[np.float64]) -> tuple[list[float], bool]:
        """Return the lag of the film's temperature behind the chip's [K], and whether that is steady.

        The chip's [degC] moves in straight lines over `steps` [s]. The lag l of a first-order follower is exact for
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
            if abs(behind) < _FILM_AT_REST:
                behind = 0.0
            lag.append(behind)
            before = each
        return lag, False
