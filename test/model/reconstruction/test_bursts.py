# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Interference in single scans is refused and leaves nothing behind; taps of one scan are not."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.bursts import MOST_IN_A_ROW
from posfet_model.reconstruction.diagnostics import Level, Period, judge
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.reconstruction.scan_clock import ScanCounts
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import volts_per_count
from reference.dense_pressure import sphere_forces
from support.long_cases import crossed, long_cases
from support.scan_player import press, scans

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
FIRST = 500
"""Index of the first scan that may have a burst: by then forces are valid."""


def sphere(x: float, y: float, radius: float, modulus: float) -> NDArray[np.float64]:
    """Return the force on each taxel under 1 N."""
    spread = SENSOR.device.contact_spread
    forces: NDArray[np.float64] = sphere_forces(x, y, 1.0, radius, modulus, spread, LAYOUT.pitch_x, LAYOUT.rows)
    return forces


FINGER = sphere(0.6e-3, -0.4e-3, 6e-3, 1e6)
TIP = sphere(0.0, 0.0, 0.1e-3, 1e9)
"""As sharp as the elastomer skin lets anything be."""

TOUCH = press(1.0, 1.0, 9.0)


def one_taxel(rng: np.random.Generator) -> NDArray[np.float64]:
    pattern = np.zeros(LAYOUT.taxels)
    pattern[rng.integers(LAYOUT.taxels)] = rng.choice([-1.0, 1.0])
    return pattern


def some_taxels(rng: np.random.Generator) -> NDArray[np.float64]:
    return (rng.random(LAYOUT.taxels) < 0.3) * rng.choice([-1.0, 1.0], LAYOUT.taxels)


def both_signs(rng: np.random.Generator) -> NDArray[np.float64]:
    return rng.normal(size=LAYOUT.taxels)


def all_alike(rng: np.random.Generator) -> NDArray[np.float64]:
    return rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.0, LAYOUT.taxels)


