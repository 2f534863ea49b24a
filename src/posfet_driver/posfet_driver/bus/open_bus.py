# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Opens a CAN bus from plain parameters; every error in them is reported in one line."""

from __future__ import annotations

import ast
import errno
import importlib
import inspect
import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import can
from can.interfaces import BACKENDS

from posfet_driver.bus import can_interface
from posfet_driver.bus.bus_error import bus_failure, one_line
from posfet_driver.bus.frame import BoardFrames
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.python_can_bus import PythonCanFrameBus
from posfet_driver.bus.slcan_bus import SlcanBus
from posfet_driver.bus.socketcan_bus import SocketcanFrameBus
from posfet_model.config import ConfigError
from posfet_model.sensor.description import CanLink

SOCKETCAN: Final = "socketcan"
SLCAN: Final = "slcan"
"""Interface of the buffered reader of this package."""
PLAIN_SLCAN: Final = "slcan-python-can"
"""Interface of python-can's own slcan."""
logging.getLogger("can").addHandler(logging.NullHandler())  # errors are raised; python-can would log each attempt, too
# python-can before 4.4 warns of a bus that could not be opened, too, when the object is freed.
logging.getLogger("can.bus").addFilter(lambda record: "not properly shut down" not in str(record.msg))
_DOCUMENTED: Final = re.compile(r"^\s*:param (?:[^:\n]* )?(\w+):", re.MULTILINE)


@dataclass(frozen=True)
class BusSettings:
    """Settings of a bus."""

    interface: str
    """Interface of python-can, or one of this package."""
    channel: str
    """Channel of the interface, such as can0 or /dev/ttyACM0."""
    bitrate: int
    """Nominal bit rate [bit/s]."""
    data_bitrate: int
    """Bit rate of the CAN FD data phase [bit/s]."""
    fd: bool
    """Whether the bus carries CAN FD."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of the interface."""

    @property
    def name(self) -> str:
        """Interface and channel in one word."""
        return f"{self.interface}:{self.channel}" if self.channel else self.interface


def bus_settings(
    interface: str,
    channel: str,
    link: CanLink,
    *,
    bitrate: int = 0,
    data_bitrate: int = 0,
    options: Sequence[str] = (),
) -> BusSettings:
    """Return checked settings.

    Parameters
    ----------
    interface : str
        Name of the interface.
    channel : str
        Its channel; empty for interfaces without one.
    link : CanLink
        Source of the frame format, and of bit rates that are 0 here.
    bitrate : int, default 0
        Nominal bit rate [bit/s].
    data_bitrate : int, default 0
        Bit rate of the CAN FD data phase [bit/s].
    options : sequence of str, optional
        Further arguments of the interface, each as "key=value".

    Returns
    -------
    BusSettings
        The settings.

    Raises
    ------
    ConfigError
        For an unknown interface or option; one line that lists the known ones.
    """
    settings = BusSettings(
        interface=interface,
        channel=channel,
        bitrate=bitrate or link.bitrate,
        data_bitrate=data_bitrate or link.data_bitrate,
        fd=link.fd,
        options=dict(_option(text) for text in options if text),
    )
    known = sorted(_accepted(_bus_class(interface)) - {"channel", "bitrate", "data_bitrate", "fd"})
    for key in settings.options:
        if key not in known:
            raise ConfigError(f"CAN interface '{interface}' has no option '{key}', known are {', '.join(known)}")
    return settings


def open_bus(settings: BusSettings, board: BoardFrames | None = None) -> FrameBus:
    """Open the bus.

    Parameters
    ----------
    settings : BusSettings
        The bus.
    board : BoardFrames, optional
        The only board that the bus is read for, where the interface can filter; by default every frame is received.

    Returns
    -------
    FrameBus
        The open bus.

    Raises
    ------
    can.CanError
        When it cannot be opened now; the reason in one line.
    ConfigError
        When it can never be opened with these arguments.
    """
    bus = open_can_bus(settings)
    if settings.interface == SOCKETCAN:
        try:
            return SocketcanFrameBus(bus, board)
        except (can.CanError, OSError) as error:  # removed meanwhile
            bus.shutdown()
            raise can.CanInitializationError(f"{settings.name}: {one_line(error)}") from error
    return bus if isinstance(bus, SlcanBus) else PythonCanFrameBus(bus)


