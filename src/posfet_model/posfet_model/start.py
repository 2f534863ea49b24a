"""Entry points of executables: what has to be in place before anything that takes long is imported."""

from __future__ import annotations

import os
import signal
from importlib import import_module


def end_quietly() -> None:
    """Let Ctrl-C and SIGTERM end the process at once, as long as there is nothing yet to end in order."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))


def run(module: str) -> None:
    """Run `main` of a module, loaded only now."""
    end_quietly()
    import_module(module).main()


def model_node() -> None:
    """Run the model node."""
    run("posfet_model.model_node")
