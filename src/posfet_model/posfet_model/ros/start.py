"""Entry points of executables: what has to be in place before anything that takes long is imported."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from importlib import import_module
from typing import Final

PARENT: Final = "POSFET_PARENT"
"""Environment variable with the process without which this one must not go on."""
_PR_SET_PDEATHSIG: Final = 1


def end_quietly() -> None:
    """Let Ctrl-C and SIGTERM end the process at once, as long as there is nothing yet to end in order."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))


def end_in_order() -> None:
    """Let Ctrl-C and SIGTERM raise KeyboardInterrupt from here on, so that what was begun is finished."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)


def end_with_parent() -> None:
    """Have the kernel send Ctrl-C's signal when the process that PARENT names has ended, even if killed; Linux only."""
    parent = os.environ.pop(PARENT, "")
    if parent and sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
        if os.getppid() != int(parent):  # it was faster
            os._exit(0)


def run(module: str) -> None:
    """Run `main` of a module, loaded only now."""
    end_quietly()
    end_with_parent()
    import_module(module).main()


def model_node() -> None:
    """Run the model node."""
    run("posfet_model.ros.model_node")
