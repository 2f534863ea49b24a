# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""
A buffered reader for the slcan interface of python-can, in the form of a change to it.

It depends on python-can and pyserial alone and overrides one method, so that everything else, such as bit timing,
serial numbers and the decoding of lines, is unchanged. See ``docs/slcan.md``.
"""

from __future__ import annotations

import re
from collections import deque
from typing import Any, Final

import serial
from can.exceptions import error_check
from can.interfaces.slcan import slcanBus

_LINE: Final = re.compile(rb"[^\r\a]*[\r\a]")
"""A line with its terminator: carriage return, or bell, by which an adapter rejects a command."""


class BufferedSlcanBus(slcanBus):  # type: ignore[misc]  # python-can is not checked here
    """
    slcan interface that reads all available bytes at once, where
    :class:`~can.interfaces.slcan.slcanBus` reads one at a time.

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
            seconds to wait for a complete line or :obj:`None` to wait indefinitely

        :return:
            the next line with its terminator, or :obj:`None` if none arrived in time
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
        """Discard everything received and not yet read."""
        self._lines.clear()
        super().flush()
