"""A readout board with an array on it, as a model: a scene in, scans and their ground truth out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.contact_pressure import SphereOnArray, hertz_sphere
from posfet_driver.scene import Scene
from posfet_model.chain import ForwardChain, leak_step
from posfet_model.checks import whole_number
from posfet_model.scan import Scan, ScanStatus
from posfet_model.sensor import Sensor

SEED_MAX: Final = 1_000_000_000
OVERTEMPERATURE: Final = 85.0
"""Chip temperature above which the board raises its flag [degC]; assumed."""

_MEMORY: Final = 30.0  # time constants after which what was is forgotten: exp(-30) = 1e-13
_FILM_AT_REST: Final = 1e-12  # lag of the film's temperature [K] taken as none: 1e-12 N on a taxel
_NANOSECONDS: Final = 1_000_000_000


@dataclass(frozen=True)
class Truth:
    """What the scene did to the sensor at the time of one scan."""

    sequence: int
    """Number of the scan."""
    force: NDArray[np.float64]
    """Force on each taxel [N], shape [rows * cols], positive when pushed into the sensor."""
    film_temperature: float
    """Temperature of the film [degC]."""
    objects: tuple[str, ...]
    """Names of the scene's objects."""
    positions: NDArray[np.float64]
    """Centre of each object [m], shape [objects, 3], in the frame of the array; an object without force grazes the
    surface."""
    contact_centres: NDArray[np.float64]
    """Centre of pressure of each object that touches [m], shape [touching, 2], whether it falls on a taxel or not."""
    contact_forces: NDArray[np.float64]
    """Normal force of each object that touches [N], shape [touching]."""


