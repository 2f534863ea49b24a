# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Keeps what a process writes to standard error out of a picture on the same terminal, and writes it afterwards."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from typing import Final

MOST: Final = 1 << 20
"""Bytes that are kept."""
_CONTROLS: Final = re.compile(r"\x1b\[[0-9;]*m")
_TIME: Final = re.compile(r"^\[(\w+)\] \[[\d.]+\] \[[\w.]+\]: ")
"""What ROS writes before the text of a line: level, time and node."""


class LogCapture:
    """Context manager that redirects standard error into a file, if it is a terminal.

    The file descriptor is redirected, since ROS does not log through Python. A file takes whatever is written without
    anybody reading it, in contrast to a pipe.
    """

    def __init__(self) -> None:
        self._terminal = self._file = -1
        self._begin = 0
        self.newest = ""
        """The newest line, without colours."""

    def __enter__(self) -> LogCapture:
        try:
            if os.isatty(2):
                sys.stderr.flush()
                with tempfile.TemporaryFile() as file:
                    self._file = os.dup(file.fileno())
                self._terminal = os.dup(2)
                os.dup2(self._file, 2)
        except OSError:
            pass  # no standard error, or no folder for temporary files: then it is written into the picture
        return self

    def __exit__(self, *_: object) -> None:
        if self._terminal < 0:
            return
        sys.stderr.flush()
        os.dup2(self._terminal, 2)
        os.close(self._terminal)
        self._terminal = -1
        os.lseek(self._file, 0, os.SEEK_SET)
        while chunk := os.read(self._file, 65536):
            os.write(2, chunk)
        os.close(self._file)

    def update(self) -> None:
        """Look for new lines."""
        if self._terminal < 0:
            return
        end = os.fstat(self._file).st_size
        if end > self._begin:
            tail = os.pread(self._file, 4096, max(self._begin, end - 4096)).decode(errors="replace")
            lines = [line for line in _CONTROLS.sub("", tail).splitlines() if line.strip()]
            self.newest = _TIME.sub(r"\1: ", lines[-1].strip()) if lines else self.newest
            self._begin = end
        if end > MOST:
            os.ftruncate(self._file, 0)
            os.lseek(self._file, 0, os.SEEK_SET)  # the position is shared with descriptor 2
            self._begin = 0
