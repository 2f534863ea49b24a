# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Separation of contacts in one region, on dense pressure at all phases of the grid; one contact is never split."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.contacts.detection import ContactFinder, ForceEstimate, Region
from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.commands.score import Run, perturbed
from posfet_sim.commands.score import run as score
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import load_scene
from reference.contacts.connected_components import BitMap
from reference.contacts.footprint import Footprints
from reference.contacts.moments import MomentFinder
from reference.contacts.separation import Separator
from reference.dense_pressure import sphere_forces
from support.long_cases import long_cases

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
NOISE = 0.35e-3
VARIANCE = np.full(LAYOUT.taxels, NOISE**2)
SLIDE = load_scene("two_fingers_slide", SENSOR)


@functools.cache
def sphere(x: float, y: float, force: float, radius: float = 1.5e-3, modulus: float = 8e6) -> NDArray[np.float64]:
    spread = SENSOR.device.contact_spread
    forces: NDArray[np.float64] = sphere_forces(x, y, force, radius, modulus, spread, LAYOUT.pitch_x, LAYOUT.rows)
    return forces


def measure(finder: ContactFinder, forces: NDArray[np.float64], before: list[Region]) -> list[Region]:
    finder.update_thresholds(forces, VARIANCE)
    finder.find(forces)
    return list(finder.measure(ForceEstimate(forces, VARIANCE), before))


def test_shares_of_the_reference_equal_an_explicit_gaussian_mixture() -> None:
    """The reference, which the compiled path equals, against an explicit expectation-maximisation by distances."""
    forces = sphere(-1.3e-3, 0.2e-3, 0.8) + sphere(1.9e-3, -0.4e-3, 1.0)
    bitmap, spread = BitMap(LAYOUT.rows, LAYOUT.cols), SENSOR.device.contact_spread
    footprints = Footprints(LAYOUT, bitmap, MomentFinder(LAYOUT, spread))
    [footprint] = footprints.regions(np.ones(LAYOUT.taxels, np.bool_).tobytes())
    start, rounds = np.array([(-1e-3, 0.0), (2e-3, 0.0)]), 3
    width = spread**2 + LAYOUT.pitch_x**2 / 12
    square = ((LAYOUT.positions[None] - start[:, None]) ** 2).sum(axis=2)
    mass = np.array([forces[square.argmin(axis=0) == number].sum() for number in (0, 1)])
    middle = start
    for _ in range(rounds + 1):
        square = ((LAYOUT.positions[None] - middle[:, None]) ** 2).sum(axis=2)
        density = mass[:, None] * np.exp(-0.5 * square / width)
        share = density / density.sum(axis=0)
        mass = share @ forces
        middle = (share * forces) @ LAYOUT.positions / mass[:, None]
    separator = Separator(LAYOUT, spread, SENSOR.contact.threshold)
    found = separator.responsibilities([(-1e-3, 0.0), (2e-3, 0.0)], footprint, forces, rounds)
    assert found is not None
    np.testing.assert_allclose(found, share, rtol=0, atol=1e-9)


def centres(regions: list[Region]) -> list[tuple[float, float]]:
    return sorted(region.centre_of_pressure for region in regions)


def test_two_spheres_two_pitches_apart_stay_separated_at_every_phase_of_the_grid() -> None:
    finder = ContactFinder(SENSOR)
    rng = np.random.default_rng(1)
    gains = rng.normal(1.0, 0.05, LAYOUT.taxels)
    regions: list[Region] = []
    unsplit = 0
    for x in np.linspace(-1.5e-3, 0.0, 31).tolist():
        pair = (x - 0.75e-3, 0.2e-3), (x + 2.25e-3, 0.2e-3)
        forces = (sphere(*pair[0], 0.8) + sphere(*pair[1], 1.0)) * gains + rng.normal(0, NOISE, LAYOUT.taxels)
        fresh = ContactFinder(SENSOR)
        unsplit += len(measure(fresh, forces, [])) == 1
        regions = measure(finder, forces, regions)
        if len(regions) == 1 and x < -1.2e-3:
            continue  # it begins half a pitch off, where there is no saddle yet
        assert len(regions) == 2
        for found, true in zip(centres(regions), pair, strict=True):
            assert math.dist(found, true) < 0.3e-3
        assert sum(region.force for region in regions) == pytest.approx(float(forces.sum()), abs=0.03)
        assert not set(regions[0].taxels) & set(regions[1].taxels)
    assert unsplit > 5, "without memory there must be positions where the two cannot be separated"


@pytest.mark.parametrize(("radius", "modulus", "force"), [(6e-3, 1e6, 2.0), (1.5e-3, 8e6, 1.0), (20e-3, 0.5e6, 3.0)])
def test_one_sphere_is_never_split(radius: float, modulus: float, force: float) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        x, y = rng.uniform(-3e-3, 3e-3, 2)
        forces = sphere(x, y, force, radius, modulus) * rng.normal(1.0, 0.08, LAYOUT.taxels)
        assert len(measure(ContactFinder(SENSOR), forces + rng.normal(0, NOISE, LAYOUT.taxels), [])) == 1


