"""A board on a CAN bus as a source of scans: found, told to send, kept going, and found again after every fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Final

import can

from posfet_driver.board.board_report import board_report
from posfet_driver.board.command_queue import CommandQueue
from posfet_driver.board.connection_state import DEAF, HEALTH, Phase
from posfet_driver.board.no_response import Silence
from posfet_driver.board.scan_source import Health, SourceReport
from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import one_line
from posfet_driver.bus.reconnecting_bus import PRESENCE_PERIOD, BusLink
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.decoder import Receiver
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    PROTOCOL_VERSION,
    Command,
    Request,
    Response,
    Result,
    version,
)
from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

ANSWER_TIMEOUT: Final = 0.2
"""Time a board has to answer [s]; then it is asked again."""
REFUSED_PERIOD: Final = 1.0
"""Time after which a board that cannot be used is asked again [s]."""
SILENCE: Final = 0.3
"""Time without any scan [s] after which a board that should send is asked what it is."""
SILENT_SCANS: Final = 10
"""The same in scans, where they come slower."""
NEVER: Final = 1 << 63
LOW_SUPPLY_MEMORY: Final = 2.0
"""Time after a low supply was told [s] in which a reset is called a brown-out."""


class Board:
    """One board on a bus. Used by one thread, but for `submit` and `report`.

    The bus is opened again, with a growing pause, whenever it cannot be opened, fails, or stays without an answer; a
    board that does not answer or falls silent is identified and started again. Nothing of that raises: `report` tells
    what is missing and why.
    """

    simulated = False

    def __init__(
        self,
        sensor: Sensor,
        open_bus: Callable[[], FrameBus],
        clock: Clock | None = None,
        presence: Callable[[], object] | None = None,
    ) -> None:
        """Take the sensor, with its frames, and what opens the bus.

        `presence` returns something that differs when an adapter came back: then it is tried without further pause.
        Raises ConfigError when the layout does not fit the frames.
        """
        self.receiver = Receiver(sensor)
        self.load = BusLoad(sensor.can.bitrate, sensor.can.data_bitrate)
        self.restarted = 0
        """How often a silent board was started anew."""
        self.resets = 0
        """How often the board was reset between two scans."""
        self.brown_outs = 0
        """Resets around which the supply was low."""
        self._sensor = sensor
        self._clock = clock or SystemClock()
        self.link = BusLink(open_bus, presence, self._clock)
        self._hush = Silence(self.receiver)
        self._batch: list[Frame] = []
        self._frames: Iterator[Frame] = iter(())
        self._orders = CommandQueue()
        self._phase = Phase.CLOSED
        self._reason = "closed"
        self._diagnosis = ""
        self._arrival = 0  # of the newest batch of frames
        self._deadline = NEVER
        self._looked_for = -1  # deadline after which the bus was read once more
        self._tag = 0
        self._own_tag = -1  # of the command that was sent to find and start the board
        self._bus_offs = 0
        self._low_supply = -round(LOW_SUPPLY_MEMORY * NANOSECONDS)  # when it was told last
        self._stopped = True  # nothing is lost that a board does not send because it was told so
        self._flowing = False  # a scan came since the board was started
        self._counters_hide = not sensor.can.fd  # numbers of scans, as they have few bits
        self._period = 0
        self._silence = 0
        self._take_period(round(1e6 / sensor.can.scan_rate))

    def open(self) -> None:
        """Begin to look for the board; a bus that cannot be opened yet is tried again by `read`.

        Raises ConfigError when the bus can never be opened with these arguments.
        """
        if self._phase == Phase.CLOSED:
            self.link.settle()
            self._enter(Phase.BUS, "the bus is being opened", 0.0)
            self._connect()

    def close(self) -> None:
        """Tell the board to stop and close the bus; may be called twice."""
        if self._phase in {Phase.START, Phase.SCANS}:
            self._send(Command.STOP)
        self._stopped = True
        self._diagnosis = ""
        self.link.drop()
        self._frames = iter(())
        self._enter(Phase.CLOSED, "closed", 0.0)
        self._orders.fail(self._reason)

    def read(self, timeout: float) -> Scan | None:
        """Return the next whole scan, or None when there was none within `timeout` [s]."""
        wait, end = round(timeout * NANOSECONDS), 0
        while not self._next_scan():
            # While scans flow the time of the newest batch will do, and nothing is due before the next one.
            steady = self._phase is Phase.SCANS and self._arrival + wait < self._deadline
            now = self._arrival if steady else self._clock.monotonic()
            end = end or now + wait
            if now >= end:
                return None
            if steady and not self._orders.pending():
                self._read_frames(end - now)
            else:
                self._wait(now, end)
        return self.receiver.scan

    def submit(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Future[Response]:
        """Send a command, from any thread, while another one reads; scans go on meanwhile.

        After STOP the board is left alone until START. The future raises CommandError when the bus is not open, no
        answer comes within `timeout` [s], or the board refuses.
        """
        return self._orders.put(command, argument, timeout, self._clock.monotonic())

    def request(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Response:
        """Send a command and return the answer, by the thread that reads; scans that come meanwhile are dropped.

        Raises CommandError as the future of `submit` does.
        """
        answer = self.submit(command, argument, timeout)
        if self._phase == Phase.CLOSED:
            self._orders.fail(self._reason)
        while not answer.done():
            self.read(min(timeout, ANSWER_TIMEOUT))
        return answer.result()

    def report(self) -> SourceReport:
        """Return the state for diagnostics; may be called from any thread."""
        health = HEALTH[self._phase] if self._flowing or self._phase != Phase.SCANS else Health.WARN
        return board_report(self, health, self._reason, self._diagnosis)

    def _next_scan(self) -> bool:
        """Feed the frames at hand until one makes a scan whole that may be handed on."""
        receiver = self.receiver
        for frame in self._frames:
            if receiver.feed(frame):
                if self._flowing:
                    self._deadline = self._arrival + self._silence
                else:  # started, or back before it was started again
                    self._flowing = True
                    self._diagnosis = ""
                    self._enter(Phase.SCANS, "receiving scans", self._silence / NANOSECONDS)
                return True
            if receiver.response is not None:
                self._take(receiver.response)
                receiver.response = None
        if receiver.news or receiver.errors.bus_off != self._bus_offs:
            self._look()
        return False

    def _look(self) -> None:
        """Act on what a batch of frames told of bus and board."""
        receiver = self.receiver
        if receiver.errors.bus_off != self._bus_offs:
            self._bus_offs = receiver.errors.bus_off
            self._fail(can.CanOperationError("the controller has taken itself off the bus"), "bus off")
        else:
            receiver.news = False
            if receiver.status.flags & ScanStatus.SUPPLY_LOW:
                self._low_supply = self._clock.monotonic()
            if self._phase != Phase.SCANS:
                return
            if receiver.layout_id not in {None, self._sensor.layout.id}:
                self._identify()
            elif receiver.status.flags & ScanStatus.BOARD_RESET:
                self._reason = "the board was reset: it is being started again"
                self._flowing = False
                self._identify()

    def _wait(self, now: int, end: int) -> None:
        """Let something happen: read frames, or do what is due when there are none."""
        if pending := self._orders.pending():
            self._carry_orders(now)
        late = now >= self._deadline
        if late and (not self.link.is_open or self._looked_for == self._deadline):
            self._overdue()
            return
        due = min(end, self._deadline)
        if pending:
            due = min(due, now + round(PRESENCE_PERIOD * NANOSECONDS))
        left = max(due - now, 0)
        if self.link.is_open:
            deadline = self._deadline
            arrived = self._read_frames(left)
            if late or (not arrived and self._clock.monotonic() >= deadline):
                self._looked_for = deadline  # nothing that came in time is waiting any more
        elif self._phase != Phase.BUS:
            self._clock.sleep(left / NANOSECONDS)
        elif self.link.rest(left):
            self._deadline = self._clock.monotonic()

    def _overdue(self) -> None:
        """Do what a deadline stands for in each phase."""
        if self._phase == Phase.BUS:
            self._try_bus()
            return
        if self._phase == Phase.SCANS:
            self.restarted += 1
            self._flowing = False
            self._reason = "the board sends no whole scans: it is being started again"
            self._diagnosis = "no scans"
            self._ask_adapter()
        elif self._phase == Phase.IDENTITY:
            self._unanswered()
            if self._phase != Phase.IDENTITY:
                return
        elif self._phase in {Phase.RATE, Phase.START}:
            self._reason = "the board answers, but does not start"
            self._diagnosis = "no start"
        self._identify()

    def _unanswered(self) -> None:
        """Tell why a board may not answer; now and then open the bus anew."""
        base = self._sensor.can.base_id
        self._reason = f"no board answers at base identifier 0x{base:X}: check power, cable, bitrate and base_id"
        self._diagnosis = self._hush.cause()
        self._ask_adapter()
        if self.link.is_open and self._hush.too_long(self._clock.monotonic()):
            self.link.drop()
            self._frames = iter(())
            self._enter(Phase.BUS, self._reason, 0.0)
            self._try_bus()

    def _try_bus(self) -> None:
        try:
            self._connect()
        except ConfigError as error:
            self._fail(error)

    def _connect(self) -> None:
        try:
            self.link.connect()
        except can.CanError as error:
            self._fail(error)
            return
        if self._diagnosis in {"", "bus gone"}:
            self._reason = "looking for the board"
        self._identify(anew=True)

    def _identify(self, anew: bool = False) -> None:
        if anew or self._phase != Phase.IDENTITY:
            self._hush.begin(self._clock.monotonic())
        self._enter(Phase.IDENTITY, self._reason, ANSWER_TIMEOUT)
        self._send_own(Command.IDENTIFY)

    def _take(self, response: Response) -> None:
        """Act on an answer."""
        order = self._orders.take(response)
        if order is not None:
            if response.result == Result.OK:
                self._carried_out(response)
            return
        if response.tag != self._own_tag:
            return
        if self._phase == Phase.IDENTITY and response.command == Command.IDENTIFY:
            self._take_identity(response.value)
        elif self._phase == Phase.RATE and response.command == Command.SET_RATE:
            if response.result != Result.OK:
                reason = f"the board refuses a scan period of {self._period} us: {response.reason}"
                self._refuse("rate refused", reason)
                return
            self._take_period(response.value)
            self._enter(Phase.START, self._reason, ANSWER_TIMEOUT)
            self._send_own(Command.START)
        elif self._phase in {Phase.START, Phase.SCANS} and response.command == Command.START and not response.result:
            self._started(response)

    def _take_identity(self, value: int) -> None:
        layout, firmware = value & 0xFFFF, value >> 16
        if layout != self._sensor.layout.id:
            wanted = self._sensor.layout.id
            self._refuse("wrong layout", f"the board has layout {layout}, the sensor file {wanted}")
        elif firmware >> 8 != PROTOCOL_VERSION:
            speaks = (
                f"the board has firmware {version(firmware)}, this driver speaks the protocol of {PROTOCOL_VERSION}.x"
            )
            self._refuse("wrong firmware", speaks)
        else:
            self._enter(Phase.RATE, self._reason, ANSWER_TIMEOUT)
            self._send_own(Command.SET_RATE, self._period)

    def _refuse(self, diagnosis: str, reason: str) -> None:
        self._diagnosis, self._flowing = diagnosis, False
        self._enter(Phase.REFUSED, reason, REFUSED_PERIOD)

    def _started(self, response: Response) -> None:
        if self.receiver.resync(response.value, count_gap=not self._stopped, reset=response.reset):
            self.resets += 1
            recent = self._clock.monotonic() - self._low_supply < LOW_SUPPLY_MEMORY * NANOSECONDS
            self.brown_outs += recent
        if self._phase == Phase.SCANS:  # it was only asked for the number of the next scan
            return
        self._stopped = False
        self.link.settle()
        self._hush.broken()
        self._flowing = False
        self._enter(Phase.SCANS, self._reason, self._silence / NANOSECONDS)

    def _carried_out(self, response: Response) -> None:
        """Go on after an order was carried out."""
        if response.command == Command.SET_RATE:
            self._take_period(response.value)
        elif response.command == Command.STOP:
            self._stopped, self._flowing, self._diagnosis = True, False, ""
            self._enter(Phase.STOPPED, "stopped on request", 0.0)
        elif response.command == Command.START and self._phase != Phase.SCANS:
            self._started(response)

    def _carry_orders(self, now: int) -> None:
        """Send the next order when the board is ready for it, and give up those that take too long."""
        if not self.link.is_open:
            self._orders.fail(self._reason)
        elif self._phase in {Phase.SCANS, Phase.STOPPED, Phase.REFUSED} and (order := self._orders.next()):
            order.tag = self._send(order.command, order.argument)
        self._orders.expire(now, self._reason)

    def _take_period(self, period: int) -> None:
        """Note the time from scan to scan [us] that the board has set; it is set again when the board is started."""
        self._period = period
        self.receiver.set_period(period * 1e3)
        self._silence = max(round(SILENCE * NANOSECONDS), SILENT_SCANS * period * 1000)

    def _read_frames(self, timeout: int) -> bool:
        """Read what is there or comes within `timeout` [ns]; return whether anything happened."""
        self.load.add(self._batch, self._arrival)  # of the read before: scans were handed on first
        self._batch = []
        try:
            frames = self._batch = self.link.read(timeout / NANOSECONDS)
        except (can.CanError, OSError) as error:
            self._fail(error)
            return True
        arrival = self._arrival = self._clock.monotonic()
        self._frames = iter(self.receiver.begin_batch(frames, arrival, self._clock.wall() - arrival))
        if self._counters_hide and self._phase == Phase.SCANS and self.receiver.question_due():
            self._send_own(Command.START)
        return bool(frames)

    def _send_own(self, command: Command, argument: int = 0) -> None:
        self._own_tag = self._send(command, argument)

    def _send(self, command: Command, argument: int = 0) -> int:
        """Send a command and return its tag."""
        self._tag = (self._tag + 1) & 0xFF
        request = Request(command, self._tag, argument)
        if command == Command.START:
            self.receiver.asked(self._tag, self._clock.monotonic())
        try:
            self.link.write((self._sensor.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()))
        except (can.CanError, OSError) as error:
            self._fail(error)
        return self._tag

    def _ask_adapter(self) -> None:
        try:
            self.link.ask_state()
        except (can.CanError, OSError) as error:
            self._fail(error)

    def _fail(self, error: Exception, diagnosis: str = "bus gone") -> None:
        """Give the bus up and try again later."""
        self._diagnosis = diagnosis
        self._frames = iter(())
        self._enter(Phase.BUS, f"the bus is not there, trying again: {one_line(error)}", self.link.fail())
        self._orders.fail(self._reason)

    def _enter(self, phase: Phase, reason: str, timeout: float) -> None:
        self._phase = phase
        if phase in DEAF:
            self.receiver.listening = False
        self._reason = reason
        timed = phase not in {Phase.CLOSED, Phase.STOPPED}
        self._deadline = self._clock.monotonic() + round(timeout * NANOSECONDS) if timed else NEVER