class SimulatedBoard:
    """Computes the scans of a board from a scene; the same seed and the same calls give the same bytes.

    Each scan is taken at its index over the scan rate. Between two scans forces and temperature move in a straight
    line, and the leak is exact for that. The film's temperature follows the chip's with the sensor's thermal time
    constant, exactly for a straight line too; both temperature sensors read the chip's.

    Only what the scene needs is computed: while it rests, an array is moved on by one jump when it is next read, and
    one that has leaked out (30 time constants) not at all; its scans then cost their noise and conversion.

    Not simulated: crosstalk other than the cover's spread, mismatch between taxels, dead, stuck and noisy ones,
    dynamics of the amplifier, 1/f noise, mains hum, hysteresis of the film, tangential force, friction and viscosity of
    the cover, error of the temperature sensors, gradients over the chip, the time the converter takes from taxel to
    taxel, clock drift and jitter, lost and torn frames, supply faults, and resets.
    """

    def __init__(self, sensor: Sensor, scene: Scene, seed: int) -> None:
        """Put a fresh board at the beginning of `scene`, read for this `sensor`.

        Raises ValueError for a seed outside [0, 1e9].
        """
        layout = sensor.layout
        self.sensor = sensor
        self.scene = scene
        self.taxel_updates = 0
        """How many times a taxel's charge was moved on so far: the work done, to be held against taxels times scans."""
        self._rate = sensor.can.scan_rate
        self._chain = ForwardChain(sensor, np.random.default_rng(whole_number("seed", seed, 0, SEED_MAX)))
        self._spheres = [
            SphereOnArray(layout, sensor.device.contact_spread, item.radius, item.effective_modulus)
            for item in scene.objects
        ]
        self._forces = np.zeros((layout.rows, layout.cols))
        self._poses: list[tuple[float, ...]] = [(0.0, 0.0, 0.0)] * len(scene.objects)
        (self._chip,) = scene.temperature.at(0.0)
        self._film_lag = 0.0
        self._memory = math.ceil(
            _MEMORY * max(sensor.device.leak_time_constant, sensor.device.thermal_time_constant) * self._rate
        )
        self._index = -1  # of the last scan
        self._charge_index = -1  # scan that the charge was moved on to; behind `_index` while the source rests
        self._rest_end = -1  # scan up to which nothing changes
        self._leaked_out = -1  # scan from which no charge is left of what was before

    @property
    def touched(self) -> bool:
        """Whether an object touched the array in the last scan."""
        return any(force > 0 for _, _, force in self._poses)

    def scan(self, index: int, out: Scan) -> None:
        """Compute scan number `index` into `out`; its stamp counts from the start of the board.

        After a gap the state is the one that every scan in between would have led to, to 1e-12 of full scale. Raises
        ValueError unless `index` is above the last one.
        """
        if index <= self._index:
            raise ValueError(f"index must be above {self._index}, the last scan, got {index}")
        self._move_to(index)
        if self._charge_index < min(index, self._leaked_out):
            self._move_charge(index)
        self._chain.counts(out.counts)
        out.stamp = round(index / self._rate * _NANOSECONDS)
        out.layout_id = self.sensor.layout.id
        out.sequence = index
        out.device_time = round(index / self._rate * 1e6)
        out.temperatures[:] = self._chip
        out.status = ScanStatus.OVERTEMPERATURE if self._chip > OVERTEMPERATURE else ScanStatus.OK

    def truth(self) -> Truth:
        """Return the ground truth of the last scan.

        Another thread may ask, too; while a scan is being computed, the fields may be of two neighbouring scans.
        """
        index = self._index
        time = self.scene.local_time(max(index, 0) / self._rate)
        poses = [item.path.at(time) for item in self.scene.objects]
        positions = np.array(
            [
                (x, y, item.radius - hertz_sphere(force, item.radius, item.effective_modulus).indentation)
                for item, (x, y, force) in zip(self.scene.objects, poses, strict=True)
            ]
        )
        touching = [pose for pose in poses if pose[-1] > 0]
        return Truth(
            sequence=index,
            force=self._forces.ravel(),
            film_temperature=self._chip - self._film_lag,
            objects=tuple(item.name for item in self.scene.objects),
            positions=positions.reshape(-1, 3),
            contact_centres=np.array([pose[:2] for pose in touching]).reshape(-1, 2),
            contact_forces=np.array([pose[-1] for pose in touching]),
        )

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
        if self._charge_index < self._index:
            self._move_charge(self._index)
        step = (index - self._index) / self._rate
        time = index / self._rate
        local = self.scene.local_time(time)
        self._set_forces(local)
        (chip,) = self.scene.temperature.at(local)
        self._set_film(chip, step)
        self._index = index
        self._move_charge(index)
        rest = self.scene.rests_until(time) * self._rate
        if self._film_lag == 0.0 and rest >= index + 1:
            self._rest_end = int(min(rest, 2.0**62))
            self._leaked_out = index + self._memory if self._chain.charge.any() else index

    def _set_forces(self, local: float) -> None:
        """Set the force of each taxel at a time [s] of the scene."""
        poses = [item.path.at(local) for item in self.scene.objects]
        if poses == self._poses:
            return
        self._poses = poses
        forces = np.zeros_like(self._forces)  # not in place: a ground truth may hold the last ones
        for sphere, (x, y, force) in zip(self._spheres, poses, strict=True):
            sphere.add(forces, x, y, force)
        forces.flags.writeable = False
        self._forces = forces

    def _set_film(self, chip: float, step: float) -> None:
        """Let the film's temperature follow the chip's [degC], which moved in a straight line over `step` [s].

        The lag of a first-order follower obeys the equation of the leaking charge, with the chip's temperature as its
        source.
        """
        time_constant = self.sensor.device.thermal_time_constant
        change = chip - self._chip
        self._chip = chip
        if time_constant == 0 or (self._film_lag == 0 and change == 0):
            return
        leak = leak_step(step, time_constant)
        self._film_lag = leak.decay * self._film_lag + leak.mean * change
        if abs(self._film_lag) < _FILM_AT_REST:
            self._film_lag = 0.0

    def _move_charge(self, index: int) -> None:
        """Move the charge on to scan `index` in one step."""
        step = (index - self._charge_index) / self._rate
        self._chain.advance(self._forces.ravel(), self._chip - self._film_lag, step)
        self._charge_index = index
        self.taxel_updates += self._forces.size
