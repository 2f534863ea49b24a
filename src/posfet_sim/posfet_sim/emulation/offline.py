"""A simulated board behind its frames, faster than real time: scans as a driver hands them on, with the truth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from posfet_driver.bus.frame import CLASSIC
from posfet_driver.protocol.decoder import Receiver
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
    receiver = Receiver(sensor)
    sent: list[tuple[int, Truth]] = []
    node.on_scan = lambda scan: sent.append((scan.sequence, board.truth()))
    now = node.next_due()
    while now < duration * _NANOSECONDS:
        for frame in receiver.begin_batch(node.due(now), now, 0):
            if receiver.feed(frame) and sent and sent[-1][0] == receiver.scan.sequence:
                yield receiver.scan, sent[-1][1]
        sent.clear()
        if not node.running or receiver.question_due():
            _start(node, receiver, sensor, now)
        now = node.next_due()


def _start(node: WireNode, receiver: Receiver, sensor: Sensor, now: int) -> None:
    """Tell a board that is there to send scans, or which is next when it does."""
    request = Request(Command.START, 0)
    receiver.asked(request.tag, now)
    answers = node.receive((sensor.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), now)
    for answer in receiver.begin_batch(answers, now, 0):
        receiver.feed(answer)
    if receiver.response is not None:
        receiver.resync(receiver.response.value, count_gap=True)
        receiver.response = None
