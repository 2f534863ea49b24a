"""Entry points of the executables of this package."""

from __future__ import annotations

from posfet_model.ros.start import run


def driver_node() -> None:
    """Run the driver node."""
    run("posfet_driver.ros.driver_node")
