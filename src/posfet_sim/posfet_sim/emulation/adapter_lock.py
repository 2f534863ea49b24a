"""Lock that allows one emulated adapter at a path, across processes."""

from __future__ import annotations

import fcntl
import os
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
        The lock file cannot be created.
    """
    link.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(link.with_name(f".{link.name}.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
