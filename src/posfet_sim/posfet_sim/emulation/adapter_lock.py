"""One emulated adapter at a path, whatever process it is in."""

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
    """Return the descriptor of a lock beside a link; it ends with this process, even when that is killed.

    Raises BlockingIOError when somebody has it.
    """
    link.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(link.with_name(f".{link.name}.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
