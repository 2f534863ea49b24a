# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A stream for a file that must stay readable on a full disk: whole writes only, and space kept for the last ones."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path


class SpaceReserve:
    """Space in a folder that nobody else can take: a file without a name, which ends with the process.

    On file systems without such files nothing is reserved.

    Parameters
    ----------
    folder : Path
        The folder.
    """

    def __init__(self, folder: Path) -> None:
        self._size = 0
        try:
            self._file = os.open(folder, os.O_TMPFILE | os.O_RDWR, 0o600)
        except OSError:
            self._file = -1

    def grow(self, size: int) -> None:
        """Reserve `size` bytes in all; raise OSError if the disk has not got them.

        Parameters
        ----------
        size : int
            Space [byte].
        """
        if self._file < 0 or size <= self._size:
            return
        try:
            os.posix_fallocate(self._file, self._size, size - self._size)
        except OSError as error:
            if error.errno in {errno.ENOSPC, errno.EDQUOT}:
                raise
            self.release()
        else:
            self._size = size

    def release(self) -> bool:
        """Give the space back; return whether there was any."""
        if self._file < 0:
            return False
        os.close(self._file)
        self._file = -1
        return self._size > 0


class WholeWrites:
    """A file that has whole writes only: what cannot be written whole is taken back.

    Parameters
    ----------
    path : Path
        Path of the file.
    reserve : SpaceReserve
        Space that is given back when there is no other.
    overwrite : bool, optional
        Whether to overwrite a file.

    Raises
    ------
    OSError
        The file exists, or cannot be created.
    """

    def __init__(self, path: Path, reserve: SpaceReserve, overwrite: bool = False) -> None:
        self._file = path.open("wb" if overwrite else "xb", buffering=0)
        self._reserve = reserve
        self.size = 0
        """Size of the file [byte]."""
        self.failure: OSError | None = None
        """Why the file must end now: a write that needed the reserve, or failed."""
        self.broken = False
        """Whether a write failed: whoever wrote has lost something."""

    def write(self, data: bytes) -> int:
        """Write all or nothing and return the size; raise OSError for nothing, even with the reserve.

        Parameters
        ----------
        data : bytes
            What to write.
        """
        try:
            return self._write(data)
        except OSError as error:
            self.failure = error
            if not self._reserve.release():
                self.broken = True
                raise
        try:
            return self._write(data)
        except OSError:
            self.broken = True
            raise

    def _write(self, data: bytes) -> int:
        view, done = memoryview(data), 0
        try:
            while done < len(view):
                done += self._file.write(view[done:])
        except OSError:
            with suppress(OSError):  # what is no regular file has no end to move
                self._file.seek(self.size)
                self._file.truncate()
            raise
        self.size += done
        return done

    def tell(self) -> int:
        """Return the size of the file [byte]."""
        return self.size

    def flush(self) -> None:
        """Do nothing: writes are not buffered."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()
