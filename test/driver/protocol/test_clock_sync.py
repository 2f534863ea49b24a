"""Mapping of the board clock to host time: jitter, bursts, drift, steps."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_driver.protocol.clock_sync import STEP_LIMIT, ClockSync

MILLISECOND = 1_000_000


def stamps(clock: ClockSync, device_times: np.ndarray, arrivals: np.ndarray) -> np.ndarray:
    """Return the mapped times [ns] of frames with device times [us] and arrivals [ns]."""
    pairs = zip(device_times.tolist(), arrivals.tolist(), strict=True)
    return np.array([clock.to_monotonic(device, arrival) for device, arrival in pairs])


def delayed(scans: int, mean_delay: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return device times [us] of a 1 kHz board and arrivals [ns], in order, with exponential delays [ns]."""
    device = 1000 * np.arange(scans)
    delay = np.random.default_rng(seed).exponential(mean_delay, scans)
    return device, np.maximum.accumulate((device * 1000 + delay).astype(np.int64))


def test_jitter_and_bursts_are_removed() -> None:
    device, arrivals = delayed(20_000, 0.3 * MILLISECOND)
    mapped = stamps(ClockSync(), device, arrivals)
    assert (np.diff(mapped[1000:]) > 0).all()
    assert np.abs(mapped[1000:] - device[1000:] * 1000).max() < 0.05 * MILLISECOND


@pytest.mark.parametrize("drift", [-80e-6, 80e-6])
def test_clock_drift_is_tracked(drift: float) -> None:
    device, arrivals = delayed(60_000, 0.3 * MILLISECOND)
    arrivals = (arrivals * (1 + drift)).astype(np.int64)
    mapped = stamps(ClockSync(), device, arrivals)
    assert np.abs(mapped - device * 1000 * (1 + drift))[1000:].max() < 0.2 * MILLISECOND


def test_a_delayed_reader_does_not_shift_the_stamps() -> None:
    device, arrivals = delayed(10_000, 0.1 * MILLISECOND)
    arrivals = np.where((device > 4_000_000) & (device < 7_000_000), 7_000 * MILLISECOND, arrivals)
    mapped = stamps(ClockSync(), device, np.maximum.accumulate(arrivals))
    assert np.abs(mapped[1000:] - device[1000:] * 1000).max() < 0.35 * MILLISECOND


def test_the_clock_offset_is_re_estimated_after_the_board_clock_steps_back() -> None:
    device, arrivals = delayed(10_000, 0.1 * MILLISECOND)
    fallen = np.where(device > 5_000_000, device - 16_000, device)  # 16 scans were lost unnoticed
    mapped = stamps(ClockSync(), fallen, arrivals)
    late = device * 1000 - mapped
    assert late[5001:5500].min() > STEP_LIMIT  # not yet known
    assert np.abs(late[7001:]).max() < 0.05 * MILLISECOND
