# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Parameters of the node of the simulated board; without ROS."""

from __future__ import annotations

from typing import Final

from posfet_driver.parameters import SCAN_SOURCE_NODE
from posfet_model.parameters import DISPLAY_RATE, Parameter
from posfet_sim.defaults import DEFAULT, DEFAULT_SCENE, SEED_MAX

SCENE: Final = Parameter(
    "scene", DEFAULT_SCENE, "Scene of the simulated board: path of a YAML file, or name of a shipped one"
)
SEED: Final = Parameter(
    "seed",
    0,
    "Seed of noise and device variation: the same seed gives the same counts",
    low=0,
    high=SEED_MAX,
)
ADAPTER_LINK: Final = Parameter(
    "adapter_link",
    "",
    "Path of the emulated slcan adapter behind which the board is served",
    empty="scans are published on `raw`",
)
BUS_INTERFACE: Final = Parameter(
    "bus_interface",
    "",
    "python-can interface on which the board is served instead of the emulated adapter: socketcan, udp_multicast, "
    "...; virtual only within one process",
    empty="none",
)
BUS_CHANNEL: Final = Parameter("bus_channel", "", "Channel of bus_interface")
IMPERFECTIONS: Final = Parameter(
    "imperfections",
    DEFAULT,
    "Sensor error model of the simulated board (non-idealities): none, default, moderate, hard, or path of a YAML file",
)

REPLAY_FILE: Final = Parameter(
    "replay_file", "", "Recording of scans, an MCAP file of posfet record, posfet sim or ros2 bag record", empty="none"
)
REPLAY_RATE: Final = Parameter(
    "replay_rate", 1.0, "Playback speed factor; 0: as fast as scans are read", low=0.0, high=1000.0
)
REPLAY_TOPIC: Final = Parameter(
    "replay_topic", "", "Topic of the scans in the recording", empty="the only one with scans"
)

REPLAY_NODE: Final = (*SCAN_SOURCE_NODE, REPLAY_FILE, REPLAY_RATE, REPLAY_TOPIC)

SIM_BOARD_NODE: Final = (
    *SCAN_SOURCE_NODE,
    SCENE,
    SEED,
    ADAPTER_LINK,
    BUS_INTERFACE,
    BUS_CHANNEL,
    IMPERFECTIONS,
    DISPLAY_RATE,
)
