"""A board on a CAN bus as a source of scans: found, told to send, kept going, and found again after every fault."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from enum import Enum
from typing import Final

import can

from posfet_driver.bus import one_line
from posfet_driver.frames import CLASSIC, Frame, FrameBus
from posfet_driver.messages import COMMAND_OFFSET, Command, Request, Response, Result
from posfet_driver.receiver import Receiver
from posfet_driver.source import Clock, Health, SourceReport, SystemClock
from posfet_model.config import ConfigError
from posfet_model.scan import Scan
from posfet_model.sensor import Sensor

BACK_OFF_FIRST: Final = 0.1
BACK_OFF_LAST: Final = 5.0
"""Time between two attempts to open the bus [s]: doubled from the first to the last."""
ANSWER_TIMEOUT: Final = 0.2
"""Time a board has to answer [s]; then it is asked again."""
REFUSED_PERIOD: Final = 1.0
"""Time after which a board with the wrong layout is asked again [s]."""
SILENCE: Final = 0.3
"""Time without any scan [s] after which a board that should send is asked what it is."""
SILENT_SCANS: Final = 10
"""The same in scans, where they come slower."""

_NANOSECONDS: Final = 1_000_000_000


class CommandError(Exception):
    """A board does not do what it was told; the message is one line with its reason."""


class Phase(Enum):
    """What a board is waiting for."""

    CLOSED = "closed"
    BUS = "bus"
    IDENTITY = "identity"
    REFUSED = "refused"
    """Not the board that the sensor file describes."""
    RATE = "rate"
    START = "start"
    SCANS = "scans"
    COMMAND = "command"
    """Stopped on request."""


class Board:
    """One board on a bus. Used by one thread, but for `report`.

    The bus is opened again, with a growing pause, whenever it cannot be opened or fails; a board that does not answer
    or falls silent is identified and started again. Nothing of that raises: `report` tells what is missing and why.
    """

    simulated = False

    def __init__(
        self, sensor: Sensor, open_bus: Callable[[], FrameBus], fd: bool | None = None, clock: Clock | None = None
    ) -> None:
        """Take what opens the bus, and the frame format (None: as in the sensor file).

        Raises ConfigError when the layout does not fit the frames.
        """
        self.receiver = Receiver(sensor, sensor.can.fd if fd is None else fd)
        self.reopened = 0
        """How often the bus was opened anew."""
        self.restarted = 0
        """How often a silent board was started anew."""
        self._sensor = sensor
        self._open_bus = open_bus
        self._clock = clock or SystemClock()
        self._bus: FrameBus | None = None
        self._frames: Iterator[Frame] = iter(())
        self._phase = Phase.CLOSED
        self._reason = "closed"
        self._deadline = 0
        self._back_off = BACK_OFF_FIRST
        self._tag = 0
        self._opened = 0
        self._stopped = True  # nothing is lost that a board does not send because it was told so
        self._flowing = False  # a scan came since the board was started
        self._period = 0
        self._silence = 0
        self._take_period(round(1e6 / sensor.can.scan_rate))

    def open(self) -> None:
        """Begin to look for the board; a bus that cannot be opened yet is tried again by `read`.

        Raises ConfigError when the bus can never be opened with these arguments.
        """
        if self._phase == Phase.CLOSED:
            self._back_off = BACK_OFF_FIRST
            self._enter(Phase.BUS, "the bus is being opened", 0.0)
            self._connect()

    def close(self) -> None:
        """Tell the board to stop and close the bus; may be called twice."""
        if self._bus and self._phase in {Phase.START, Phase.SCANS}:
            self._send(Command.STOP)
        self._stopped = True
        self._drop_bus()
        self._enter(Phase.CLOSED, "closed", 0.0)

    def read(self, timeout: float) -> Scan | None:
        """Return the next whole scan, or None when there was none within `timeout` [s]."""
        end = self._clock.monotonic() + round(timeout * _NANOSECONDS)
        while True:
            if self._next_scan():
                return self.receiver.scan
            now = self._clock.monotonic()
            if now >= end:
                return None
            self._wait(now, end)

    def request(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Response:
        """Send a command and return the answer, by the thread that reads; scans that come meanwhile are dropped.

        After STOP the board is left alone until START. Raises CommandError when the bus is not open, no answer comes
        within `timeout` [s], or the board refuses.
        """
        if not self._bus:
            raise CommandError(f"{command.name}: {self._reason}")
        self._enter(Phase.COMMAND, "stopped on request" if command == Command.STOP else self._reason, timeout)
        self._send(command, argument)
        answer = self._answer(self._deadline)
        if not self._bus:
            raise CommandError(f"{command.name}: {self._reason}")
        if answer is None:
            self._enter(Phase.IDENTITY, "the board did not answer", 0.0)
            raise CommandError(f"{command.name}: no answer within {timeout:g} s")
        self._resume(command, answer)
        if answer.result != Result.OK:
            raise CommandError(f"{command.name}: refused by the board: {answer.reason} (value {answer.value})")
        return answer

    def report(self) -> SourceReport:
        """Return the state for diagnostics; may be called from any thread."""
        receiver = self.receiver
        losses, traffic, status = receiver.assembler.losses, receiver.traffic, receiver.status
        firmware = receiver.firmware
        return SourceReport(
            health=_HEALTH[self._phase] if self._flowing or self._phase != Phase.SCANS else Health.WARN,
            state=self._reason,
            scans=receiver.scans,
            frames_lost=receiver.frames_lost,
            counters={
                "torn scans": losses.torn_scans,
                "lost scans": losses.lost_scans,
                "repeated frames": losses.repeated,
                "late frames": losses.late,
                "malformed frames": losses.malformed + traffic.malformed,
                "foreign frames": traffic.foreign,
                "bus errors": traffic.bus_errors,
                "bus opened anew": self.reopened,
                "board started anew": self.restarted,
            },
            values={
                "temperature 1 [degC]": f"{status.temperatures[0]:.2f}",
                "temperature 2 [degC]": f"{status.temperatures[1]:.2f}",
                "supply [V]": f"{status.supply:.2f}",
                "board flags": str(status.flags),
                "firmware": "not known" if firmware is None else f"{firmware >> 8}.{firmware & 0xFF}",
            },
        )

    def _next_scan(self) -> bool:
        """Feed the frames at hand until one makes a scan whole that may be handed on."""
        receiver = self.receiver
        for frame in self._frames:
            if receiver.feed(frame):
                if self._flowing:
                    self._deadline = self._clock.monotonic() + self._silence
                else:  # started, or back before it was started again
                    self._flowing = True
                    self._enter(Phase.SCANS, "receiving scans", self._silence / _NANOSECONDS)
                return True
            if receiver.response is not None:
                self._take(receiver.response)
                receiver.response = None
        return False

    def _wait(self, now: int, end: int) -> None:
        """Let something happen: read frames, or do what is due when there are none."""
        due = end if self._phase in {Phase.CLOSED, Phase.COMMAND} else min(end, self._deadline)
        left = max(due - now, 0)
        if not self._bus:
            self._clock.sleep(left / _NANOSECONDS)
            arrived = False
        else:
            arrived = self._read_frames(left)
        if not arrived and due == self._deadline and self._clock.monotonic() >= due:
            self._overdue()

    def _overdue(self) -> None:
        """Do what a deadline stands for in each phase."""
        if self._phase == Phase.BUS:
            try:
                self._connect()
            except ConfigError as error:
                self._fail(error)
            return
        if self._phase == Phase.SCANS:
            self.restarted += 1
            self._flowing = False
            self._reason = "the board sends no whole scans: it is being started again"
        elif self._phase == Phase.IDENTITY:
            self._reason = (
                f"no board answers at base identifier 0x{self._sensor.can.base_id:X}: "
                "check power, cable, bitrate and base_id"
            )
        elif self._phase in {Phase.RATE, Phase.START}:
            self._reason = "the board answers, but does not start"
        self._identify()

    def _connect(self) -> None:
        try:
            self._bus = self._open_bus()
        except can.CanError as error:
            self._fail(error)
            return
        self._opened += 1
        self.reopened = self._opened - 1
        self._reason = "looking for the board"
        self._identify()

    def _identify(self) -> None:
        self._enter(Phase.IDENTITY, self._reason, ANSWER_TIMEOUT)
        self._send(Command.IDENTIFY)

    def _take(self, response: Response) -> None:
        """Act on an answer to a command that was sent to find and start the board."""
        if response.tag != self._tag:
            return
        if self._phase == Phase.IDENTITY and response.command == Command.IDENTIFY:
            layout = response.value & 0xFFFF
            if layout != self._sensor.layout.id:
                wanted = self._sensor.layout.id
                self._enter(Phase.REFUSED, f"the board has layout {layout}, the sensor file {wanted}", REFUSED_PERIOD)
                return
            self._enter(Phase.RATE, self._reason, ANSWER_TIMEOUT)
            self._send(Command.SET_RATE, self._period)
        elif self._phase == Phase.RATE and response.command == Command.SET_RATE:
            if response.result != Result.OK:
                self._enter(
                    Phase.REFUSED,
                    f"the board refuses a scan period of {self._period} us: {response.reason}",
                    REFUSED_PERIOD,
                )
                return
            self._take_period(response.value)
            self._enter(Phase.START, self._reason, ANSWER_TIMEOUT)
            self._send(Command.START)
        elif self._phase == Phase.START and response.command == Command.START and response.result == Result.OK:
            self._started(response)

    def _started(self, response: Response) -> None:
        self.receiver.resync(response.value, count_gap=not self._stopped)
        self._stopped = False
        self._back_off = BACK_OFF_FIRST
        self._flowing = False
        self._enter(Phase.SCANS, self._reason, self._silence / _NANOSECONDS)

    def _resume(self, command: Command, answer: Response) -> None:
        """Go on after a command was answered."""
        done = answer.result == Result.OK
        if command == Command.SET_RATE and done:
            self._take_period(answer.value)
        if command == Command.STOP and done:
            self._stopped = True
        elif command == Command.START and done:
            self._started(answer)
        elif not self._stopped:
            self._enter(Phase.IDENTITY, self._reason, 0.0)

    def _take_period(self, period: int) -> None:
        """Note the time from scan to scan [us] that the board has set; it is set again when the board is started."""
        self._period = period
        self.receiver.scan_period = period * 1e3
        self._silence = max(round(SILENCE * _NANOSECONDS), SILENT_SCANS * period * 1000)

    def _answer(self, deadline: int) -> Response | None:
        """Return the answer to the command that was sent last, or None when none comes before `deadline`."""
        while self._bus:
            for frame in self._frames:
                self.receiver.feed(frame)
                response, self.receiver.response = self.receiver.response, None
                if response is not None and response.tag == self._tag:
                    return response
            left = deadline - self._clock.monotonic()
            if left <= 0:
                return None
            self._read_frames(left)
        return None

    def _read_frames(self, timeout: int) -> bool:
        """Read what is there or comes within `timeout` [ns]; return whether anything happened."""
        if not self._bus:
            return False
        try:
            frames = self._bus.read_frames(timeout / _NANOSECONDS)
        except (can.CanError, OSError) as error:
            self._fail(error)
            return True
        arrival = self._clock.monotonic()
        self.receiver.begin_batch(frames, arrival, self._clock.wall() - arrival)
        self._frames = iter(frames)
        return bool(frames)

    def _send(self, command: Command, argument: int = 0) -> None:
        if not self._bus:
            return
        self._tag = (self._tag + 1) & 0xFF
        request = Request(command, self._tag, argument)
        try:
            self._bus.write_frame((self._sensor.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()))
        except (can.CanError, OSError) as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Give the bus up and try again later."""
        self._drop_bus()
        self._enter(Phase.BUS, f"the bus is not there, trying again: {one_line(error)}", self._back_off)
        self._back_off = min(2 * self._back_off, BACK_OFF_LAST)

    def _drop_bus(self) -> None:
        bus, self._bus = self._bus, None
        self._frames = iter(())
        if bus:
            with contextlib.suppress(can.CanError, OSError):  # it may be given up because it does not work
                bus.shutdown()

    def _enter(self, phase: Phase, reason: str, timeout: float) -> None:
        self._phase = phase
        if phase in _DEAF:
            self.receiver.listening = False
        self._reason = reason
        self._deadline = self._clock.monotonic() + round(timeout * _NANOSECONDS)


_DEAF: Final = {Phase.CLOSED, Phase.BUS, Phase.REFUSED, Phase.COMMAND}
"""Phases after which the number of the next scan has to be asked again."""

_HEALTH: Final = {
    Phase.CLOSED: Health.STALE,
    Phase.BUS: Health.ERROR,
    Phase.IDENTITY: Health.WARN,
    Phase.REFUSED: Health.ERROR,
    Phase.RATE: Health.WARN,
    Phase.START: Health.WARN,
    Phase.SCANS: Health.OK,
    Phase.COMMAND: Health.OK,
}
