# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Entry points of the executables of this package."""

from __future__ import annotations

from posfet_model.ros.start import run


def sim_board_node() -> None:
    """Run the simulated board's node."""
    run("posfet_sim.ros.sim_board_node")


def replay_node() -> None:
    """Run the node that replays a recording."""
    run("posfet_sim.ros.replay_node")
