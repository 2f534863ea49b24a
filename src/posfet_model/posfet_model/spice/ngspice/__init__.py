"""Runs of the follower circuits in ngspice, an external program; an incomplete or too coarse run is an error."""

from posfet_model.spice.ngspice.deck import CIRCUITS, FOLLOWER, RELATIVE_TOLERANCE, netlist, piecewise_linear
from posfet_model.spice.ngspice.program import PROGRAM, SpiceError, available, read_raw
from posfet_model.spice.ngspice.small_signal import (
    SmallSignal,
    closed_loop,
    run_double_injection,
    run_follower_ac,
    run_loop_gain,
    run_open_loop_ac,
    run_operating_point,
)
from posfet_model.spice.ngspice.transient import Transient, run_follower

__all__ = [
    "CIRCUITS",
    "FOLLOWER",
    "PROGRAM",
    "RELATIVE_TOLERANCE",
    "SmallSignal",
    "SpiceError",
    "Transient",
    "available",
    "closed_loop",
    "netlist",
    "piecewise_linear",
    "read_raw",
    "run_double_injection",
    "run_follower",
    "run_follower_ac",
    "run_loop_gain",
    "run_open_loop_ac",
    "run_operating_point",
]
