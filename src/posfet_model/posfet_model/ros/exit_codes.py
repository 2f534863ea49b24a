"""Exit codes of processes that run nodes, and the one line that each error ends with."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Final

from posfet_model.config import ConfigError

BAD_INPUT: Final = 1
PROCESS_FAILED: Final = 3
"""Exit code of a process that ended on internal errors: whoever started it should start it again."""
INTERRUPTED: Final = 130
"""Exit code after a second Ctrl-C during start-up, by the convention of shells."""


class InternalError(Exception):
    """A process cannot go on after errors of its own; the message is one line."""


def exit_code(run: Callable[[], int]) -> int:
    """Return the exit code of what runs nodes; its errors are printed in one line.

    Parameters
    ----------
    run : callable
        Runs nodes and returns the exit code; may raise ConfigError, InternalError or KeyboardInterrupt.
    """
    try:
        return run()
    except ConfigError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    except InternalError as error:
        print(f"{error}: ending with exit code {PROCESS_FAILED}", file=sys.stderr)
        return PROCESS_FAILED
    except KeyboardInterrupt:  # before there was anything to clean up
        return INTERRUPTED
