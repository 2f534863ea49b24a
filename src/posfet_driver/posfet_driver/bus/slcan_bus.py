# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A buffered slcan bus for python-can: reads all waiting bytes at once and parses many lines in one pass."""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import termios
import time
import tty
from collections import deque
from typing import Any, Final

import can

from posfet_core.protocol import LinePort
from posfet_driver.bus.error_frame import BUS_ERROR, CONTROLLER, PASSIVE, WARNING, error_frame
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.bus.slcan_codec import (
    END,
    FLAG_BUS_ERROR,
    FLAG_OVERFLOW,
    FLAG_PASSIVE,
    FLAG_WARNING,
    REFUSED,
    LineReader,
    encode_line,
)

BITRATES: Final = {
    10_000: b"S0",
    20_000: b"S1",
    50_000: b"S2",
    100_000: b"S3",
    125_000: b"S4",
    250_000: b"S5",
    500_000: b"S6",
    750_000: b"S7",
    1_000_000: b"S8",
    83_300: b"S9",
}
"""Command for each nominal bit rate [bit/s]."""

DATA_BITRATES: Final = {2_000_000: b"Y2", 5_000_000: b"Y5"}
"""Command for each bit rate of the data phase [bit/s]."""

READ_SIZE: Final = 1 << 16
"""Largest number of bytes read at once."""
REPLY_TIMEOUT: Final = 0.1
"""Time within which an adapter replies [s]; some never do."""
WAIT: Final = 3600.0
"""Time after which a reader without a time-out waits again [s]."""
SILENT: Final = 2
"""Commands in a row without a reply after which none is waited for: an adapter is then one that never replies."""


