# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Exit codes of processes that run nodes, and the one line that each error ends with."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Final

from posfet_model.command_line import BAD_INPUT
from posfet_model.config import ConfigError

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
