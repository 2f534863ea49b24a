# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet can`, with the simulated board as an additional interface (`-i emulator`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from posfet_driver.clock import Clock
from posfet_driver.tools import can_cli
from posfet_model.sensor.description import Sensor


@contextmanager
def emulator(sensor: Sensor, channel: str, clock: Clock) -> Iterator[None]:
    """Serve a simulated board with the default scene on an emulated slcan adapter at the path `channel`.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    channel : str
        Path at which the adapter appears.
    clock : Clock
        Clock of the host.
    """
    from posfet_sim.emulation.bus_peer import SimulatedBusPeer  # noqa: PLC0415  # needed by the emulation only
    from posfet_sim.scene import DEFAULT_SCENE, load_scene  # noqa: PLC0415

    source = SimulatedBusPeer(sensor, load_scene(DEFAULT_SCENE, sensor), 0, channel, clock)
    source.open()
    try:
        yield
    finally:
        source.close()


def main(words: Sequence[str] | None = None, clock: Clock | None = None) -> int:
    """Run one action of `posfet can` by a clock, that of this machine by default; return its exit code.

    Parameters
    ----------
    words : sequence of str, optional
        Words of the command line; default: those of this process.
    clock : Clock, optional
        Clock; default: that of this machine.
    """
    return can_cli.main(words, emulator, clock)
