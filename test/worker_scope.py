"""Which tests one worker of pytest-xdist runs: all others are shared test by test."""

from __future__ import annotations

from typing import Final

LIVE: Final = (
    "nodes/",
    "stack/",
    "driver/test_adapter.py",
    "driver/test_adapter_faults.py",
    "driver/test_arrays.py",
    "driver/test_hardware.py",
    "driver/test_long_runs.py",
    "driver/test_socketcan.py",
)
"""Nodes, adapters and processes that have to keep up with a clock: one worker runs them all, so that they do not take
the processors from each other. They take longest and come first.
"""
TOGETHER: Final = ("simulation/test_calibration.py", "simulation/test_score.py", "simulation/test_bench_recording.py")
"""Files with a fixture that takes seconds to make: one worker runs each of them."""


def scope(test: str) -> str:
    """Return the name of what one worker has to run as a whole: the test itself where it is on its own."""
    file = test.split("::", maxsplit=1)[0].removeprefix("test/")
    if file.startswith(LIVE):
        return "live"
    return file if file in TOGETHER else test
