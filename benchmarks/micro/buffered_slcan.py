"""
A buffered reader for python-can's own slcan interface, in the form of a change to it.

It depends on python-can and pyserial alone and overrides one method, so that everything else, such as bit timing,
serial numbers and how a line is interpreted, stays as it is. See ``docs/slcan.md``.
"""

from __future__ import annotations

import re
from collections import deque
from typing import Any, Final

import serial
from can.exceptions import error_check
from can.interfaces.slcan import slcanBus

_LINE: Final = re.compile(rb"[^\r\a]*[\r\a]")
"""A line with its end: carriage return, or bell, which is how an adapter refuses."""


class BufferedSlcanBus(slcanBus):  # type: ignore[misc]  # python-can is not checked here
    """
    slcan interface that takes all bytes there are in one read, where
    :class:`~can.interfaces.slcan.slcanBus` takes one at a time.

    Parameters, messages, replies and errors are those of the base class.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """
        :param args: as for :class:`~can.interfaces.slcan.slcanBus`
        :param kwargs: as for :class:`~can.interfaces.slcan.slcanBus`
        """
        self._lines: deque[str] = deque()
        super().__init__(*args, **kwargs)

    def _read(self, timeout: float | None) -> str | None:
        """
        :param timeout:
            seconds to wait for a whole line or :obj:`None` to wait indefinitely

        :return:
            the next line with its end, or :obj:`None` when there was none in time
        """
        if not self._lines:
            self._fill(serial.Timeout(timeout))
        return self._lines.popleft() if self._lines else None

    def _fill(self, timeout: serial.Timeout) -> None:
        with error_check("Could not read from serial device"):
            while True:
                self._buffer += self.serialPortOrig.read(max(1, self.serialPortOrig.in_waiting))
                end = 0
                for line in _LINE.finditer(self._buffer):
                    self._lines.append(line.group().decode())
                    end = line.end()
                del self._buffer[:end]
                if self._lines or timeout.expired():
                    return

    def flush(self) -> None:
        """Forget everything that was received and not read yet."""
        self._lines.clear()
        super().flush()
