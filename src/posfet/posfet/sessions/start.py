# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sessions by name: `simulate`, `open_board` and `replay`; and `load`, a recording as arrays."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

from posfet.sessions.feeds import Feed, RecordedFeed, SimulatedFeed
from posfet.sessions.session import Session
from posfet_model._lib.validation import real_number
from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import DEFAULT_SENSOR, Sensor, load_sensor, with_serial
from posfet_sim.defaults import DEFAULT
from posfet_sim.device.error_model import ErrorModel, load_error_model
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.recording.export import Export, to_arrays
from posfet_sim.recording.recorded_scans import RecordedScans
from posfet_sim.scene import DEFAULT_SCENE, Scene, SceneLoads, load_scene

FileName: TypeAlias = "str | os.PathLike[str]"
STATIC_DURATION: Final = 10.0
"""Duration of a scene that never changes [s]."""
TIMEOUT: Final = 5.0
"""Default longest time without a scan of a real board [s]."""


def simulate(
    scene: str | Path | Scene = DEFAULT_SCENE,
    *,
    sensor: FileName | Sensor = DEFAULT_SENSOR,
    duration: float | None = None,
    seed: int = 0,
    imperfections: FileName | ErrorModel = DEFAULT,
    calibration: FileName | Calibration | None = None,
    settings: ReconstructionSettings | None = None,
) -> Session:
    """Simulate a board on which a scene plays, faster than real time; the same seed gives the same scans.

    Parameters
    ----------
    scene : str, Path or Scene, default "press_slide_lift"
        What touches: name of a shipped scene (docs/scenes.md), YAML file, or scene.
    sensor : str, Path or Sensor, default "posfet_5x5"
        Name of a shipped sensor (posfet_5x5, posfet_16x16, posfet_32x32), YAML file, or description.
    duration : float, optional
        Simulated time [s]; default: once through the scene; inf: endless.
    seed : int, default 0
        Seed of noise and device variation, in [0, 1e9].
    imperfections : str, Path or ErrorModel, default "default"
        Sensor error model: none, default, moderate, hard, YAML file, or error model.
    calibration : str, Path or Calibration, optional
        Calibration or its file; default: nominal parameters.
    settings : ReconstructionSettings, optional
        Settings of the model; default: those of the sensor.

    Returns
    -------
    Session
        The session, with ground truth.

    Raises
    ------
    ConfigError
        A file or name cannot be used; one line.
    ValueError
        An argument is out of range; one line.

    Examples
    --------
    >>> import posfet
    >>> for contacts in posfet.simulate("press_slide_lift", seed=1).contacts():
    ...     if contacts.valid and len(contacts):
    ...         print(f"first contact after {contacts.time:.2f} s")
    ...         break
    first contact after 0.34 s
    """
    described = _sensor(sensor)
    loaded = scene if isinstance(scene, Scene) else load_scene(scene, described)
    length = loaded.duration or STATIC_DURATION if duration is None else duration
    length = length if length == float("inf") else real_number("duration", length, 0.0, exclusive=True)
    board = SimulatedBoard(described, SceneLoads(loaded, described), seed, _error_model(imperfections))
    return _session(SimulatedFeed(board, length, seed), calibration, settings)


