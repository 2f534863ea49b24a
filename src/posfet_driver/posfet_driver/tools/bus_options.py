"""Which sensor and bus the options of `posfet can` name."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Final, TypeAlias

from posfet_driver.bus.open_bus import BusSettings, bus_settings
from posfet_driver.clock import Clock
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor, load_sensor, with_frames

EMULATOR: Final = "emulator"
"""The interface that is a simulated board behind an emulated adapter, started for the time of one command."""

Emulator: TypeAlias = Callable[[Sensor, str, Clock], AbstractContextManager[None]]
"""Serves a simulated board of a sensor behind an emulated slcan adapter at a path, by a clock, while its block runs."""


def sensor_of(options: argparse.Namespace) -> Sensor:
    """Return the sensor that the options name. Raises ConfigError, one line, for a bad file."""
    return with_frames(load_sensor(options.sensor), options.fd)


@contextmanager
def bus_of(options: argparse.Namespace) -> Iterator[tuple[Sensor, BusSettings]]:
    """Yield sensor and bus settings that the options name; an emulated board lives as long as the block.

    Raises ConfigError, one line, for what cannot be used.
    """
    sensor = sensor_of(options)
    if options.interface != EMULATOR:
        channel = options.channel or ("can0" if options.interface == "socketcan" else "")
        yield sensor, _settings(options, sensor, options.interface, channel)
        return
    if options.emulator is None:
        raise ConfigError(f"{EMULATOR}: there is no simulated board here: use `posfet can`, which has one")
    with tempfile.TemporaryDirectory(prefix="posfet-") as folder:
        channel = str(Path(folder) / "can0")
        with options.emulator(sensor, channel, options.clock):
            yield sensor, _settings(options, sensor, "slcan", channel)


def _settings(options: argparse.Namespace, sensor: Sensor, interface: str, channel: str) -> BusSettings:
    return bus_settings(
        interface,
        channel,
        sensor.can,
        bitrate=options.bitrate,
        data_bitrate=options.data_bitrate,
        options=options.option,
    )
