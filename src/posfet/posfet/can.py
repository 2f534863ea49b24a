"""`posfet can`, with the simulated board as an additional interface (`-i emulator`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from posfet_driver.tools import can_cli
from posfet_model.sensor.description import Sensor


@contextmanager
def emulator(sensor: Sensor, channel: str) -> Iterator[None]:
    """Serve a simulated board with the default scene on an emulated slcan adapter at the path `channel`."""
    from posfet_sim.emulation.emulated_source import AdapterSource  # noqa: PLC0415  # needed by the emulation only
    from posfet_sim.scene import DEFAULT_SCENE, load_scene  # noqa: PLC0415

    source = AdapterSource(sensor, load_scene(DEFAULT_SCENE, sensor), 0, channel)
    source.open()
    try:
        yield
    finally:
        source.close()


def main(words: Sequence[str] | None = None) -> int:
    """Run one action of `posfet can` and return its exit code."""
    return can_cli.main(words, emulator)