def open_board(
    address: str,
    *,
    sensor: FileName | Sensor = DEFAULT_SENSOR,
    serial: str = "",
    bitrate: int = 0,
    data_bitrate: int = 0,
    options: Mapping[str, object] | None = None,
    timeout: float = TIMEOUT,
    calibration: FileName | Calibration | None = None,
    settings: ReconstructionSettings | None = None,
    seed: int = 0,
    imperfections: FileName | ErrorModel = DEFAULT,
) -> Session:
    """Open a board on a CAN bus, and return when it sends scans; `posfet.open`. Needs the package python-can.

    Every scan is delivered in order. A caller that takes longer than the board's scan period for long loses frames,
    which `Session.state` counts. After faults of bus and board the driver reconnects by itself.

    Parameters
    ----------
    address : str
        ``interface:channel``, such as ``slcan:/dev/ttyACM0``, ``socketcan:can0`` or any other interface of python-can;
        ``emulator:SCENE`` is a simulated board behind an emulated slcan adapter, in real time.
    sensor : str, Path or Sensor, default "posfet_5x5"
        Name of a shipped sensor, YAML file, or description.
    serial : str, default ""
        Serial number, where sensors share a sensor file.
    bitrate, data_bitrate : int, default 0
        Bit rates of the bus and of the data phase of CAN FD [bit/s]; 0: as in the sensor file.
    options : mapping of str to object, optional
        Further arguments of the interface.
    timeout : float, default 5
        Longest time without a scan [s].
    calibration : str, Path or Calibration, optional
        Calibration or its file; default: nominal parameters.
    settings : ReconstructionSettings, optional
        Settings of the model; default: those of the sensor.
    seed : int, default 0
        Of an emulated board: seed of noise and device variation.
    imperfections : str, Path or ErrorModel, default "default"
        Of an emulated board: sensor error model.

    Returns
    -------
    Session
        The session; close it, or use it as a context manager.

    Raises
    ------
    ConfigError
        Address, sensor or option cannot be used; one line.
    SourceError
        No scan arrived in time; one line with the state of bus and board.
    """
    try:
        from posfet.sessions.board_feed import EMULATOR, BoardFeed, bus_of, emulated_feed  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise ConfigError(f"{address}: needs the package {error.name}: pip install python-can") from error
    described = with_serial(_sensor(sensor), serial)
    seconds = real_number("timeout", timeout, 0.0, exclusive=True)
    calibrated = _calibration(calibration, described)
    interface, _, channel = address.partition(":")
    if interface == EMULATOR:
        feed = emulated_feed(described, channel, seed, _error_model(imperfections), seconds)
    else:
        feed = BoardFeed(described, bus_of(address, described, bitrate, data_bitrate, options or {}), seconds)
    session = _session(feed, calibrated, settings)
    feed.open()
    return session


def replay(
    path: FileName,
    *,
    sensor: FileName | Sensor = DEFAULT_SENSOR,
    serial: str = "",
    topic: str = "",
    calibration: FileName | Calibration | None = None,
    settings: ReconstructionSettings | None = None,
) -> Session:
    """Run the raw scans of a recording through the model again, as fast as possible; needs the package mcap.

    Parameters
    ----------
    path : str or Path
        MCAP file of `Session.record`, posfet record, posfet sim or ros2 bag.
    sensor : str, Path or Sensor, default "posfet_5x5"
        Name of a shipped sensor, YAML file, or description.
    serial : str, default ""
        Serial number, where sensors share a sensor file.
    topic : str, default ""
        Topic of the scans, such as /hand/thumb/raw; '': the only one.
    calibration : str, Path or Calibration, optional
        Calibration or its file; default: nominal parameters.
    settings : ReconstructionSettings, optional
        Settings of the model; default: those of the sensor.

    Returns
    -------
    Session
        The session; with ground truth where it was recorded.

    Raises
    ------
    ConfigError
        A file cannot be used, or has no scans of this sensor; one line.
    """
    described = with_serial(_sensor(sensor), serial)
    recorded = RecordedScans(Path(path), described, topic)
    return _session(RecordedFeed(recorded, described), calibration, settings)


def load(path: FileName, topics: Sequence[str] = ()) -> dict[str, Any]:
    """Return the messages of a recording as they were recorded, as arrays by name; needs the package mcap.

    Parameters
    ----------
    path : str or Path
        MCAP file.
    topics : sequence of str, optional
        Topics, in full or as their last parts, such as contacts; default: all.

    Returns
    -------
    dict of str to ndarray
        One array for each field, such as ``tactile/raw/counts``, with one row for each message, in the units of the
        message; times in ns (docs/recording.md, Export).

    Raises
    ------
    ConfigError
        The file cannot be read, or has no such topic; one line.
    """
    return to_arrays(Export(Path(path), topics))


def _session(
    feed: Feed,
    calibration: FileName | Calibration | None,
    settings: ReconstructionSettings | None,
) -> Session:
    return Session(feed, Reconstructor(feed.sensor, _calibration(calibration, feed.sensor), settings))


def _sensor(sensor: FileName | Sensor) -> Sensor:
    return sensor if isinstance(sensor, Sensor) else load_sensor(Path(sensor))


def _error_model(imperfections: FileName | ErrorModel) -> ErrorModel:
    return imperfections if isinstance(imperfections, ErrorModel) else load_error_model(Path(imperfections))


def _calibration(calibration: FileName | Calibration | None, sensor: Sensor) -> Calibration | None:
    if calibration is None or isinstance(calibration, Calibration):
        return calibration
    return load_calibration(Path(calibration), sensor)
