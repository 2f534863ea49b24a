"""What every kind of bus offers: many frames at once."""

from __future__ import annotations

from typing import Protocol

from posfet_driver.bus.frame import Frame


class FrameBus(Protocol):
    """A bus that reads many frames at once. Every method raises can.CanError when the bus is gone."""

    @property
    def malformed_lines(self) -> int:
        """Lines of a serial adapter that were no frame and no reply; 0 where there are no lines."""
        ...

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return the frames that are there; when none is, wait up to `timeout` [s] for the first."""
        ...

    def write_frame(self, frame: Frame) -> None:
        """Send one frame."""
        ...

    def ask_state(self) -> None:
        """Ask the adapter for errors on the bus; what it tells is read as error frames, if it tells anything."""
        ...

    def shutdown(self) -> None:
        """Close the bus."""
        ...
