# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lines of the slcan protocol read in Python, which `posfet_core.protocol.LineReader` agrees with exactly."""

from __future__ import annotations

from binascii import Error as HexError
from binascii import unhexlify
from typing import Final

from posfet_driver.bus.frame import EXTENDED, FD, RATE_SWITCH, REMOTE, Frame

END: Final = b"\r"
REFUSED: Final = b"\a"
"""Reply of an adapter that rejects a line; ends a line like END."""

_FLAGS_LENGTH: Final = 3

FD_LENGTHS: Final = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Data length [byte] of each length code of CAN FD."""

_KINDS: Final = {ord("t"): 0, ord("r"): REMOTE, ord("d"): FD, ord("b"): FD | RATE_SWITCH}
_STANDARD_HEADER: Final = 5
_EXTENDED_HEADER: Final = 10
_TIMESTAMP: Final = 4
_LONGEST: Final = _EXTENDED_HEADER + 2 * FD_LENGTHS[-1] + _TIMESTAMP
_HEADER_CACHE: Final = 4096


class LineReader:
    """Splits a stream of bytes into lines and parses them into frames. Bytes may arrive in any pieces.

    Each header (letter, identifier, length code) is parsed once and cached, up to 4096 of them.
    """

    def __init__(self) -> None:
        self.malformed = 0
        """Number of lines that are no frame, no reply and no acknowledgement."""
        self.refusals = 0
        """Number of lines that the adapter rejected."""
        self.flags: int | None = None
        """Replies to the command F together, bits of FLAG_*; the reader sets it back to None."""
        self._rest = b""
        self._headers: dict[bytes, tuple[int, int, int]] = {}

    def clear(self) -> None:
        """Discard an unfinished line."""
        self._rest = b""

    def lines(self, data: bytes) -> list[bytes]:
        """Return the lines that `data` completes, without their ends; a rejection is the line REFUSED."""
        data = self._rest + data
        if REFUSED in data:
            data = data.replace(REFUSED, REFUSED + END)
        lines = data.split(END)
        self._rest = lines.pop()
        if len(self._rest) > _LONGEST:
            self.malformed += 1
            self._rest = b"?"  # invalidates the rest of this line
        return lines

    def frames(self, data: bytes) -> list[Frame]:
        """Return the frames of the lines that `data` completes."""
        frames: list[Frame] = []
        headers = self._headers
        for line in self.lines(data):
            header = headers.get(line[:_STANDARD_HEADER])
            if header is None:
                self._parse_uncached(line, frames)
                continue
            identifier, kind, end = header
            try:
                if len(line) == end:
                    frames.append((identifier, kind, unhexlify(line[_STANDARD_HEADER:])))
                elif len(line) == end + _TIMESTAMP:
                    frames.append((identifier, kind, unhexlify(line[_STANDARD_HEADER:end])))
                else:
                    self.malformed += 1
            except HexError:
                self.malformed += 1
        return frames

    def _parse_uncached(self, line: bytes, frames: list[Frame]) -> None:
        """Parse a line whose header is not cached."""
        if line in _ACKNOWLEDGEMENTS:
            return
        if line == REFUSED:
            self.refusals += 1
            return
        if line[:1] == b"F" and len(line) == _FLAGS_LENGTH:
            self._parse_flags(line)
            return
        frame = parse_line(line)
        if frame is None:
            self.malformed += 1
            return
        frames.append(frame)
        identifier, kind, data = frame
        if not kind & (EXTENDED | REMOTE):
            if len(self._headers) >= _HEADER_CACHE:
                self._headers.clear()
            self._headers[line[:_STANDARD_HEADER]] = identifier, kind, _STANDARD_HEADER + 2 * len(data)

    def _parse_flags(self, line: bytes) -> None:
        try:
            self.flags = (self.flags or 0) | unhexlify(line[1:])[0]
        except HexError:
            self.malformed += 1


_ACKNOWLEDGEMENTS: Final = (b"", b"z", b"Z")


def parse_line(line: bytes) -> Frame | None:
    """Return the frame of one line without its end, or None for another line. A trailing time stamp is dropped."""
    if not line:
        return None
    extended = line[0] < ord("a")
    kind = _KINDS.get(line[0] | 0x20)
    header = _EXTENDED_HEADER if extended else _STANDARD_HEADER
    if kind is None or len(line) < header:
        return None
    try:
        # Padded to an even number of digits; int() would accept signs and underscores.
        identifier = int.from_bytes(unhexlify(line[1 : header - 1].zfill(8)), "big")
        code = unhexlify(b"0" + line[header - 1 : header])[0]
        length = FD_LENGTHS[code]
        end = header if kind & REMOTE else header + 2 * length
        data = bytes(length) if kind & REMOTE else unhexlify(line[header:end])
    except HexError:
        return None
    highest = 0x1FFF_FFFF if extended else 0x7FF
    fits = len(line) in (end, end + _TIMESTAMP) and identifier <= highest and (kind & FD or code <= 8)
    return (identifier, kind | EXTENDED if extended else kind, data) if fits else None
