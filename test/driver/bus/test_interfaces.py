# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Options of every python-can interface: passed on unchanged, and rejected when the interface does not have them."""

from __future__ import annotations

import errno
import functools
import importlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import can
import pytest
from can.interfaces import BACKENDS

from posfet_driver.bus.open_bus import bus_settings, interfaces, open_can_bus
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor

LINK = load_sensor().can
EVERYWHERE = {"slcan", "slcan-python-can", "socketcan", "socketcand", "udp_multicast", "virtual", "kvaser", "pcan"}
"""Interfaces whose options are known without their maker's driver."""


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that opens an interface and returns the arguments of its constructor."""

    def constructor_arguments(interface: str, channel: str, options: Sequence[str], fd: bool = True) -> dict[str, Any]:
        module, name = BACKENDS[interface]
        bus_class = getattr(importlib.import_module(module), name)
        arguments: dict[str, Any] = {}

        @functools.wraps(bus_class.__init__)
        def constructor(self: object, *args: object, **given: Any) -> None:
            assert not args
            arguments.update(given)
            raise can.CanInitializationError("not here")

        with monkeypatch.context() as patch:
            patch.setattr(bus_class, "__init__", constructor)
            patch.setattr(bus_class, "__del__", lambda self: None, raising=False)
            with pytest.raises(can.CanInitializationError, match=f"{interface}:{channel}: not here"):
                open_can_bus(bus_settings(interface, channel, replace(LINK, fd=fd), options=options))
        return arguments

    return constructor_arguments


@pytest.mark.parametrize("interface", interfaces())
def test_an_unknown_interface_option_is_rejected_with_the_known_options(interface: str) -> None:
    with pytest.raises(ConfigError) as caught:
        bus_settings(interface, "", LINK, options=["no_such_option=1"])
    message = str(caught.value)
    assert "\n" not in message
    unknown = f"CAN interface '{interface}' has no option 'no_such_option', known are "
    assert message.startswith((unknown, f"CAN interface '{interface}' cannot be used here: "))
    assert "can_filters" in message or not message.startswith(unknown)
    assert interface not in EVERYWHERE or message.startswith(unknown)


def test_socketcan_bitrate_is_set_by_the_kernel(opened: Any) -> None:
    options = ["receive_own_messages=true", "ignore_rx_error_frames=False", "local_loopback=0"]
    assert opened("socketcan", "can0", options=options) == {
        "channel": "can0",
        "fd": True,
        "receive_own_messages": True,
        "ignore_rx_error_frames": False,
        "local_loopback": 0,
    }


@pytest.mark.parametrize("fd", [True, False])
def test_kvaser_gets_its_keyword_arguments(opened: Any, fd: bool) -> None:
    arguments = opened("kvaser", "0", fd=fd, options=["accept_virtual=false", "sjw=4"])
    expected = {"channel": "0", "bitrate": 1_000_000, "fd": fd, "accept_virtual": False, "sjw": 4}
    assert arguments == expected | ({"data_bitrate": 5_000_000} if fd else {})


def test_pcan_gets_fd_and_its_bit_timing(opened: Any) -> None:
    timing = {"f_clock_mhz": 80, "nom_brp": 2, "nom_tseg1": 33, "nom_tseg2": 6, "nom_sjw": 1}
    timing |= {"data_brp": 2, "data_tseg1": 5, "data_tseg2": 2, "data_sjw": 1}
    arguments = opened("pcan", "PCAN_USBBUS1", options=[f"{key}={value}" for key, value in timing.items()])
    assert arguments == {"channel": "PCAN_USBBUS1", "bitrate": 1_000_000, "fd": True} | timing


def test_socketcand_and_multicast_get_address_and_port(opened: Any) -> None:
    arguments = opened("socketcand", "can0", fd=False, options=["host=127.0.0.1", "port=29536"])
    assert arguments == {"channel": "can0", "host": "127.0.0.1", "port": 29536}
    arguments = opened("udp_multicast", "ff15::1", options=["port=43113", "hop_limit=0"])
    assert arguments == {"channel": "ff15::1", "fd": True, "port": 43113, "hop_limit": 0}


def test_a_kernel_without_socketcan_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_such_family(*_: Any, **__: Any) -> None:
        raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")

    monkeypatch.setattr("can.interfaces.socketcan.SocketcanBus.__init__", no_such_family)
    with pytest.raises(can.CanInitializationError, match=r"^socketcan:can0: this kernel has no SocketCAN, .*modprobe"):
        open_can_bus(bus_settings("socketcan", "can0", load_sensor().can))
