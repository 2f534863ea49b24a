"""Parameters of the node of the simulated board; without ROS."""

from __future__ import annotations

from typing import Final

from posfet_driver.parameters import SCAN_SOURCE_NODE
from posfet_model.parameters import Parameter
from posfet_sim.device.error_model import DEFAULT
from posfet_sim.device.simulated_board import SEED_MAX
from posfet_sim.scene import DEFAULT_SCENE

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

SIM_BOARD_NODE: Final = (
    *SCAN_SOURCE_NODE,
    SCENE,
    SEED,
    ADAPTER_LINK,
    BUS_INTERFACE,
    BUS_CHANNEL,
    IMPERFECTIONS,
)
