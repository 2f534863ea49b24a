# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Pressure of a sphere: verified against Hertz's closed forms and an independent quadrature, and its total force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_model.sensor.description import Layout
from posfet_sim.contact.closed_forms import hertz_ellipse
from posfet_sim.contact.indenters import FLAT, Sphere
from posfet_sim.contact.taxel_forces import MIN_RELATIVE_SPREAD, Cells, skin_spread
from support.sweep import assert_all_refused, decades, refusals

LAYOUT = Layout(id=1, rows=4, cols=5, pitch_x=1.5e-3, pitch_y=1.2e-3, taxel_area=1e-6)
WIDE = Layout(id=1, rows=64, cols=64, pitch_x=1.5e-3, pitch_y=1.5e-3, taxel_area=1e-6)
SPREAD = 0.6e-3
RADIUS = 5e-3
MODULUS = 2e6
QUADRATURE_ERROR = 3e-6
"""Stated error of a taxel's force as a share of the total."""

normal_below = np.vectorize(lambda z: 0.5 * math.erfc(-z / math.sqrt(2)))


def forces(layout: Layout, spread: float, x: float, y: float, force: float, modulus: float = MODULUS) -> np.ndarray:
    out = np.zeros((layout.rows, layout.cols))
    where = [np.array([value]) for value in (x, y, 0.0, force)]
    patch = Cells(layout, spread).press([Sphere(RADIUS, modulus).footprints(force, spread, FLAT)], *where)
    if patch is not None:
        out[patch.rows, patch.cols] += patch.force[0]
    return out


def contact_radius(force: float) -> float:
    """Return the Hertz contact radius [m]."""
    return (3 * force * RADIUS / (4 * MODULUS)) ** (1 / 3)