def most_alike(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a burst of which two taxels feel next to nothing."""
    pattern = all_alike(rng) * rng.uniform(0.5, 1.0, LAYOUT.taxels)
    pattern[rng.choice(LAYOUT.taxels, 2, replace=False)] *= 0.1
    return pattern


class Interference:
    """Adds bursts of an amplitude [V] to single scans, at random times, so many per second."""

    def __init__(self, volts: float, per_second: float, pattern: Callable[..., NDArray[np.float64]]) -> None:
        self._counts = volts / volts_per_count(SENSOR)
        self._probability = per_second * 1e-3
        self._pattern = pattern
        self._rng = np.random.default_rng(5)
        self.hit: list[int] = []

    def __call__(self, index: int, scan: Scan) -> None:
        if index < FIRST or self._rng.random() >= self._probability:
            return
        if self.hit and self.hit[-1] == index - 1:
            return
        self.hit.append(index)
        added = np.rint(self._counts * self._pattern(self._rng))
        scan.counts[:] = np.clip(scan.counts + added, 0, 0xFFFF).astype(np.uint16)


def run(
    edit: Callable[[int, Scan], None], duration: float, force: Callable[[float], float], shape: NDArray[np.float64]
) -> tuple[Reconstructor, list[Reconstruction], float]:
    """Return the reconstructor, the result of each scan, and the total force after the last one [N]."""
    reconstructor, results = Reconstructor(SENSOR), []
    for index, (_, scan) in enumerate(scans(SENSOR, duration, force=force, shape=shape)):
        edit(index, scan)
        results.append(copy.copy(reconstructor.process(scan)))
    return reconstructor, results, reconstructor.image().total


@pytest.fixture(scope="module")
def undisturbed() -> float:
    """Return the total force at the end of the touch without bursts [N]."""
    return run(lambda index, scan: None, 1.6, TOUCH, FINGER)[2]


@pytest.mark.parametrize(
    ("pattern", "volts"),
    long_cases(
        crossed(
            {each.__name__: each for each in (one_taxel, some_taxels, both_signs, all_alike, most_alike)}, [0.02, 0.05]
        ),
        ["one_taxel-0.05", "some_taxels-0.02", "both_signs-0.02", "all_alike-0.05", "most_alike-0.02"],
    ),
)
def test_bursts_cause_no_contact_and_no_lasting_force(
    volts: float, pattern: Callable[..., NDArray[np.float64]], undisturbed: float
) -> None:
    interference = Interference(volts, 30.0, pattern)
    reconstructor, results, total = run(interference, 1.6, TOUCH, FINGER)
    assert len(interference.hit) >= 20
    assert not any(result.contacts for result in results[:1000])
    states = [contact.state for result in results for contact in result.contacts if result.accepted]
    assert states.count(ContactState.NEW) == 1
    assert {contact.id for result in results for contact in result.contacts} == {1}
    # Bursts below the least jump of 10 mN, as of both signs are, leave a share of h/tau = 1/270 of each.
    assert total == pytest.approx(undisturbed, abs=5e-3)
    assert reconstructor.faulty == 0
    refused = [index for index, result in enumerate(results) if not result.accepted]
    assert set(refused) <= set(interference.hit)
    assert len(refused) >= 0.9 * len(interference.hit)
    assert reconstructor.counts.bursts == len(refused)
    assert all(result.valid for index, result in enumerate(results[FIRST:], FIRST) if index not in refused)


@pytest.mark.parametrize("shape", [FINGER, TIP, np.roll(TIP, 6)])
@pytest.mark.parametrize("newton", [0.2, 1.0])
@pytest.mark.parametrize("samples", [(1.0,), (0.3, 0.9), (0.5, 1.0, 0.5)])
def test_a_tap_of_a_millisecond_is_a_contact_and_no_burst(
    shape: NDArray[np.float64], newton: float, samples: tuple[float, ...]
) -> None:
    """A half-sine of 1 ms gives one or two scans at 1 kHz, as its phase happens to be."""

    def force(time: float) -> float:
        index = round(time * 1000) - 700
        return newton * samples[index] if 0 <= index < len(samples) else 0.0

    reconstructor, results, _ = run(lambda index, scan: None, 0.9, force, shape)
    assert reconstructor.counts.bursts == 0
    first = next(index for index, result in enumerate(results) if result.contacts)
    largest = next(index for index, sample in enumerate(samples) if newton * sample * shape.max() > 0.022)
    assert first == 700 + largest, "the first scan with more than the threshold of 20 mN on a taxel"
    assert results[first].contacts[0].region.force == pytest.approx(newton * samples[largest], rel=0.1, abs=0.01)


@pytest.mark.parametrize(
    ("shape", "rise", "late"),
    [(FINGER, 1e-6, 0), (TIP, 1e-6, 0), (np.ones(LAYOUT.taxels), 1e-6, 1), (np.ones(LAYOUT.taxels), 0.02, 2)],
)
def test_a_touch_that_stays_is_accepted_at_once_or_where_it_covers_the_array_a_scan_later(
    shape: NDArray[np.float64], rise: float, late: int
) -> None:
    """A jump of the whole array is seen a scan late, and so is the end of a steep ramp of it."""
    reconstructor, results, total = run(lambda index, scan: None, 1.0, press(0.4, 0.7, 9.0, rise), shape)
    assert reconstructor.counts.bursts == late
    first = next(index for index, result in enumerate(results) if result.accepted and result.contacts)
    assert first <= 702 + late
    assert total == pytest.approx(0.4 * shape.sum(), rel=0.03)


def test_a_fast_slide_and_strong_vibration_are_no_bursts() -> None:
    def shaking(time: float) -> float:
        return press(1.0, 0.5, 9.0)(time) * (1.0 + 0.4 * math.sin(2 * math.pi * 300 * time))

    reconstructor, results, _ = run(lambda index, scan: None, 1.0, shaking, FINGER)
    assert reconstructor.counts.bursts == 0
    assert all(result.valid for result in results[FIRST:])


def test_a_step_of_one_taxel_is_accepted_with_the_next_scan() -> None:
    def step(index: int, scan: Scan) -> None:
        if index >= 700:
            scan.counts[7] += 300

    reconstructor, results, _ = run(step, 0.8, lambda _: 0.0, FINGER)
    assert reconstructor.counts.bursts == 1
    assert [index for index, result in enumerate(results) if not result.accepted] == [700]


def test_interference_in_every_scan_is_not_refused_for_long() -> None:
    rng = np.random.default_rng(3)

    def storm(index: int, scan: Scan) -> None:
        if index >= 700:
            scan.counts[:] = 0x8000 + np.rint(rng.normal(0, 1000, LAYOUT.taxels)).astype(int)

    _, results, _ = run(storm, 0.9, lambda _: 0.0, FINGER)
    refused = [index for index, result in enumerate(results) if not result.accepted]
    assert refused[:MOST_IN_A_ROW] == [700, 701, 702]
    assert 703 not in refused
    assert len(refused) < 60


def test_bursts_are_reported_in_the_diagnostics() -> None:
    period = Period.between(ScanCounts(), ScanCounts(accepted=999, bursts=3), 0, 0, 0, True, True, False)
    verdict = judge(period)
    assert verdict.level is Level.WARN
    assert "interference" in verdict.text
