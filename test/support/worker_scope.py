"""Groups of tests that one worker of pytest-xdist runs; all others are distributed test by test."""

from __future__ import annotations

from typing import Final

LIVE: Final = ("model/ros/", "driver/ros/", "sim/ros/", "stack/", "driver/board/test_hardware.py")
"""Nodes and processes that run in real time: one worker runs them all, so that they do not compete for the processors.
They take longest and start first.
"""
TOGETHER: Final = (
    "sim/calibration/test_calibration.py",
    "sim/calibration/test_bench_recording.py",
    "sim/calibration/test_real_film.py",
    "sim/commands/test_score.py",
)
"""Files with a fixture that takes seconds to set up: one worker runs each of them."""


def scope(test: str) -> str:
    """Return the group of a test that one worker runs as a whole; the test itself if it has none."""
    file = test.split("::", maxsplit=1)[0].removeprefix("test/")
    if file.startswith(LIVE):
        return "live"
    return file if file in TOGETHER else test
