# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sensor and bus from the options of `posfet can`."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final, TypeAlias

from posfet_driver.bus.open_bus import BusSettings, bus_settings
from posfet_driver.clock import Clock
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor, load_sensor, with_frames

EMULATOR: Final = "emulator"
"""Interface of a simulated board behind an emulated adapter, which runs for the duration of one command."""

Emulator: TypeAlias = Callable[[Sensor, str, Clock], AbstractContextManager[None]]
"""Serves a simulated board of a sensor behind an emulated slcan adapter at a path, in the time of a clock."""


def sensor_of(options: argparse.Namespace) -> Sensor:
    """Return the sensor of the options. Raises ConfigError, one line, for an invalid file."""
    return with_frames(load_sensor(options.sensor), options.fd)


@contextmanager
def bus_of(options: argparse.Namespace) -> Iterator[tuple[Sensor, BusSettings]]:
    """Yield sensor and bus settings of the options; an emulated board runs while the block does.

    Parameters
    ----------
    options : argparse.Namespace
        Options of `posfet can`.

    Yields
    ------
    tuple of Sensor and BusSettings
        The sensor, with the bit rates of the options, and its bus.

    Raises
    ------
    ConfigError
        For an option or file that cannot be used; one line.
    """
    sensor = sensor_of(options)
    if options.interface != EMULATOR:
        channel = options.channel or ("can0" if options.interface == "socketcan" else "")
        yield _with_rates(sensor, _settings(options, sensor, options.interface, channel))
        return
    if options.emulator is None:
        raise ConfigError(f"{EMULATOR}: no simulated board is available here: use `posfet can`")
    with tempfile.TemporaryDirectory(prefix="posfet-") as folder:
        channel = str(Path(folder) / "can0")
        sensor, settings = _with_rates(sensor, _settings(options, sensor, "slcan", channel))
        with options.emulator(sensor, channel, options.clock):
            yield sensor, settings


def _with_rates(sensor: Sensor, settings: BusSettings) -> tuple[Sensor, BusSettings]:
    """Return the sensor with the bit rates of the bus, and the settings."""
    link = replace(sensor.can, bitrate=settings.bitrate, data_bitrate=settings.data_bitrate)
    return replace(sensor, can=link), settings


def _settings(options: argparse.Namespace, sensor: Sensor, interface: str, channel: str) -> BusSettings:
    return bus_settings(
        interface,
        channel,
        sensor.can,
        bitrate=options.bitrate,
        data_bitrate=options.data_bitrate,
        options=options.option,
    )
