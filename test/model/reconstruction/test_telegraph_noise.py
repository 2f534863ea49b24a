# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A taxel that switches between two levels: found, excluded, and no reason for a contact; sharp tips are none."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import RETURN_MEMORY as MEMORY
from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.reconstruction.taxel_faults import TaxelStatus
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import volts_per_count
from reference.dense_pressure import sphere_forces
from support.long_cases import crossed, long_cases
from support.scan_player import press, scans

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
TOUCH = press(1.0, 6.0, 7.0)


def sphere(x: float, y: float, radius: float, modulus: float) -> NDArray[np.float64]:
    """Return the force on each taxel under 1 N."""
    spread = SENSOR.device.contact_spread
    forces: NDArray[np.float64] = sphere_forces(x, y, 1.0, radius, modulus, spread, LAYOUT.pitch_x, LAYOUT.rows)
    return forces


FINGER = sphere(1.5e-3, 1.5e-3, 6e-3, 1e6)


class Telegraph:
    """Adds a level [V] to one taxel, on and off for random times of 0.05 to 2 s, until `end` [s]."""

    def __init__(self, taxel: int, volts: float, seed: int, end: float = math.inf) -> None:
        self._taxel, self._end = taxel, end
        self._counts = round(volts / volts_per_count(SENSOR))
        self._rng = np.random.default_rng(seed)
        self._next, self._high = 0.5, False

    def __call__(self, time: float, scan: Scan) -> None:
        if time >= self._next:
            self._high = not self._high
            self._next += math.exp(self._rng.uniform(math.log(0.05), math.log(2.0)))
        if self._high and time < self._end:
            scan.counts[self._taxel] += self._counts


def well(time: float, scan: Scan) -> None:
    """No fault."""


def run(
    edit: Callable[[float, Scan], None],
    duration: float,
    force: Callable[[float], float] = lambda _: 0.0,
    shape: NDArray[np.float64] = FINGER,
    sensor: Sensor = SENSOR,
) -> tuple[list[Reconstruction], list[NDArray[np.uint8]]]:
    """Return the result and the status of the taxels after each scan."""
    reconstructor, results, statuses = Reconstructor(sensor), [], []
    for time, scan in scans(sensor, duration, force=force, shape=shape):
        edit(time, scan)
        results.append(copy.copy(reconstructor.process(scan)))
        statuses.append(reconstructor.status().copy())
    return results, statuses


@pytest.mark.parametrize(("taxel", "seed"), long_cases([(6, 1), (5, 2), (6, 3), (0, 4)], [(6, 1), (0, 4)]))
def test_telegraph_noise_is_found_and_the_next_touch_is_one_contact_of_its_own(taxel: int, seed: int) -> None:
    """In the middle, at an edge and in a corner."""
    results, statuses = run(Telegraph(taxel, 3e-3, seed), 8.5, TOUCH)
    others = np.delete(np.array(statuses), taxel, axis=1)
    assert not others.any()
    found = [row[taxel] for row in statuses].index(TaxelStatus.NOISY)
    assert found < 6000
    assert {row[taxel] for row in statuses[found:]} == {TaxelStatus.NOISY}
    assert not any(result.contacts for result in results[found + 50 : 6000])
    earlier = {contact.id for result in results[:6000] for contact in result.contacts}
    held = [result.contacts for result in results[6100:7000]]
    assert all(len(contacts) == 1 for contacts in held)
    assert {contact.id for [contact] in held}.isdisjoint(earlier)
    assert held[-1][0].region.force == pytest.approx(FINGER.sum(), abs=0.03)
    assert not any(result.contacts for result in results[7100:])
    assert all(result.valid for result in results[6000:7100])
    assert all(result.valid for result in results[7650:]), "the total force may be uncertain for a while after it"


@pytest.mark.parametrize("taxel", long_cases([6, 5], [5]))
def test_a_contact_that_one_taxel_feels_alone_ends(taxel: int) -> None:
    """A level that stays looks like a force that grows, until its neighbours contradict it."""

    def step(time: float, scan: Scan) -> None:
        scan.counts[taxel] += round(10e-3 / volts_per_count(SENSOR)) if time > 1.0 else 0

    results, statuses = run(step, 4.0, press(1.0, 3.0, 9.0))
    felt = [index for index, result in enumerate(results[:3000]) if result.contacts]
    assert len(felt) < 300, "200 ms to be sure, in steps of 60 ms"
    assert statuses[felt[-1]][taxel] == TaxelStatus.STUCK if felt else True
    [contact] = results[-1].contacts
    assert contact.region.force == pytest.approx(FINGER.sum(), abs=0.03)


def test_a_taxel_recovers_from_telegraph_noise() -> None:
    _, statuses = run(Telegraph(6, 3e-3, 1, end=6.0), 6.0 + MEMORY + 2.0)
    assert statuses[6000][6] == TaxelStatus.NOISY
    assert statuses[-1][6] == TaxelStatus.OK


@pytest.mark.slow
def test_telegraph_noise_outlasts_a_touch_that_varies() -> None:
    # Under such a force no level comes again. The taxel restarted, as if nothing touched: its force was missing.
    def force(time: float) -> float:
        return press(1.5, 4.0, 20.0)(time) * (1.0 + 0.3 * math.sin(3.0 * time))

    results, statuses = run(Telegraph(12, 3e-3, 2), 21.5, force, sphere(0.0, 0.0, 6e-3, 1e6))
    assert {int(row[12]) for row in statuses[4000:20000]} == {TaxelStatus.NOISY}
    for index in range(4500, 20000):
        [contact] = results[index].contacts
        assert abs(contact.region.force - force(0.001 * index)) < 3.0 * math.sqrt(contact.region.force_variance)


PLACES = {
    "place0": (0.0, 0.0),
    "place1": (3e-3, 0.0),
    "place2": (3.7e-3, 3.7e-3),
    "place3": (-1.5e-3, 0.0),
    "place4": (3.6e-3, 0.3e-3),
    "place5": (3e-3, -3e-3),
}
"""Of a tip [m]."""


@pytest.mark.parametrize(
    ("slow_leak", "place"), long_cases(crossed([False, True], PLACES), ["False-place1", "True-place0"])
)
def test_the_sharpest_tip_on_one_taxel_is_neither_alone_nor_telegraph_noise(
    slow_leak: bool, place: tuple[float, float]
) -> None:
    """Also at the rim of the array, pressed for long and tapped at random; with a leak so slow that levels are flat."""
    sensor = replace(SENSOR, device=replace(SENSOR.device, leak_time_constant=5.0)) if slow_leak else SENSOR
    tip = sphere(*place, 0.1e-3, 1e9)
    rng, times = np.random.default_rng(8), [3.0]
    while times[-1] < 5.5:
        times.append(times[-1] + rng.uniform(0.05, 0.4))

    def force(time: float) -> float:
        tapped = sum(time >= one for one in times) % 2 == 1 and time < 5.5
        return press(0.3, 0.5, 2.5)(time) + 0.05 * tapped

    results, statuses = run(well, 6.0, force, tip, sensor)
    assert not np.isin(np.array(statuses), (TaxelStatus.NOISY, TaxelStatus.STUCK, TaxelStatus.DEAD)).any()
    if tip.max() > 0.3:
        assert all(result.contacts for result in results[520:2500] if result.accepted)
        states = [contact.state for result in results for contact in result.contacts if result.accepted]
        assert states.count(ContactState.NEW) >= 2