def quadrature(layout: Layout, spread: float, x: float, y: float, force: float, radius: float, n: int) -> np.ndarray:
    """Polar nodes (Gauss in theta with r = a*sin(theta), equal angles) and math.erfc, unlike the implementation."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    theta = (nodes + 1) * math.pi / 4
    weights = weights * math.pi / 4 * 3 * np.sin(theta) * np.cos(theta) ** 2  # p(r)*2*pi*r dr over F
    angle = (np.arange(2 * n) + 0.5) * math.pi / n
    node_x = (x + radius * np.sin(theta)[:, None] * np.cos(angle)).ravel()
    node_y = (y + radius * np.sin(theta)[:, None] * np.sin(angle)).ravel()
    weight = np.repeat(weights / (2 * n), 2 * n)
    edges_x = (np.arange(layout.cols + 1) - layout.cols / 2) * layout.pitch_x
    edges_y = (np.arange(layout.rows + 1) - layout.rows / 2) * layout.pitch_y
    within_x = np.diff(normal_below((edges_x - node_x[:, None]) / spread), axis=1)
    within_y = np.diff(normal_below((edges_y - node_y[:, None]) / spread), axis=1)
    return force * (within_y * weight[:, None]).T @ within_x


@settings(deadline=None)
@given(decades(1e-6, 1e4), decades(1e-4, 1.0), decades(1e3, 1e12))
def test_hertz_contact_satisfies_its_closed_form_relations(force: float, radius: float, modulus: float) -> None:
    sphere = Sphere(radius, modulus)
    expected = (3 * force * radius / (4 * modulus)) ** (1 / 3)
    load = 4 / 3 * modulus * math.sqrt(radius) * sphere.indentation(force, FLAT) ** 1.5
    assert load == pytest.approx(force, rel=1e-9)
    assert sphere.area(force, FLAT) == pytest.approx(math.pi * expected**2, rel=1e-9)
    (footprint,) = sphere.footprints(force, SPREAD, FLAT)
    assert (footprint.half_length, footprint.half_width) == pytest.approx((expected, expected), rel=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.floats(-4e-3, 4e-3), st.floats(-3e-3, 3e-3), decades(1e-3, 30.0))
def test_taxel_forces_agree_with_quadrature(x: float, y: float, force: float) -> None:
    radius = contact_radius(force)
    reference = quadrature(LAYOUT, SPREAD, x, y, force, radius, 32)
    np.testing.assert_allclose(forces(LAYOUT, SPREAD, x, y, force), reference, rtol=0, atol=QUADRATURE_ERROR * force)


@pytest.mark.parametrize("ratio", [0.01, 0.99, 1.01, 2.5, 5.0, 7.99, 12.3, 20.0])
def test_taxel_forces_agree_with_quadrature_for_all_ratios_of_contact_radius_to_spread(ratio: float) -> None:
    force = 1.3
    radius = contact_radius(force)
    spread = radius / ratio
    for x, y in ((0.0, 0.0), (0.31e-3, 0.6e-3), (-1.1e-3, 0.4e-3)):
        reference = quadrature(LAYOUT, spread, x, y, force, radius, max(16, round(5 * ratio)))
        found = forces(LAYOUT, spread, x, y, force)
        np.testing.assert_allclose(found, reference, rtol=0, atol=QUADRATURE_ERROR * force)


def test_taxel_forces_for_the_smallest_spread_agree_with_a_fine_grid() -> None:
    force, x, y, parts = 1.3, 0.31e-3, -0.5e-3, 400
    radius = contact_radius(force)
    grid_x = (np.arange(LAYOUT.cols * parts) + 0.5) / parts - LAYOUT.cols / 2
    grid_y = (np.arange(LAYOUT.rows * parts) + 0.5) / parts - LAYOUT.rows / 2
    square = (grid_x * LAYOUT.pitch_x - x) ** 2 + (grid_y[:, None] * LAYOUT.pitch_y - y) ** 2
    pressure = np.sqrt(np.maximum(1 - square / radius**2, 0))
    blocks = pressure.reshape(LAYOUT.rows, parts, LAYOUT.cols, parts).sum(axis=(1, 3))
    reference = force * blocks / pressure.sum()
    found = forces(LAYOUT, 0.0, x, y, force)
    np.testing.assert_allclose(found, reference, rtol=0, atol=5e-4 * force)
    np.testing.assert_allclose(forces(LAYOUT, MIN_RELATIVE_SPREAD * radius, x, y, force), found, rtol=0, atol=1e-15)


@pytest.mark.parametrize("spread", [0.0, 0.05e-3, SPREAD])
def test_the_total_force_is_preserved_for_a_contact_within_the_cells(spread: float) -> None:
    for x, y, force in ((0.0, 0.0, 0.01), (0.02, -0.03, 1.7), (-0.037, 0.011, 40.0)):
        assert forces(WIDE, spread, x, y, force).sum() == pytest.approx(force, rel=1e-12)


def test_the_centre_of_pressure_is_that_of_the_sphere() -> None:
    # Over cells much finer than the contact the centre of the taxels' forces is the centre of pressure.
    fine = Layout(id=1, rows=128, cols=128, pitch_x=0.2e-3, pitch_y=0.2e-3, taxel_area=1e-8)
    found = forces(fine, SPREAD, 1.23e-3, -2.34e-3, 1.5).ravel()
    np.testing.assert_allclose(found @ fine.positions / found.sum(), (1.23e-3, -2.34e-3), rtol=0, atol=1e-9)


def test_a_mirrored_sphere_gives_the_mirrored_map() -> None:
    there = forces(LAYOUT, SPREAD, 0.7e-3, -0.4e-3, 1.1)
    np.testing.assert_allclose(forces(LAYOUT, SPREAD, -0.7e-3, 0.4e-3, 1.1), there[::-1, ::-1], rtol=0, atol=1e-12)


def test_force_beyond_the_cells_is_lost_and_distant_taxels_are_unaffected() -> None:
    corner = forces(WIDE, SPREAD, 32 * 1.5e-3, 32 * 1.5e-3, 1.0)
    assert corner.sum() == pytest.approx(0.25, abs=1e-6)
    assert not corner[:58].any()
    assert not corner[:, :58].any()
    assert not forces(WIDE, SPREAD, 0.06, 0.0, 1.0).any()


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(
            hertz_ellipse,
            {"along": 200.0, "across": 250.0, "effective_modulus": MODULUS},
            along=(0.0, -1.0, 2e7),
            across=(0.0, 2e7),
            effective_modulus=(0.0, -1.0, 2e13),
        ),
        refusals(Cells, {"layout": LAYOUT, "spread": SPREAD}, spread=(-1e-9, 1.1)),
        refusals(skin_spread, {"thickness": 1e-3}, thickness=(-1e-9, 0.2)),
    ],
)
def test_invalid_parameters_are_rejected(function, cases) -> None:
    assert_all_refused(function, cases)
