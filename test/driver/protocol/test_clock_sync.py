# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Mapping of the board clock to host time: jitter, bursts, drift, steps."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_core.protocol import ClockSync

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


def test_a_delay_of_all_frames_for_seconds_does_not_shift_the_stamps_and_is_stated() -> None:
    device, arrivals = delayed(12_000, 0.1 * MILLISECOND)
    congested = np.where((device > 4_000_000) & (device < 9_000_000), arrivals + 6 * MILLISECOND, arrivals)
    clock = ClockSync()
    mapped = stamps(clock, device[:8900], congested[:8900])
    assert clock.lead == pytest.approx(6 * MILLISECOND, abs=0.6 * MILLISECOND)  # or the board's clock was set back
    mapped = np.append(mapped, stamps(clock, device[8900:], congested[8900:]))
    assert np.abs(mapped[1000:] - device[1000:] * 1000).max() < 0.7 * MILLISECOND
    assert clock.uncertainty < 0.3 * MILLISECOND


@pytest.mark.parametrize("step", [1_000, 16_000])
def test_a_clock_that_steps_back_is_covered_by_the_uncertainty_and_re_estimated(step: int) -> None:
    """Small steps are as well as large ones."""
    device, arrivals = delayed(20_000, 0.1 * MILLISECOND)
    fallen = np.where(device > 5_000_000, device - step, device)
    clock, errors, bounds = ClockSync(), [], []
    for time, arrival, acquired in zip(fallen.tolist(), arrivals.tolist(), device.tolist(), strict=True):
        errors.append(abs(clock.to_monotonic(time, arrival) - acquired * 1000))
        bounds.append(clock.uncertainty)
    late = np.array(errors) - np.array(bounds)
    assert max(errors[5001:6000]) > 0.9 * step * 1000  # not yet known
    assert late[7001:].max() < 0.1 * MILLISECOND
    assert max(errors[17_000:]) < 0.1 * MILLISECOND


def test_frames_with_false_times_are_forgotten_but_bound_the_offset() -> None:
    device, arrivals = delayed(8_000, 0.1 * MILLISECOND)
    clock = ClockSync()
    stamps(clock, device[:4000], arrivals[:4000])
    before, offset = clock.save(), clock.offset
    stamps(clock, device[4000:4010] + 3_000, arrivals[4000:4010])
    assert clock.offset < offset - 2 * MILLISECOND
    clock.restore(before)
    assert clock.offset == offset
    assert clock.uncertainty > 2 * MILLISECOND
    stamps(clock, device[4010:], arrivals[4010:])
    assert clock.uncertainty < 0.3 * MILLISECOND


def test_a_clock_in_doubt_is_mapped_anew_within_a_window() -> None:
    device, arrivals = delayed(8_000, 0.1 * MILLISECOND)
    clock = ClockSync()
    stamps(clock, device[:4000], arrivals[:4000])
    behind = device[4000:] - 70_000
    clock.doubt(int(behind[0]), int(arrivals[4000]))
    assert clock.lead == pytest.approx(70 * MILLISECOND, abs=MILLISECOND)
    mapped = stamps(clock, behind, arrivals[4000:])
    assert np.abs(mapped[1010:] - device[5010:] * 1000).max() < 0.1 * MILLISECOND


def test_after_an_interruption_only_the_frames_since_tell_whether_the_clock_was_set() -> None:
    device, arrivals = delayed(8_000, 0.1 * MILLISECOND)
    clock = ClockSync()
    stamps(clock, device[:4500], arrivals[:4500])
    behind = device[4500:] - 70_000
    stamps(clock, behind[:1], arrivals[4500:4501])
    assert clock.lead < MILLISECOND  # it may have been delayed
    clock.interrupt(int(behind[0]), int(arrivals[4500]))
    assert clock.uncertainty < MILLISECOND  # no reason for a warning yet
    for step in range(500, 3000, 500):
        stamps(clock, behind[step - 499 : step + 1], arrivals[4500 + step - 499 : 4501 + step])
        assert clock.lead == pytest.approx(70 * MILLISECOND, abs=MILLISECOND)
    assert clock.uncertainty > 69 * MILLISECOND


def test_what_is_known_of_retracted_times_bounds_the_offset_for_one_second() -> None:
    device, arrivals = delayed(8_000, 0.1 * MILLISECOND)
    clock = ClockSync()
    stamps(clock, device[:3500], arrivals[:3500])
    before = clock.save()
    stamps(clock, device[3500:3600] + 3_000, arrivals[3500:3600])
    clock.restore(before)
    stamps(clock, device[3600:4590], arrivals[3600:4590])
    assert clock.uncertainty > 2 * MILLISECOND
    stamps(clock, device[4590:4610], arrivals[4590:4610])
    assert clock.uncertainty < 0.3 * MILLISECOND


@pytest.mark.parametrize("drift", [-80e-6, 80e-6])
def test_frames_that_waited_for_a_minute_have_drifted_by_no_more_than_when_they_were_sent(drift: float) -> None:
    device, arrivals = delayed(70_000, 0.1 * MILLISECOND)
    acquired = device * 1000 * (1 + drift)
    arrivals = (arrivals * (1 + drift)).astype(np.int64)
    stopped = (device >= 5_000_000) & (device < 65_000_000)
    kept = ~stopped | (device < 6_000_000)
    read = np.where(stopped, round(65_000 * MILLISECOND * (1 + drift)), arrivals)
    clock = ClockSync()
    errors, bounds, drifts = [], [], []
    for time, arrival, true in zip(device[kept].tolist(), read[kept].tolist(), acquired[kept].tolist(), strict=True):
        stamp = clock.to_monotonic(time, arrival)
        errors.append(abs(stamp - true))
        drifts.append(clock.drift)
        bounds.append(clock.error(0.2 * MILLISECOND, 0.0, arrival - stamp))
    assert max(drifts[5000:6000]) < 0.3 * MILLISECOND
    assert (np.array(errors) <= np.array(bounds))[1000:].all()
    assert max(errors[1000:]) < 0.3 * MILLISECOND
