"""The emulated firmware: the board side of the protocol."""

from __future__ import annotations

from posfet_driver.bus.frame import CLASSIC
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Request
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.emulation.firmware import BoardFirmware

SENSOR = load_sensor()
SECOND = 1_000_000_000


class Counter:
    """A board that records the requested scan indices."""

    def __init__(self) -> None:
        self.indices: list[int] = []

    def scan(self, index: int, out: Scan) -> None:
        self.indices.append(index)
        out.stamp, out.device_time = index * 1_000_000, index * 1000


def start(firmware: BoardFirmware, now: int) -> None:
    request = Request(Command.START, 1, 0)
    assert firmware.receive((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), now)


def stop(firmware: BoardFirmware, now: int) -> None:
    request = Request(Command.STOP, 2, 0)
    assert firmware.receive((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), now)


def test_scan_numbers_follow_the_time_since_power_on_also_while_stopped() -> None:
    board = Counter()
    firmware = BoardFirmware(SENSOR, board, 0)
    firmware.due(5 * SECOND)
    assert board.indices == []
    start(firmware, 5 * SECOND)
    firmware.due(5 * SECOND + SECOND // 10)
    assert board.indices == list(range(5000, 5101))
    stop(firmware, 6 * SECOND)
    start(firmware, 7 * SECOND)
    firmware.due(7 * SECOND + SECOND // 100)
    assert board.indices[101:] == list(range(7000, 7011))