def open_can_bus(settings: BusSettings) -> can.BusABC:
    """Open the bus as an object of python-can. Raises as `open_bus` does."""
    bus_class = _bus_class(settings.interface)
    accepted = _accepted(bus_class)
    offered: dict[str, Any] = {"bitrate": settings.bitrate, "fd": settings.fd}
    if settings.fd:
        offered["data_bitrate"] = settings.data_bitrate
    arguments = {key: value for key, value in offered.items() if key in accepted} | dict(settings.options)
    if settings.channel:
        arguments["channel"] = settings.channel
    elif _channel_needed(bus_class):
        raise ConfigError(f"CAN interface '{settings.interface}' needs a channel, such as can0, /dev/ttyACM0, ...")
    if settings.interface == SOCKETCAN and (
        reason := can_interface.obstacle(settings.channel, settings.fd, settings.bitrate, settings.data_bitrate)
    ):
        raise can.CanInitializationError(f"{settings.name}: {reason}")
    try:
        return bus_class(**arguments)
    except can.CanInterfaceNotImplementedError as error:
        raise ConfigError(f"CAN interface '{settings.interface}' cannot be used here: {one_line(error)}") from error
    except Exception as error:
        if bus_class is SlcanBus and isinstance(error, ValueError):  # checks its arguments; a device has no part in it
            raise ConfigError(f"{settings.name}: {one_line(error)}") from error
        reason = one_line(bus_failure(error)).removeprefix(f"{settings.channel}: ")
        if isinstance(error, OSError) and error.errno == errno.EAFNOSUPPORT:
            reason = "this kernel has no SocketCAN, or its module is not loaded: sudo modprobe can_raw"
        raise can.CanInitializationError(f"{settings.name}: {reason}") from error


def interfaces() -> list[str]:
    """Return the names of the known interfaces."""
    return sorted({*BACKENDS, PLAIN_SLCAN})


def _bus_class(interface: str) -> type[Any]:
    if interface == SLCAN:
        return SlcanBus
    module_and_name = BACKENDS.get("slcan" if interface == PLAIN_SLCAN else interface)
    if module_and_name is None:
        raise ConfigError(f"CAN interface must be one of {', '.join(interfaces())}, got '{interface}'")
    module, name = module_and_name
    try:
        bus_class: type[Any] = getattr(importlib.import_module(module), name)
    except (ImportError, OSError, AttributeError, can.CanError) as error:  # vendors' modules fail in many ways
        raise ConfigError(f"CAN interface '{interface}' cannot be used here: {one_line(error)}") from error
    return bus_class


def _accepted(bus_class: type[Any]) -> set[str]:
    """Return the names of the arguments that a bus accepts, including those that it passes to its base classes."""
    return set(_parameters(bus_class)) - {"self", "args", "kwargs"}


def _channel_needed(bus_class: type[Any]) -> bool:
    channel = inspect.signature(bus_class).parameters.get("channel")
    return channel is not None and channel.default is channel.empty


def _parameters(bus_class: type[Any]) -> Iterator[str]:
    for part in bus_class.__mro__:
        if "__init__" not in vars(part):
            continue
        constructor = vars(part)["__init__"]
        parameters = inspect.signature(constructor).parameters.values()
        yield from (item.name for item in parameters if item.kind not in {item.VAR_POSITIONAL, item.VAR_KEYWORD})
        if part is can.BusABC or not any(item.kind is item.VAR_KEYWORD for item in parameters):
            return
        # Some read arguments from **kwargs, Kvaser's even the bit rate: only their documentation names them.
        yield from _DOCUMENTED.findall(constructor.__doc__ or "")


def _option(text: str) -> tuple[str, Any]:
    key, separator, value = text.partition("=")
    if not separator or not key:
        raise ConfigError(f"CAN option must be 'key=value', got '{text}'")
    try:
        return key, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return key, {"true": True, "false": False}.get(value.lower(), value)
