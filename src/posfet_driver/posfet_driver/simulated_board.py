"""A readout board with an array on it, as a model: a scene in, scans and their ground truth out."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.imperfections import Imperfections
from posfet_driver.scene import Scene, SceneLoads
from posfet_driver.sim_charge import TaxelCharge
from posfet_driver.sim_clock import SimClock
from posfet_driver.sim_readout import Readout
from posfet_driver.sim_spread import draw_spread
from posfet_driver.truth import Truth
from posfet_model.checks import whole_number
from posfet_model.scan import Scan, ScanStatus
from posfet_model.sensor import Sensor

SEED_MAX: Final = 1_000_000_000
OVERTEMPERATURE: Final = 85.0
"""Chip temperature above which the board raises its flag [degC]; assumed."""
LEAST_FORCE: Final = 1e-9
"""Less on a taxel is no touch [N]: the end of a path that rounding left over."""

_MEMORY: Final = 30.0  # time constants after which what was is forgotten: exp(-30) = 1e-13
_FILM_AT_REST: Final = 1e-12  # lag of the film's temperature [K] taken as none: 1e-12 N on a taxel
_NANOSECONDS: Final = 1_000_000_000
_OK: Final = int(ScanStatus.OK)
_HOT: Final = int(ScanStatus.OVERTEMPERATURE)


class SimulatedBoard:
    """Computes the scans of a board from a scene; the same seed gives the same bytes.

    Noise depends on seed and scan number alone. Between two scans forces and temperature move in a straight line, and
    the leak is exact for that. The film's temperature follows the chip's with the sensor's thermal time constant,
    exactly for a straight line too; both temperature sensors read the chip's. What is faster than the scans - lag and
    slew of the followers, their noise above half the scan rate - is folded into them in closed form.

    Only what the scene needs is computed. Taxels without charge sleep and cost nothing but their conversion; while the
    scene rests, the charge is moved on by one jump when it is next read, and once it has leaked out (30 time constants)
    not at all. Scans of a scene at rest are converted many at once.

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
        scene: Scene,
        seed: int,
        imperfections: Imperfections | None = None,
        *,
        full: bool = False,
    ) -> None:
        """Put a fresh board at the beginning of `scene`, read for this `sensor`.

        Without `imperfections` it has none. `full` computes every taxel in every scan, to check what is left out
        otherwise. Raises ValueError for a seed outside [0, 1e9].
        """
        seed = whole_number("seed", seed, 0, SEED_MAX)
        self.sensor = sensor
        self.scene = scene
        self.imperfections = imperfections or Imperfections.none()
        self.clock = SimClock(
            sensor.can.scan_rate, self.imperfections.clock_drift, self.imperfections.clock_jitter, seed
        )
        """When the scans are taken."""
        self._loads = SceneLoads(scene, sensor)
        self._spread = draw_spread(sensor, self.imperfections, seed)
        self._charge = TaxelCharge(sensor, self._spread, self.imperfections.hysteresis, full)
        self._readout = Readout(sensor, self.imperfections, self._spread, self.clock, seed)
        self._readout.wake(sensor.layout.rows, sensor.layout.cols, self._charge.awake)
        self._full = full
        self._chip = self._start_temperature = self._loads.temperature(0.0)
        self._film_lag = 0.0
        self._memory = math.ceil(
            _MEMORY
            * max(self._spread.leak_time_constant.max(), sensor.device.thermal_time_constant)
            / self.clock.interval
        )
        self._index = -1  # of the last scan
        self._charge_index = -1  # scan that the charge was moved on to; behind `_index` while the source rests
        self._rest_end = -1  # scan up to which nothing changes

    @property
    def taxel_updates(self) -> int:
        """How many times a taxel's charge was moved on so far: the work done, to be held against taxels times scans."""
        return self._charge.updates

    @property
    def touched(self) -> bool:
        """Whether an object pressed on a taxel in the last scan."""
        return bool(self._charge.force.max() > LEAST_FORCE)

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
        if index <= self._index:
            raise ValueError(f"index must be above {self._index}, the last scan, got {index}")
        if index > self._rest_end or self._charge.awake.size or self._full:
            self._move_to(index)
            self._bring_up_charge()
        self._index = index
        resting = not self._charge.awake.size and index < self._rest_end
        self._readout.counts(index, out.counts, resting=resting)
        out.stamp = round(self.clock.time(index) * _NANOSECONDS)
        out.layout_id = self.sensor.layout.id
        out.sequence = index
        out.device_time = round(index / self.sensor.can.scan_rate * 1e6)
        out.temperatures[:] = self._chip
        out.status = _HOT if self._chip > OVERTEMPERATURE else _OK

    def truth(self) -> Truth:
        """Return the ground truth of the last scan.

        Another thread may ask, too; while a scan is being computed, the fields may be of two neighbouring scans.
        """
        index = self._index
        time = self.clock.time(max(index, 0))
        return Truth(
            sequence=index,
            time=time,
            force=self._charge.force.ravel(),
            chip_temperature=self._chip,
            film_temperature=self._chip - self._film_lag,
            taxel_status=self._spread.status,
            objects=self._loads.objects(time),
        )

    def volts(self) -> NDArray[np.float64]:
        """Return what the followers put out at the last scan, without noise [V], shape [rows * cols]."""
        return self._readout.volts()

    def charge(self) -> NDArray[np.float64]:
        """Return the charge density at each gate at the last scan [C/m2], shape [rows * cols]."""
        return self._charge.all_charge()

    def _move_to(self, index: int) -> None:
        """Move the scene and the film on to scan `index`, over what rests in one jump, else scan by scan."""
        if index - self._index > self._memory and self._rest_end < index:
            # Whatever was before is forgotten by then; the straight line over the jump is, too.
            self._step(index - self._memory)
        while self._index < index:
            if self._rest_end > self._index:
                self._index = min(index, self._rest_end)
            else:
                self._step(self._index + 1)

    def _step(self, index: int) -> None:
        """Move scene, film and charge on to scan `index`, at which forces or temperature may differ from the last."""
        self._bring_up_charge()
        time = self.clock.time(index)
        step = self.clock.between(self._charge_index, index)
        self._set_film(self._loads.temperature(time), step)
        woken = self._charge.load(self._loads.forces(time))
        woken |= self._charge.warm(self._chip - self._film_lag - self._start_temperature)
        if woken:
            self._readout.wake(self.sensor.layout.rows, self.sensor.layout.cols, self._charge.awake)
        self._move_charge(index, resting=False)
        self._index = index
        rest = self.clock.last_by(self._loads.rests_until(time))
        if self._film_lag == 0.0 and rest > index and not self._full:
            self._rest_end = rest

    def _set_film(self, chip: float, step: float) -> None:
        """Let the film's temperature follow the chip's [degC], which moved in a straight line over `step` [s].

        The lag l of a first-order follower is exact for that: ``l1 = l0 + (slope*tau - l0)*(1 - exp(-h/tau))``.
        """
        time_constant = self.sensor.device.thermal_time_constant
        change = chip - self._chip
        self._chip = chip
        if time_constant == 0 or (self._film_lag == 0 and change == 0):
            return
        lost = -math.expm1(-step / time_constant)
        self._film_lag += lost * (change * time_constant / step - self._film_lag)
        if abs(self._film_lag) < _FILM_AT_REST:
            self._film_lag = 0.0

    def _bring_up_charge(self) -> None:
        """Move the charge on over what rested, in one jump, to the last scan."""
        if self._charge_index < self._index:
            self._move_charge(self._index, resting=True)

    def _move_charge(self, index: int, *, resting: bool) -> None:
        """Move the charge on to scan `index` in one step."""
        if self._charge.awake.size:
            step = self.clock.between(self._charge_index, index)
            asleep = self._charge.advance(step, resting=resting)
            if asleep:
                self._readout.wake(self.sensor.layout.rows, self.sensor.layout.cols, self._charge.awake)
            self._readout.take(self._charge.charge, step)
        self._charge_index = index