class SlcanBus(can.BusABC):  # type: ignore[misc]  # python-can is not checked here
    """A serial-line CAN adapter (slcan), classic and FD.

    Not supported: bit-timing registers, the adapter's own time stamps, and waiting for the acknowledgement of a sent
    frame. It needs a serial port; a socket does not work.

    Parameters
    ----------
    channel : str
        Serial port.
    bitrate : int, optional
        Nominal bit rate [bit/s]; None leaves it as the adapter has it.
    data_bitrate : int, optional
        Bit rate of the CAN FD data phase [bit/s]; None leaves it as the adapter has it.
    fd : bool, default False
        Whether the bus carries CAN FD.
    tty_baudrate : int, default 115200
        Speed of the serial port [bit/s].
    listen_only : bool, default False
        Whether the adapter only listens.
    can_filters : optional
        Filters of python-can; `read_frames` ignores them.

    Raises
    ------
    ValueError
        For a bit rate that slcan has no command for.
    can.CanInitializationError
        When the port cannot be opened, is in use, or the adapter refuses.
    """

    def __init__(
        self,
        channel: str,
        bitrate: int | None = None,
        data_bitrate: int | None = None,
        fd: bool = False,
        tty_baudrate: int = 115_200,
        listen_only: bool = False,
        can_filters: Any = None,
    ) -> None:
        commands = [b"C"]
        if bitrate is not None:
            commands.append(_command("bitrate", bitrate, BITRATES))
        if fd and data_bitrate is not None:
            commands.append(_command("data_bitrate", data_bitrate, DATA_BITRATES))
        commands.append(b"L" if listen_only else b"O")
        speed = getattr(termios, f"B{tty_baudrate}", None)
        if speed is None:
            raise ValueError(f"tty_baudrate must be a speed of the serial port, got {tty_baudrate}")
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        self.channel_info = f"slcan {channel}"
        self._reader = LineReader()
        self._frames: deque[Frame] = deque()
        self._fd = _open_port(channel, speed)
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        self._port = LinePort(self._fd, self._reader)
        self._open = True
        self._unanswered = False  # the last question for the flags
        try:
            silent = 0
            for command in commands:
                replied = self._configure(command, REPLY_TIMEOUT if silent < SILENT else 0.0)
                silent = 0 if replied else silent + 1
        except BaseException:
            self._release()
            raise
        super().__init__(channel, can_filters=can_filters)

    arrival_stamp = 0

    @property
    def unreadable(self) -> int:
        """Number of lines that are no frame and no reply."""
        return self._reader.malformed

    @property
    def port(self) -> LinePort:
        """Compiled port of the bus."""
        return self._port

    @property
    def read_by_port(self) -> bool:
        """Whether all frames can be read from the port now: none waits here."""
        return not self._frames

    @property
    def must_be_asked(self) -> bool:
        """Whether the adapter, which tells its flags only when asked, has answered the last question for them."""
        return not self._unanswered  # else it refuses the command, or never replies: it would do no better again

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return the frames that are waiting; when there is none, wait for the first.

        Parameters
        ----------
        timeout : float
            Longest time to wait [s].

        Returns
        -------
        list of Frame
            Frames and error frames, not filtered; empty after the timeout.

        Raises
        ------
        can.CanOperationError
            When the adapter is disconnected.
        """
        frames = self._read_frames(timeout)
        if self._reader.flags is not None:
            frames += _errors(self._reader.flags)
            self._reader.flags = None
            self._unanswered = False
        if self._frames:
            frames = [*self._frames, *frames]
            self._frames.clear()
        return frames

    def write_frame(self, frame: Frame) -> bool:
        """Send one frame. Raises can.CanOperationError when the adapter is disconnected or blocks for 0.1 s."""
        self._write(encode_line(frame), REPLY_TIMEOUT)
        return True

    def ask_state(self) -> None:
        """Request the adapter's status flags, which are read as an error frame; adapters without flags refuse."""
        self._write(b"F" + END, REPLY_TIMEOUT)
        self._unanswered = True

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one message; see can.BusABC."""
        if msg.is_error_frame:
            raise ValueError("an error frame cannot be sent")
        self._write(encode_line(frame_of(msg)), timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        end = None if timeout is None else time.monotonic() + timeout
        while not self._frames:
            left = None if end is None else max(end - time.monotonic(), 0.0)
            self._frames.extend(self._read_frames(WAIT if left is None else left))
            if left == 0:
                break
        if not self._frames:
            return None, False
        return message_of(self._frames.popleft(), time.time()), False

    def fileno(self) -> int:
        """Return the file descriptor of the serial port."""
        return self._fd

    def shutdown(self) -> None:
        """Close the adapter's channel and the port; may be called twice."""
        super().shutdown()
        if self._open:
            with contextlib.suppress(can.CanOperationError):  # a disconnected adapter is closed
                self._write(b"C\r", REPLY_TIMEOUT)
            self._release()

    def _release(self) -> None:
        self._open = False
        os.close(self._fd)

    def _configure(self, command: bytes, timeout: float) -> bool:
        """Send a command and wait for the reply; return whether it came. Any reply to closing counts as success."""
        self._write(command + END, REPLY_TIMEOUT)
        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0:
            for line in self._reader.lines(self._read(left)):
                if line == REFUSED and command != b"C":
                    raise can.CanInitializationError(f"the adapter refuses the command {command.decode()}")
                if line in {b"", REFUSED}:
                    return True
        return False

    def _read_frames(self, timeout: float) -> list[Frame]:
        """Return the waiting frames; wait up to `timeout` [s] for the first bytes."""
        if not self._open:
            raise can.CanOperationError("the bus is closed")
        try:
            return self._port.read(timeout)
        except EOFError as error:
            raise can.CanOperationError(f"adapter disconnected: {error}") from error
        except OSError as error:
            raise can.CanOperationError(f"adapter disconnected: {error.strerror}") from error

    def _read(self, timeout: float) -> bytes:
        """Return the waiting bytes while the adapter is configured; wait up to `timeout` [s] for the first."""
        if not self._poll.poll(timeout * 1000):
            return b""
        try:
            data = os.read(self._fd, READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise can.CanOperationError(f"adapter disconnected: {error.strerror}") from error
        if not data:
            raise can.CanOperationError("adapter disconnected: end of file")
        return data

    def _write(self, line: bytes, timeout: float | None) -> None:
        """Write all of `line` within `timeout` [s]; a partial write counts as a failure of the adapter."""
        if not self._open:
            raise can.CanOperationError("the bus is closed")
        end = None if timeout is None else time.monotonic() + timeout
        while line:
            try:
                line = line[os.write(self._fd, line) :]
            except BlockingIOError:
                left = None if end is None else end - time.monotonic()
                if left is not None and left <= 0:
                    raise can.CanOperationError("the adapter accepts no more data") from None
                select.select([], [self._fd], [], left)
            except OSError as error:
                raise can.CanOperationError(f"adapter disconnected: {error.strerror}") from error


def _errors(flags: int) -> list[Frame]:
    """Return an adapter's status flags as an error frame; no frame when no error flag is set."""
    controller = (
        PASSIVE * bool(flags & FLAG_PASSIVE) | 0x01 * bool(flags & FLAG_OVERFLOW) | WARNING * bool(flags & FLAG_WARNING)
    )
    classes = CONTROLLER * bool(controller) | BUS_ERROR * bool(flags & FLAG_BUS_ERROR)
    return [error_frame(classes, controller)] if classes else []


def _command(name: str, value: int, commands: dict[int, bytes]) -> bytes:
    if value not in commands:
        raise ValueError(f"{name} must be one of {', '.join(map(str, sorted(commands)))} with slcan, got {value}")
    return commands[value]


def _open_port(channel: str, speed: int) -> int:
    """Return the descriptor of a serial port in raw mode, with empty buffers, locked against a second driver."""
    try:
        port = os.open(channel, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise can.CanInitializationError(f"{channel}: {error.strerror}") from error
    try:
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
        tty.setraw(port)
        attributes = termios.tcgetattr(port)
        attributes[4] = attributes[5] = speed
        termios.tcsetattr(port, termios.TCSANOW, attributes)
        termios.tcflush(port, termios.TCIOFLUSH)
    except (OSError, termios.error) as error:
        os.close(port)
        in_use = isinstance(error, BlockingIOError)
        reason = "in use by another process" if in_use else f"not a serial port: {os.strerror(error.args[0])}"
        raise can.CanInitializationError(f"{channel}: {reason}") from error
    return port
