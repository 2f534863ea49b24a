# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lock that allows one emulated adapter at a path, across processes."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from pathlib import Path


def is_served(link: Path | str) -> bool:
    """Return whether an emulated adapter of any process serves the terminal at `link`."""
    try:
        os.close(lock(Path(link)))
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def lock(link: Path) -> int:
    """Lock a path; the lock ends when its descriptor is closed or this process ends, even when it is killed.

    Parameters
    ----------
    link : Path
        Path of the adapter; the lock file `.<name>.lock` is beside it.

    Returns
    -------
    int
        File descriptor of the lock.

    Raises
    ------
    BlockingIOError
        Another process or adapter has the lock.
    OSError
        The lock file cannot be created, or what is at its path is no regular file of this user.
    """
    link.parent.mkdir(parents=True, exist_ok=True)
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        descriptor = os.open(link.with_name(f".{link.name}.lock"), flags, 0o600)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "its lock file is a symbolic link") from error
        raise
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid() or status.st_nlink > 1:
            raise OSError(errno.EPERM, "its lock file is no regular file of this user")
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
