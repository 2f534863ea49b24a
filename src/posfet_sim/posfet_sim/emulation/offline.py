"""A simulated board behind its frames, faster than real time: scans as a driver hands them on, with the truth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from posfet_driver.bus.frame import CLASSIC
from posfet_driver.protocol.decoder import Decoder, ResponseReceived, ScanReady
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Request
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.ground_truth import Truth
from posfet_sim.device.imperfections import Imperfections
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import WireNode
from posfet_sim.scene import Scene, SceneLoads

_NANOSECONDS: Final = 1_000_000_000


def wire_scans(
    sensor: Sensor, scene: Scene, duration: float, seed: int, imperfections: Imperfections | None = None
) -> Iterator[tuple[Scan, Truth]]:
    """Yield every scan that comes whole through frames and codec in `duration` [s], with what truly was.

    The scan is overwritten by the next one. Temperatures are those of the status frames. The board is started again
    after a reset. Raises ConfigError when the layout does not fit the frames, ValueError for a seed outside [0, 1e9].
    """
    board = SimulatedBoard(sensor, SceneLoads(scene, sensor), seed, imperfections)
    node = WireNode(board, seed, 0)
    decoder = Decoder(sensor)
    sent: list[tuple[int, Truth]] = []
    node.on_scan = lambda scan: sent.append((scan.sequence, board.truth()))
    now = node.next_due()
    while now < duration * _NANOSECONDS:
        for decoded in decoder.decode(node.due(now), now, 0):
            if isinstance(decoded, ScanReady) and sent and sent[-1][0] == decoded.scan.sequence:
                yield decoded.scan, sent[-1][1]
        sent.clear()
        if not node.running or decoder.resync_needed():
            _start(node, decoder, sensor, now)
        now = node.next_due()


def _start(node: WireNode, decoder: Decoder, sensor: Sensor, now: int) -> None:
    """Tell a board that is there to send scans, or which is next when it does."""
    request = Request(Command.START, 0)
    decoder.note_start_sent(request.tag, now)
    answers = node.receive((sensor.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), now)
    responses = [found.response for found in decoder.decode(answers, now, 0) if isinstance(found, ResponseReceived)]
    if responses:
        decoder.resync(responses[-1].value, count_gap=True)
