# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Entry points of executables, and the signal handling that must be in place before slow imports."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Final

from posfet_model.ros.on_demand import load_on_demand

PARENT: Final = "POSFET_PARENT"
"""Environment variable with the id of the process whose end also ends this one."""
BLAS_THREADS: Final = ("OPENBLAS_NUM_THREADS", "GOTO_NUM_THREADS", "OMP_NUM_THREADS")
"""Environment variables that limit the threads of OpenBLAS, in its order."""
_PR_SET_PDEATHSIG: Final = 1


def exit_on_signal() -> None:
    """Let Ctrl-C and SIGTERM end the process at once with exit code 0, as long as there is nothing to clean up."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))


def interrupt_on_signal() -> None:
    """Let Ctrl-C and SIGTERM raise KeyboardInterrupt from here on, so that open work is cleaned up."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)


def limit_blas_threads() -> None:
    """Let the linear algebra of NumPy use one thread, unless a variable of BLAS_THREADS is set.

    Matrices are small here: more threads wait for each other, and take processors from other processes. Without effect
    once NumPy has been imported.
    """
    if not any(os.environ.get(name) for name in BLAS_THREADS):
        os.environ[BLAS_THREADS[0]] = "1"


@contextmanager
def loading() -> Iterator[None]:
    """Load modules in this block without the garbage collector: it would search again and again what stays anyway."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if enabled:
            gc.enable()


def exit_with_parent() -> None:
    """Have the kernel send SIGINT when the process named by PARENT has ended, even if it was killed; Linux only.

    Where another process stands between, such as a debugger that launch puts before the command, its end counts.
    """
    parent = os.environ.pop(PARENT, "")
    if parent and sys.platform == "linux":
        import ctypes  # noqa: PLC0415  # signals are handled sooner without it

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
        try:
            os.kill(int(parent), 0)
        except OSError:  # it ended before the call
            os._exit(0)


def run(module: str) -> None:
    """Import a module and run its `main`."""
    exit_on_signal()
    exit_with_parent()
    limit_blas_threads()
    load_on_demand()
    with loading():
        main = import_module(module).main
    main()


def model_node() -> None:
    """Run the model node."""
    run("posfet_model.ros.model_node")
