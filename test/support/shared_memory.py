# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Files of Fast DDS in /dev/shm: which there are, and removal of those whose processes have ended."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

FOLDER: Final = Path("/dev/shm")
LOCKS: Final = ("_el", "_sl")
"""Endings of the files that a process keeps locked as long as it lives and uses the file without them."""


def names(folder: Path = FOLDER) -> set[str]:
    """Return the names of all files of Fast DDS, those of its mutexes included."""
    return {path.name for pattern in ("fastrtps_*", "sem.fastrtps_*") for path in folder.glob(pattern)}


@contextmanager
def _held(lock: Path) -> Iterator[bool]:
    """Lock a file during the block, if it is ours and nobody else has it locked; yield whether it is."""
    try:
        file = os.open(lock, os.O_RDWR | os.O_NOFOLLOW)
    except OSError:  # gone, or of somebody else
        yield False
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield os.fstat(file).st_uid == os.getuid()
    except BlockingIOError:
        yield False
    finally:
        os.close(file)


def remove_abandoned(candidates: Iterable[str], folder: Path = FOLDER) -> set[str]:
    """Remove files of this user whose process has ended, and return their names.

    Fast DDS locks a file beside each of its segments and ports for as long as the process lives, as `fastdds shm clean`
    relies on. A port that only writers have opened has no such file, and stays.

    Parameters
    ----------
    candidates : iterable of str
        Names of files that may be removed, such as those that a test run has made.
    folder : Path, optional
        Folder of the files.

    Returns
    -------
    set of str
        Names of the files removed.
    """
    wanted, removed = set(candidates), set()
    for lock in sorted(name for name in wanted if name.endswith(LOCKS)):
        base = lock[: -len(LOCKS[0])]
        with _held(folder / lock) as abandoned:
            if not abandoned:
                continue
            for name in (base, f"sem.{base}_mutex", lock):
                path = folder / name
                if name in wanted and path.is_file() and path.stat().st_uid == os.getuid():
                    path.unlink()
                    removed.add(name)
    return removed
