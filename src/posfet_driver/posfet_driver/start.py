"""Entry points of the executables of this package."""

from __future__ import annotations

from posfet_model.start import run


def driver_node() -> None:
    """Run the driver node."""
    run("posfet_driver.driver_node")


def sim_board_node() -> None:
    """Run the simulated board's node."""
    run("posfet_driver.sim_board_node")
