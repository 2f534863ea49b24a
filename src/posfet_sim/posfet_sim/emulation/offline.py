# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of a simulated board after encoding and decoding as CAN frames, faster than real time, with ground truth."""

from __future__ import annotations

from collections.abc import Iterator

from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.ground_truth import Truth
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.emulation.firmware import with_whole_period
from posfet_sim.emulation.lockstep import start
from posfet_sim.scene import Scene, SceneLoads


def received_scans(
    sensor: Sensor, scene: Scene, duration: float, seed: int, error_model: ErrorModel | None = None
) -> Iterator[tuple[Scan, Truth]]:
    """Yield every complete scan that a driver would receive over CAN, with its ground truth.

    Temperatures are those of the status frames. The board is started again after a reset.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    scene : Scene
        Scene that the board simulates.
    duration : float
        Duration of the run [s].
    seed : int
        Seed of everything random, in [0, 1e9].
    error_model : ErrorModel, optional
        Default: an ideal board.

    Yields
    ------
    tuple of (Scan, Truth)
        The scan, which the next one overwrites, and its ground truth.

    Raises
    ------
    ConfigError
        The layout does not fit the frames.
    ValueError
        The seed is out of range.
    """
    board = SimulatedBoard(with_whole_period(sensor), SceneLoads(scene, sensor), seed, error_model)
    node = BusBoard(board, seed, 0)
    decoder = Decoder(sensor)
    sent: list[tuple[int, Truth]] = []
    node.on_scan = lambda scan: sent.append((scan.sequence, board.truth()))
    now = 0  # the scene begins with the first tick
    while now < duration * NANOSECONDS:
        for decoded in decoder.decode(node.due(now), now, 0):
            if isinstance(decoded, ScanReady) and sent and sent[-1][0] == decoded.scan.sequence:
                yield decoded.scan, sent[-1][1]
        sent.clear()
        if not node.running:
            start(node, decoder, sensor, now)
        now = node.next_due()
