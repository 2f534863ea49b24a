"""Entry points of the executables of this package."""

from __future__ import annotations

from posfet_model.ros.start import run


def sim_board_node() -> None:
    """Run the simulated board's node."""
    run("posfet_sim.ros.sim_board_node")
