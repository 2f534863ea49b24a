# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The stand on which a board of the independent plant is calibrated: what `posfet calibrate` is given and does.

The programme is that of docs/contacts.md, calibration at the bench: a ball presses each taxel with a known force, the
chip is cooled and warmed, a light touch, a long hold, rest. The stand tells the place of the ball and its force, with
noise and by a clock of its own; the shares of the taxels follow from the sensor file, not from the cover of the plant.
"""

from __future__ import annotations

import zlib
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from independent.contacts import CoverName, Scene, Touch, course, sphere
from independent.film import Array, Board, Effects, Load
from posfet_model.calibration.bench_signals import Recording
from posfet_model.calibration.calibration_file import load_calibration, save_calibration
from posfet_model.calibration.least_squares_fit import fit
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor
from posfet_sim.calibration.bench_recording import Reference, Scans, combine, interpolated_temperature
from posfet_sim.contact.indenters import Sphere

BALL_RADIUS: Final = 2e-3
"""Radius of the ball [m]: the default of `posfet calibrate`."""
BALL_MODULUS: Final = 4e6
"""Effective modulus of ball and cover [Pa]: the default of `posfet calibrate`."""
PRESS_FORCE: Final = 2.0
"""[N]; docs/contacts.md."""
LIGHT_FORCE: Final = 0.25
"""[N]; docs/contacts.md."""
READING_RATE: Final = 200.0
"""Readings of the load cell per second [Hz]; docs/contacts.md asks for 100 or more."""
READING_NOISE: Final = 1e-3
"""Standard deviation of a reading of the load cell [N], assumed."""
CLOCK_DELAY: Final = 0.012
"""Delay of the clock of the stand [s], assumed; docs/contacts.md allows half a second."""
_RISE: Final = 0.1
_RECORDING: Final = 999
"""Number of the recording, which no scene has."""


def programme(sensor: Sensor) -> Scene:
    """Return what happens on the stand.

    Parameters
    ----------
    sensor : Sensor
        Sensor file.

    Returns
    -------
    Scene
        Presses of 0.8 s, or of two leakage time constants if that is longer, and pauses as long; after 2 s, or six time
        constants, the chip 1.5 K down, 3 K up and back within 8 s; a light touch of 3 s; a hold of 40 s; rest.
    """
    ball = sphere(BALL_RADIUS, BALL_MODULUS)
    positions = sensor.layout.positions

    def touch(taxel: int, begin: float, lasting: float, force: float) -> Touch:
        knots = [(begin, 0.0), (begin + _RISE, force), (begin + lasting - _RISE, force), (begin + lasting, 0.0)]
        x, y = positions[taxel]
        return Touch(ball, knots, ((0.0, float(x)),), ((0.0, float(y)),))

    press = max(0.8, 2.0 * sensor.device.leak_time_constant)
    middle, time = sensor.layout.taxels // 2, 2.0
    touches = []
    for taxel in range(sensor.layout.taxels):
        touches.append(touch(taxel, time, press, PRESS_FORCE))
        time += 2.0 * press
    time += max(2.0, 6.0 * sensor.device.leak_time_constant - press)
    chip = [(0.0, 0.0), (time, 0.0), (time + 2.0, -1.5), (time + 6.0, 1.5), (time + 8.0, 0.0)]
    time += 11.0
    touches.append(touch(middle, time, 3.0, LIGHT_FORCE))
    time += 6.0
    touches.append(touch(middle, time, 40.0, PRESS_FORCE))
    return Scene("stand", time + 55.0, tuple(touches), chip)


def readings(sensor: Sensor, seed: int) -> tuple[Array, Array]:
    """Return what the stand writes down.

    Parameters
    ----------
    sensor : Sensor
        Sensor file.
    seed : int
        Seed of the noise of the load cell.

    Returns
    -------
    tuple of ndarray
        Times by the clock of the stand [s], shape [readings]; x [m], y [m] and force [N], shape [3, readings].
    """
    scene = programme(sensor)
    time = np.arange(int(scene.duration * READING_RATE) + 1) / READING_RATE
    values = np.zeros((3, len(time)))
    for touch in scene.touches:
        begin, end = touch.force[0][0], touch.force[-1][0]
        during = (time >= begin - 0.3) & (time <= end + 0.3)
        values[0, during], values[1, during] = touch.x[0][1], touch.y[0][1]
        values[2] += course(touch.force, time)
    values[2] += READING_NOISE * np.random.default_rng([seed, 4]).standard_normal(len(time))
    values[2] = np.maximum(values[2], 0.0)
    return time + CLOCK_DELAY, values


def calibrate(board: Board, cover: CoverName, crosstalk: float = 0.0) -> Calibration:
    """Return the calibration of a board on its own stand.

    Parameters
    ----------
    board : Board
        The board.
    cover : str
        Its cover: gauss, layer or half_space.
    crosstalk : float, default 0.0
        Share of the signal of each of its four neighbours that a taxel picks up [1].

    Returns
    -------
    Calibration
        The calibration that `posfet calibrate` fits.

    Raises
    ------
    ValueError
        The fit is refused.
    """
    return fit(board.sensor, recorded(board, cover, crosstalk)[0], "2026-01-01")


def recorded(board: Board, cover: CoverName, crosstalk: float = 0.0) -> tuple[Recording, float]:
    """Return what a board records on its stand, and the delay of the stand's clock that is found in it [s].

    Parameters
    ----------
    board : Board
        The board.
    cover : str
        Its cover: gauss, layer or half_space.
    crosstalk : float, default 0.0
        Share of the signal of each of its four neighbours that a taxel picks up [1].

    Returns
    -------
    tuple of (Recording, float)
        As `posfet calibrate` makes them of a recording and the readings of a rig.
    """
    sensor = board.sensor
    load = programme(sensor).load(sensor, cover, board.seed)
    load = Load(load.force, load.applied, load.chip, on_stand=True)
    recording = board.record(load, _RECORDING)
    time = recording.index / sensor.can.scan_rate
    temperature = interpolated_temperature(time, recording.temperatures.mean(axis=1, dtype=np.float64))
    scans = Scans(time, _with_crosstalk(sensor, recording.counts, crosstalk), temperature)
    reference = Reference(*readings(sensor, board.seed))
    return combine(sensor, scans, reference, Sphere(BALL_RADIUS, BALL_MODULUS))


def _with_crosstalk(sensor: Sensor, counts: NDArray[np.uint16], share: float) -> NDArray[np.uint16]:
    """Return the counts of a board whose taxels pick up a share of the signals of their neighbours."""
    if share == 0.0:
        return counts
    near = np.hypot(*(sensor.layout.positions[:, None] - sensor.layout.positions).T) < 1.1 * sensor.layout.pitch_x
    at_rest = counts[:500].mean(axis=0)
    picked_up = share * (counts - at_rest) @ (near & ~np.eye(len(near), dtype=np.bool_))
    return np.rint(counts + picked_up).astype(np.uint16)


def calibration_of(board: Board, cover: CoverName, folder: Path | None = None) -> Calibration:
    """Return the calibration of a board, from a file if there is one.

    Parameters
    ----------
    board : Board
        The board.
    cover : str
        Its cover: gauss, layer or half_space.
    folder : Path, optional
        Folder of files, which are made as needed; None: no files.

    Returns
    -------
    Calibration
        The calibration.
    """
    if folder is None:
        return calibrate(board, cover)
    law = "" if type(board) is Board else f"{type(board).__name__}-"
    file = folder / f"{cover}-{board.seed}-{law}{_name(board.effects)}.yaml"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        save_calibration(file, board.sensor, calibrate(board, cover))
    return load_calibration(file, board.sensor)


def _name(effects: Effects) -> str:
    """Return a short name of what is not 0."""
    effects = replace(effects, drift=0.0, drift_under_way=False, gain_drift=0.0)  # none on the stand
    changed = {name: value for name, value in vars(effects).items() if value != getattr(Effects(), name)}
    return "_".join(changed)[:60] + f"-{zlib.crc32(repr(effects).encode()):08x}"
