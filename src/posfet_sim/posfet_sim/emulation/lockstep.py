# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A simulated board on an emulated bus, with the driver's decoder behind it, one scan at a time and without a clock."""

from __future__ import annotations

from posfet_driver.bus.frame import CLASSIC
from posfet_driver.protocol.decoded import ResponseReceived, ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Request
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.emulation.firmware import with_whole_period
from posfet_sim.loads import Loads


class LockstepBoard:
    """Gives the scans of a board as a driver decodes them from its frames, each when the caller asks for it.

    The caller's loop is the clock: it steps what makes the loads, asks for a scan, and acts on it before the next one.
    The start command is sent at once, and again after a reset of the board.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    loads : Loads
        Loads on the board, whose time begins with the first scan.
    seed : int
        Seed of everything random, in [0, 1e9].
    error_model : ErrorModel, optional
        Non-idealities, with the faults of the link; default: an ideal board.

    Raises
    ------
    ConfigError
        The layout does not fit the frames.
    ValueError
        The seed is out of range.
    """

    def __init__(self, sensor: Sensor, loads: Loads, seed: int, error_model: ErrorModel | None = None) -> None:
        self.board = SimulatedBoard(with_whole_period(sensor), loads, seed, error_model)
        """The simulated board, for its ground truth."""
        self._node = BusBoard(self.board, seed, 0)
        self._node.on_scan = self._sent
        self._decoder = Decoder(self.board.sensor)
        self._now = 0
        self._made = False

    def next_scan(self) -> Scan | None:
        """Let the time pass until the board has sent a scan.

        Returns
        -------
        Scan or None
            What the driver has decoded, overwritten by the next call; None when frames of the scan were lost.
        """
        self._made = False
        scan = None
        while not self._made:
            for decoded in self._decoder.decode(self._node.due(self._now), self._now, 0):
                if isinstance(decoded, ScanReady):
                    scan = decoded.scan
            if not self._node.running:
                start(self._node, self._decoder, self.board.sensor, self._now)
            self._now = max(self._node.next_due(), self._now)
        return scan

    def _sent(self, scan: Scan) -> None:
        self._made = True


def start(node: BusBoard, decoder: Decoder, sensor: Sensor, now: int) -> None:
    """Send the start command; the scans before and after a reset are not lost but interrupted.

    Parameters
    ----------
    node : BusBoard
        Board on the emulated bus.
    decoder : Decoder
        The driver's decoder.
    sensor : Sensor
        Sensor description.
    now : int
        Monotonic time [ns].
    """
    request = Request(Command.START, 0)
    answers = node.receive((sensor.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), now)
    if any(isinstance(found, ResponseReceived) for found in decoder.decode(answers, now, 0)):
        decoder.start()
