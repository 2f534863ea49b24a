# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reading and writing of whole files, without trust in what is found at a path.

Every error is an OSError whose `strerror` says what is wrong in a few words.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import Final

from posfet_model._lib.shown import one_line

_PART: Final = ".posfet-{}.part"
"""Name of a file while it is written; short, so that it fits wherever the final name does."""


def read_bytes(path: str | Path, limit: int) -> bytes:
    """Return the content of a regular file.

    Neither a pipe or device, which may never end, nor a file above the limit is read.

    Parameters
    ----------
    path : str or Path
        Path of the file; symbolic links are followed.
    limit : int
        Largest size [byte].

    Raises
    ------
    OSError
        The file cannot be opened, is not regular, or is larger.
    """
    try:
        _check_regular(os.stat(path), limit)  # before opening, which may already act on a device
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError as error:  # a null byte, or a character that the file system cannot encode
        raise OSError(errno.EINVAL, "not a file name") from error
    with open(descriptor, "rb") as stream:
        _check_regular(os.fstat(descriptor), limit)  # it may have been replaced
        content = stream.read(limit + 1)
    if content is None:  # a file of the kernel without data
        raise OSError(errno.EAGAIN, "not a regular file")
    if len(content) > limit:  # it grew, or its size is not known
        raise _too_large(limit)
    return content


def read_text(path: str | Path, limit: int) -> str:
    """Return the text of a regular file in UTF-8, with or without a byte order mark.

    Parameters
    ----------
    path : str or Path
        Path of the file; symbolic links are followed.
    limit : int
        Largest size [byte].

    Raises
    ------
    OSError
        As for `read_bytes`, or it is not UTF-8 text.
    """
    try:
        return read_bytes(path, limit).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, "is not UTF-8 text") from error


def check_folder(path: Path) -> None:
    """Refuse a file whose folder is missing, by the name of the folder.

    Parameters
    ----------
    path : Path
        Path of a file that is to be written.

    Raises
    ------
    OSError
        There is no such folder.
    """
    if not path.parent.is_dir():
        raise OSError(errno.ENOTDIR, f"{one_line(str(path.parent))} is not a folder", str(path))


def write_text(path: str | Path, text: str) -> None:
    """Write a file in UTF-8 that is complete or not there, also after a full disk or a power failure.

    It is written under a random name beside the final one and then renamed. A symbolic link at `path` is replaced, not
    followed. A device, or a link to one, is neither replaced nor written.

    Parameters
    ----------
    path : str or Path
        Path of the file; an existing one is replaced.
    text : str
        Content.

    Raises
    ------
    OSError
        The file cannot be written, or is a device; nothing is left behind, and an existing file is unchanged.
    """
    path = Path(path)
    content = text.encode("utf-8")
    try:
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except ValueError as error:
        raise OSError(errno.EINVAL, "not a file name") from error
    try:
        _check_no_device(path.name, folder)
        part = _PART.format(os.urandom(8).hex())
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        descriptor = os.open(part, flags, 0o666, dir_fd=folder)
        try:
            with open(descriptor, "wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(descriptor)
            os.replace(part, path.name, src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException:
            os.unlink(part, dir_fd=folder)
            raise
        os.fsync(folder)
    finally:
        os.close(folder)


def _check_no_device(name: str, folder: int) -> None:
    try:
        mode = os.stat(name, dir_fd=folder).st_mode
    except OSError:  # nothing there, or a link to nothing
        return
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        raise OSError(errno.EINVAL, "not a regular file")


def _check_regular(status: os.stat_result, limit: int) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "not a regular file")
    if status.st_size > limit:
        raise _too_large(limit)


def _too_large(limit: int) -> OSError:
    return OSError(errno.EFBIG, f"larger than {limit / 1000:.0f} kB")