@pytest.mark.parametrize("taxel", range(25))
def test_a_dead_taxel_does_not_split_a_fingertip(taxel: int) -> None:
    for radius, modulus in ((6e-3, 1e6), (3e-3, 2e6)):
        for x, y in ((0.0, 0.0), (0.4e-3, -0.3e-3), (-0.7e-3, 0.7e-3)):
            forces = sphere(x, y, 1.5, radius, modulus).copy()
            forces[taxel] = 0.0
            assert len(measure(ContactFinder(SENSOR), forces, [])) == 1


def test_two_contacts_that_converge_merge_and_separate_again() -> None:
    finder = ContactFinder(SENSOR)
    regions: list[Region] = []
    counts = []
    for apart in [*np.linspace(3e-3, 1e-3, 25).tolist(), *np.linspace(1e-3, 3e-3, 25).tolist()]:
        forces = sphere(-apart / 2, 0.0, 1.0) + sphere(apart / 2, 0.0, 0.9)
        regions = measure(finder, forces, regions)
        counts.append(len(regions))
    assert counts[0] == counts[-1] == 2
    assert counts[25] == 1
    assert np.count_nonzero(np.diff(counts)) == 2


@pytest.mark.parametrize(("saddle", "contacts"), [(0.7, 2), (0.87, 1)])
def test_regions_that_grow_together_stay_separate_only_with_a_saddle(saddle: float, contacts: int) -> None:
    """A pad that first touches at two points is one contact, two fingertips are two."""
    shape = np.outer((0.0, 0.5, 1.0, 0.5, 0.0), (0.6, 1.0, saddle, 1.0, 0.6)).reshape(-1)
    finder = ContactFinder(SENSOR)
    regions: list[Region] = []
    counts = []
    for force in (0.021, 0.022, 0.025, 0.03, 0.04, 0.045, 0.06, 0.1, 0.3, 0.3, 0.06, 0.03):
        regions = measure(finder, force * shape, regions)
        counts.append(len(regions))
    assert counts[:2] == [2] * 2
    assert set(counts[3:]) == {contacts}


def test_a_saddle_between_diagonal_neighbours_is_detected() -> None:
    """Forces [mN] of three balls at (-0.2, 1.9), (-1.8, -2.0) and (2.3, -1.2) mm, of 0.3, 0.3 and 1.5 N."""
    forces = 1e-3 * np.array(
        [24, 74, 5, 38, 43, 44, 137, 18, 482, 541, 2, 7, 11, 170, 191, 0, 38, 153, 14, 1, 0, 16, 64, 5, 0]
    )
    regions = measure(ContactFinder(SENSOR), forces, [])
    found = sorted(region.centre_of_pressure for region in regions)
    np.testing.assert_allclose(found, [(-1.8e-3, -2.0e-3), (-0.2e-3, 1.9e-3), (2.3e-3, -1.2e-3)], rtol=0, atol=0.2e-3)
    peaks = sorted(region.peak_pressure * LAYOUT.taxel_area for region in regions)
    np.testing.assert_allclose(peaks, [0.137, 0.153, 0.541], rtol=0, atol=1e-9)


def test_releasing_one_of_two_contacts_leaves_the_other_in_place() -> None:
    finder = ContactFinder(SENSOR)
    regions: list[Region] = []
    staying, lifting = sphere(-1.5e-3, 0.0, 1.2, 3e-3, 2e6), sphere(1.5e-3, 0.0, 1.0)
    for force in np.linspace(0.8, 0.0, 60).tolist():
        regions = measure(finder, staying + force * lifting, regions)
    [left] = regions
    assert math.dist(left.centre_of_pressure, (-1.5e-3, 0.0)) < 0.05e-3


CALIBRATED = replace(
    ErrorModel.default(),
    gain_spread=0.0,
    area_spread=0.0,
    leak_spread=0.0,
    dead_probability=0.0,
    stuck_probability=0.0,
    noisy_probability=0.0,
    resets_per_hour=0.0,
)
"""The default board without faulty taxels and without the errors that a calibration compensates."""


@pytest.mark.parametrize(
    ("device", "seed"),
    long_cases(
        [
            ({}, 1),
            ({"spread": 20.0}, 5),
            ({"leak": 20.0}, 3),
            ({}, 2),
            ({"d33": -10.0}, 4),
            ({"spread": -20.0}, 6),
        ],
        [({"spread": 20.0}, 5)],
    ),
)
def test_two_fingers_that_slide_side_by_side_keep_their_track_ids(device: dict[str, float], seed: int) -> None:
    other = perturbed(SENSOR, device)
    calibration = Calibration.nominal(SENSOR).with_gain_error(0.05, np.random.default_rng(seed))
    what = Run(SENSOR, load_scene("two_fingers_slide", other), 3.0, seed, CALIBRATED, calibration, other)
    found = score(what)
    assert found.id_switches == 0
    assert found.contact_precision == 1.0
    assert found.contact_recall is not None and found.contact_recall > 0.99
    assert found.cop_error_mm["mean"] is not None and found.cop_error_mm["mean"] < 0.12


def test_the_two_fingers_of_the_scene_get_exactly_two_track_ids() -> None:
    reconstructor = Reconstructor(SENSOR)
    ids, released = set(), []
    for scan, _ in received_scans(SENSOR, SLIDE, 3.6, 1):
        for contact in reconstructor.process(scan).contacts:
            ids.add(contact.id)
            assert contact.merged == ()
            released += [contact.id] * (contact.state is ContactState.RELEASED)
    assert len(ids) == 2
    assert sorted(released) == sorted(ids)
