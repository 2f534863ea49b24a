# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Fixtures of the tests that run in the virtual machine: the interfaces, and a board and its driver on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from support.kernel_can import OWN_MODULES, Wire, controller_wire, controllers, load_modules, virtual_wire
from support.vm_bench import VmBench

WIRES = ["vcan fd", "vcan classic", "kvaser_pci classic", "ctucanfd_pci fd", "ctucanfd_pci classic"]


@pytest.fixture(scope="session", autouse=True)
def modules() -> None:
    assert OWN_MODULES.is_dir(), "these tests run in the virtual machine of `make test-vm`"
    load_modules()


def _wire(stack: ExitStack, name: str, settings: str = "restart-ms 0") -> Wire:
    driver, _, kind = name.partition(" ")
    if driver == "vcan":
        return stack.enter_context(virtual_wire(kind == "fd"))
    if not controllers(driver):
        pytest.skip(f"the machine has no module {driver}")
    return stack.enter_context(controller_wire(driver, kind == "fd", settings))


@pytest.fixture(params=WIRES)
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    with ExitStack() as stack:
        yield _wire(stack, request.param)


@pytest.fixture
def open_wire() -> Iterator[Callable[..., Wire]]:
    """Opens a wire by name, with settings of the controllers."""
    with ExitStack() as stack:
        yield lambda name, settings="restart-ms 0": _wire(stack, name, settings)


@pytest.fixture
def bench() -> Iterator[Callable[[Wire], VmBench]]:
    """Connects a board and its driver to a wire."""
    with ExitStack() as stack:
        yield lambda wire: stack.enter_context(VmBench(wire))
