# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

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
