# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""CAN interfaces of a real kernel, set up with iproute2: those of the virtual machine of `make test-vm`."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

DRIVERS: Final = Path("/sys/bus/pci/drivers")
FAULTS: Final = Path("/sys/module/can_faults/parameters/inject")
OWN_MODULES: Final = Path(os.environ.get("POSFET_VM_MODULES", "/nonexistent"))
"""Folder of the modules that are built for the machine."""
CLASSIC: Final = "type can bitrate 1000000"
FD: Final = f"{CLASSIC} dbitrate 5000000 fd on"


def run(*words: str) -> str:
    """Run a command and return its output; fail with its error message."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(words)}: {done.stderr}"
    return done.stdout


def load_modules() -> None:
    """Load the modules of the emulated controllers. vcan with echo: only then a qdisc delays what a socket sends."""
    for name in ("can-raw", "can-dev", "kvaser_pci", "sch_netem"):
        run("modprobe", name)
    run("modprobe", "vcan", "echo=1")
    for name in ("can_faults", "ctucanfd", "ctucanfd_pci"):
        module = OWN_MODULES / f"{name}.ko"
        if module.exists() and not Path(f"/sys/module/{name}").exists():
            run("insmod", str(module))


@dataclass(frozen=True)
class Interface:
    """A CAN interface."""

    name: str
    settings: str = ""
    """Words of `ip link set ... up` that a virtual interface does not have."""

    def up(self, settings: str = "") -> None:
        """Set it up; with further settings."""
        run("ip", "link", "set", self.name, "up", *self.settings.split(), *settings.split())

    def down(self) -> None:
        run("ip", "link", "set", self.name, "down")

    def inject(self, fault: str) -> None:
        """Let the controller have a fault (tools/vm/modules/can_faults.c)."""
        FAULTS.write_text(f"{self.name} {fault}", encoding="ascii")


@dataclass(frozen=True)
class Wire:
    """Two interfaces on one wire; with a virtual one it is the same for both."""

    driver: Interface
    board: Interface
    fd: bool
    """Whether the board sends CAN FD."""

    @property
    def interfaces(self) -> list[Interface]:
        return [self.driver] if self.driver == self.board else [self.driver, self.board]

    def up(self, settings: str = "") -> None:
        for one in self.interfaces:
            one.up(settings)

    def down(self) -> None:
        for one in self.interfaces:
            one.down()


@contextmanager
def virtual_wire(fd: bool, mtu: int = 72) -> Iterator[Wire]:
    """Yield a virtual interface that is up."""
    interface = Interface("vcan0")
    run("ip", "link", "add", interface.name, "mtu", str(mtu), "type", "vcan")
    try:
        interface.up()
        yield Wire(interface, interface, fd)
    finally:
        run("ip", "link", "delete", interface.name)


def controllers(driver: str) -> list[tuple[str, str]]:
    """Return PCI address and interface of each controller of a driver."""
    found = (DRIVERS / driver).glob("*/net/*")
    return sorted((path.parent.parent.name, path.name) for path in found)


@contextmanager
def controller_wire(driver: str, fd: bool, settings: str = "restart-ms 0") -> Iterator[Wire]:
    """Yield the two controllers of a driver, which are up."""
    first, second = (Interface(name, FD if fd else CLASSIC) for _, name in controllers(driver))
    wire = Wire(first, second, fd)
    wire.up(settings)
    try:
        yield wire
    finally:
        for _, name in controllers(driver):
            Interface(name).down()


def unplug(driver: str, address: str) -> None:
    """Take a controller from its driver, as if it were pulled out."""
    (DRIVERS / driver / "unbind").write_text(address, encoding="ascii")


def plug(driver: str, address: str) -> None:
    """Give a controller back to its driver."""
    (DRIVERS / driver / "bind").write_text(address, encoding="ascii")
