# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Interrupts of the processes that tests run."""

from __future__ import annotations

import signal


def restore() -> None:
    """Let processes that are started from now on have SIGINT, as they do in the foreground.

    A shell without job control ignores it for what it runs in the background, and children inherit that: Python then
    raises no KeyboardInterrupt, and launch does not end.
    """
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
