# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""CAN interfaces of the kernel: which there are, their state, and what to do about one that cannot be used."""

from __future__ import annotations

from pathlib import Path
from typing import Final

NETWORK_DEVICES: Final = Path("/sys/class/net")
_CAN_DEVICE: Final = "280"
"""Type of a CAN interface (ARPHRD_CAN, linux/if_arp.h)."""
_UP: Final = 0x1
"""Flag of an interface that is up (IFF_UP, linux/if.h)."""
_FD_MTU: Final = 72
"""Size of struct canfd_frame [byte]: the MTU of an interface that carries CAN FD; 16 without."""


def names() -> list[str]:
    """Return the names of the CAN interfaces of this machine, sorted."""
    if not NETWORK_DEVICES.is_dir():
        return []
    return sorted(path.name for path in NETWORK_DEVICES.iterdir() if _content(path.name, "type") == _CAN_DEVICE)


def presence(name: str) -> object:
    """Return a value that changes when the interface is added, removed, switched or set up differently."""
    return tuple(_content(name, entry) for entry in ("ifindex", "flags", "mtu", "operstate"))


def is_bus_off(name: str) -> bool:
    """Return whether the controller is bus-off: an interface that is up without a carrier."""
    return _content(name, "carrier") == "0"


def is_down(name: str) -> bool:
    """Return whether the interface exists and is down."""
    flags = _content(name, "flags")
    return bool(flags) and not int(flags, 16) & _UP


def obstacle(name: str, fd: bool, bitrate: int, data_bitrate: int) -> str:
    """Return why the interface cannot be used, with the command that changes it.

    Parameters
    ----------
    name : str
        Name of the interface.
    fd : bool
        Whether it has to carry CAN FD.
    bitrate : int
        Nominal bit rate [bit/s].
    data_bitrate : int
        Bit rate of the CAN FD data phase [bit/s].

    Returns
    -------
    str
        One line; empty when nothing is known against it, also when there is no such interface.
    """
    down = is_down(name)
    mtu = _content(name, "mtu")
    classic_only = fd and mtu.isdecimal() and int(mtu) < _FD_MTU
    if not down and not classic_only:
        return ""
    if (NETWORK_DEVICES / name / "device").exists():
        rates = f"bitrate {bitrate}" + (f" dbitrate {data_bitrate} fd on" if fd else "")
        settings = f"up type can {rates}"
    else:  # a virtual one has no bit rate
        settings = f"mtu {_FD_MTU} up" if classic_only else "up"
    remedy = f"sudo ip link set {name} {settings}"
    if down:
        return f"the interface is down: {remedy}"
    reason = f"the board sends CAN FD, the interface carries classic CAN only (mtu {mtu})"
    return f"{reason}: sudo ip link set {name} down; {remedy}"


def _content(name: str, entry: str) -> str:
    try:
        return (NETWORK_DEVICES / name / entry).read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return ""
