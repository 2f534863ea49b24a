# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Pressure of each shape: verified against dense sums of closed-form profiles and Boussinesq's stress."""

import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_model.sensor.description import Layout
from posfet_sim.contact.closed_forms import hertz_ellipse, line_stiffness
from posfet_sim.contact.indenters import FLAT, Bend, FlatIndenter, Shape, Sphere
from posfet_sim.contact.line_contacts import Cylinder, Edge, LineShape
from posfet_sim.contact.rectangular_indenter import RectangularIndenter
from posfet_sim.contact.ridged_fingertip import RidgedFingertip
from posfet_sim.contact.soft_faces import Pad, Ring, ScrewHead, SoftFace
from posfet_sim.contact.taxel_forces import SPREAD_PER_THICKNESS, Cells, skin_spread
from posfet_sim.contact.textured_pads import Ridges, Roughness
from support.sweep import decades

LAYOUT = Layout(id=1, rows=5, cols=6, pitch_x=1.5e-3, pitch_y=1.2e-3, taxel_area=1e-6)
WIDE = Layout(id=1, rows=64, cols=64, pitch_x=1.5e-3, pitch_y=1.5e-3, taxel_area=1e-6)
SPREAD = 0.6e-3
MODULUS = 2e6
BENT: Bend = (1 / 20e-3, 0.0)
SHAPES: dict[str, Shape] = {
    "sphere": Sphere(5e-3, MODULUS),
    "punch": FlatIndenter(1.5e-3, MODULUS),
    "rectangle": RectangularIndenter(4e-3, 2e-3, MODULUS),
    "cylinder": Cylinder(4e-3, MODULUS, 3e-3),
    "edge": Edge(4e-3, MODULUS, math.tan(math.radians(20))),
    "ridges": Ridges(6e-3, 3e-3, 3, 10e-6, MODULUS),
    "bumps": Roughness(5e-3, 4e-3, 40, 7),
    "pad": Pad(4e-3, 3e-3),
    "ring": Ring(2e-3, 1.5e-3),
    "screw head": ScrewHead(1.9e-3, 0.5e-3),
    "ridged fingertip": RidgedFingertip(8e-3, 1e6, 1.5e-3, 0.8),
}
PRESSED = [name for name, shape in SHAPES.items() if not isinstance(shape, SoftFace)]
POINTS = 400

normal_below = np.vectorize(lambda z: 0.5 * math.erfc(-z / math.sqrt(2)))


def forces(
    shape: Shape, x: float, y: float, angle: float, force: float, bend: Bend = FLAT, layout: Layout = LAYOUT
) -> np.ndarray:
    cells = Cells(layout, SPREAD)
    out = np.zeros((layout.rows, layout.cols))
    where = [np.array([value]) for value in (x, y, angle, force)]
    patch = cells.press([shape.footprints(force, SPREAD, bend)], *where)
    if patch is not None:
        out[patch.rows, patch.cols] += patch.force[0]
    return out


def collected(points: np.ndarray, weight: np.ndarray, x: float, y: float, angle: float) -> np.ndarray:
    """Return the sum of Gaussians at points (u, v), shape [n, 2], rotated and shifted, over the cells of LAYOUT."""
    u, v = points.T
    at_x = x + u * math.cos(angle) - v * math.sin(angle)
    at_y = y + u * math.sin(angle) + v * math.cos(angle)
    edges_x = (np.arange(LAYOUT.cols + 1) - LAYOUT.cols / 2) * LAYOUT.pitch_x
    edges_y = (np.arange(LAYOUT.rows + 1) - LAYOUT.rows / 2) * LAYOUT.pitch_y
    within_x = np.diff(normal_below((edges_x - at_x[:, None]) / SPREAD), axis=1)
    within_y = np.diff(normal_below((edges_y - at_y[:, None]) / SPREAD), axis=1)
    return (within_y * weight[:, None]).T @ within_x


def middles(half: float, count: int) -> np.ndarray:
    return ((np.arange(count) + 0.5) / count * 2 - 1) * half


def dense(u: np.ndarray, weight_u: np.ndarray, v: np.ndarray, weight_v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    points = np.stack([np.repeat(u, len(v)), np.tile(v, len(u))], axis=1)
    weight = np.repeat(weight_u, len(v)) * np.tile(weight_v, len(u))
    return points, weight / weight.sum()


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, math.pi, -math.pi / 2, 0.4, 2.1])
@pytest.mark.parametrize("force", [0.02, 1.3])
def test_line_contacts_agree_with_a_dense_grid_of_their_pressure(angle: float, force: float) -> None:
    even = np.ones(60)
    cylinder = SHAPES["cylinder"]
    half = math.sqrt(4 * force / 4e-3 * 3e-3 / (math.pi * MODULUS))
    v = middles(half, 150)
    points, weight = dense(middles(2e-3, 60), even, v, np.sqrt(1 - (v / half) ** 2))
    expected = force * collected(points, weight, 0.3e-3, -0.4e-3, angle)
    np.testing.assert_allclose(forces(cylinder, 0.3e-3, -0.4e-3, angle, force), expected, rtol=0, atol=1e-4 * force)
    half = force / 4e-3 / (MODULUS * math.tan(math.radians(20)))
    v = middles(half, 150)
    points, weight = dense(middles(2e-3, 60), even, v, np.arccosh(half / np.abs(v)))
    expected = force * collected(points, weight, 0.3e-3, -0.4e-3, angle)
    np.testing.assert_allclose(
        forces(SHAPES["edge"], 0.3e-3, -0.4e-3, angle, force), expected, rtol=0, atol=1e-4 * force
    )


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.7e-3, -1.1e-3), (3.9e-3, 0.2e-3)])
def test_a_flat_indenter_agrees_with_polar_sums_of_its_exact_profile(x: float, y: float) -> None:
    # r = a*sin(theta) makes p(r)*2*pi*r dr = F*sin(theta) dtheta.
    theta = (np.arange(60) + 0.5) / 60 * math.pi / 2
    angle = np.arange(48) * math.pi / 24
    u = (1.5e-3 * np.sin(theta)[:, None] * np.cos(angle)).ravel()
    v = (1.5e-3 * np.sin(theta)[:, None] * np.sin(angle)).ravel()
    weight = np.repeat(np.sin(theta), 48)
    expected = 1.3 * collected(np.stack([u, v], axis=1), weight / weight.sum(), x, y, 0.0)
    np.testing.assert_allclose(forces(SHAPES["punch"], x, y, 0.0, 1.3), expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, 0.7])
@pytest.mark.parametrize("share", [0.2, 0.9, 1.0, 2.5])
def test_ridges_agree_with_a_dense_grid_of_the_wavy_pressure(angle: float, share: float) -> None:
    wavelength = 2e-3
    full = math.pi * MODULUS * 10e-6 / wavelength  # p* [Pa]
    mean = share * full
    u = middles(3e-3, 600)
    phase = math.pi * u / wavelength  # a crest in the centre, as for any odd number of ridges
    if share < 1:
        inside = np.maximum(share - np.sin(phase) ** 2, 0)
        pressure = 2 * mean * np.abs(np.cos(phase)) / share * np.sqrt(inside)
    else:
        pressure = mean + full * np.cos(2 * phase)
    assert pressure.mean() == pytest.approx(mean, rel=2e-3)  # accuracy of the grid at the edges of the ridges
    force = mean * 6e-3 * 3e-3
    points, weight = dense(u, pressure, middles(1.5e-3, 40), np.ones(40))
    expected = force * collected(points, weight, 0.4e-3, 0.2e-3, angle)
    found = forces(SHAPES["ridges"], 0.4e-3, 0.2e-3, angle, force)
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-4 * force)


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, 0.7])
def test_a_pad_agrees_with_a_dense_grid_of_uniform_pressure(angle: float) -> None:
    points, weight = dense(middles(2e-3, 160), np.ones(160), middles(1.5e-3, 120), np.ones(120))
    expected = 1.3 * collected(points, weight, 0.4e-3, 0.2e-3, angle)
    # The grid's own error is that of the midpoint rule, (25 um)^2/24 times curvature over 0.36e-6 m2: below 1e-4.
    np.testing.assert_allclose(forces(SHAPES["pad"], 0.4e-3, 0.2e-3, angle, 1.3), expected, rtol=0, atol=1e-4)


def polar(inner: float, outer: float, rings: int, angles: int) -> tuple[np.ndarray, np.ndarray]:
    """Return midpoints (u, v), shape [n, 2], of equal steps in radius and angle between two radii, and their areas."""
    radius = inner + (np.arange(rings) + 0.5) / rings * (outer - inner)
    angle = (np.arange(angles) + 0.5) / angles * 2 * math.pi
    points = np.multiply.outer(radius, np.stack([np.cos(angle), np.sin(angle)], axis=1)).reshape(-1, 2)
    return points, np.repeat(radius, angles)


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.7e-3, -1.1e-3), (3.9e-3, 0.2e-3)])
def test_a_ring_agrees_with_polar_sums_of_uniform_pressure(x: float, y: float) -> None:
    points, weight = polar(1.5e-3, 2e-3, 20, 90)
    expected = 1.3 * collected(points, weight / weight.sum(), x, y, 0.0)
    np.testing.assert_allclose(forces(SHAPES["ring"], x, y, 0.0, 1.3), expected, rtol=0, atol=1e-4)
    # Under its middle there is less than beside.
    wide = forces(Ring(2.8e-3, 2.2e-3), 0.75e-3, 0.0, 0.0, 1.0)
    assert wide[2, 3] < 0.2 * wide[2, 5]


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, 0.7])
def test_a_screw_head_agrees_with_a_dense_grid_without_the_slot(angle: float) -> None:
    # Strips along the slot, each from rim to rim with equal steps; the midpoint rule across errs at the rim, where the
    # chords end like a root, by (1/200)^1.5 of the area.
    v = 0.25e-3 + (np.arange(100) + 0.5) / 100 * (1.9e-3 - 0.25e-3)
    chord = np.sqrt(1.9e-3**2 - v**2)
    u = np.multiply.outer(chord, middles(1.0, 40)).ravel()
    upper, weight = np.stack([u, np.repeat(v, 40)], axis=1), np.repeat(chord, 40)
    points, weight = np.concatenate([upper, -upper]), np.concatenate([weight, weight])
    expected = 1.3 * collected(points, weight / weight.sum(), 0.4e-3, 0.2e-3, angle)
    found = forces(SHAPES["screw head"], 0.4e-3, 0.2e-3, angle, 1.3)
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-4)
    area = 2 * chord.sum() * 2 * (v[1] - v[0])
    assert SHAPES["screw head"].area(1.0, FLAT) == pytest.approx(area, rel=1e-3)


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, 0.7])
@pytest.mark.parametrize("force", [0.02, 1.3])
def test_a_ridged_fingertip_agrees_with_polar_sums_of_its_pressure(angle: float, force: float) -> None:
    radius = (3 * force * 8e-3 / (4 * 1e6)) ** (1 / 3)  # Hertz
    points, area = polar(0.0, radius, 60, 60)
    pressure = np.sqrt(1 - (points**2).sum(axis=1) / radius**2) * (
        1 + 0.8 * np.cos(2 * math.pi * points[:, 0] / 1.5e-3)
    )
    weight = pressure * area
    expected = force * collected(points, weight / weight.sum(), 0.4e-3, 0.2e-3, angle)
    found = forces(SHAPES["ridged fingertip"], 0.4e-3, 0.2e-3, angle, force)
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-4 * force)  # the sums err by (1/60)^1.5/6 at the rim


def test_ridges_of_a_fingertip_are_blurred_by_the_skin_as_documented() -> None:
    # Cells of 0.1 mm resolve the pressure under the skin; over the middle of a wide contact the envelope is flat.
    fine = Layout(id=1, rows=64, cols=64, pitch_x=0.1e-3, pitch_y=0.1e-3, taxel_area=1e-8)
    tip, smooth = RidgedFingertip(40e-3, 1e6, 1.5e-3, 0.8), Sphere(40e-3, 1e6)
    ridged, plain = (forces(shape, 0.0, 0.0, 0.0, 5.0, layout=fine)[32] for shape in (tip, smooth))
    middle = slice(32 - 7, 32 + 8)  # one ridge
    ratio = ridged[middle] / plain[middle]
    left = 0.8 * math.exp(-2 * (math.pi * SPREAD / 1.5e-3) ** 2)
    assert (ratio.max() - ratio.min()) / 2 == pytest.approx(left, rel=0.1)


def test_bumps_depend_on_the_seed_and_move_with_the_pad() -> None:
    same, other = Roughness(5e-3, 4e-3, 40, 7), Roughness(5e-3, 4e-3, 40, 8)
    found = forces(SHAPES["bumps"], 0.1e-3, 0.2e-3, 0.3, 1.0)
    np.testing.assert_array_equal(found, forces(same, 0.1e-3, 0.2e-3, 0.3, 1.0))
    assert np.abs(found - forces(other, 0.1e-3, 0.2e-3, 0.3, 1.0)).max() > 5e-3
    fine = Layout(id=1, rows=128, cols=128, pitch_x=0.2e-3, pitch_y=0.2e-3, taxel_area=1e-8)
    spread_out = forces(same, 0.1e-3, 0.2e-3, 0.3, 1.0, layout=fine)
    centre = spread_out.ravel() @ fine.positions
    np.testing.assert_allclose(centre, [0.1e-3, 0.2e-3], rtol=0, atol=1e-8)


def test_a_nearly_right_angle_gives_nearly_the_same_forces() -> None:
    for shape in SHAPES.values():
        for angle in (0.0, math.pi / 2, math.pi, 3 * math.pi / 2):
            aligned, rotated = (forces(shape, 0.3e-3, -0.2e-3, angle + step, 1.0) for step in (0.0, 1e-7))
            np.testing.assert_allclose(aligned, rotated, rtol=0, atol=1e-6)


@pytest.mark.parametrize("bend", [FLAT, BENT, (0.0, 50.0), (20.0, 30.0)])
@pytest.mark.parametrize("name", SHAPES)
def test_the_total_force_is_preserved(name: str, bend: Bend) -> None:
    for force in (1e-3, 0.2, 3.0):
        for angle in (0.0, 1.0):
            total = forces(SHAPES[name], 0.01, -0.02, angle, force, bend, WIDE).sum()
            assert total == pytest.approx(force, rel=1e-12)


def test_an_object_loads_only_the_taxels_under_it() -> None:
    cells = Cells(WIDE, SPREAD)
    for shape in SHAPES.values():
        footprints = [shape.footprints(0.3, SPREAD, FLAT)]
        patch = cells.press(footprints, *[np.array([value]) for value in (1e-3, 2e-3, 0.3, 0.3)])
        assert patch is not None
        assert max(patch.force.shape) <= 13
        assert cells.press(footprints, *[np.array([value]) for value in (0.08, 0.0, 0.3, 0.3)]) is None


@pytest.mark.parametrize("bend", [FLAT, BENT, (20.0, 30.0)])
@pytest.mark.parametrize("name", SHAPES)
def test_a_batch_of_samples_equals_the_samples_one_by_one(name: str, bend: Bend) -> None:
    # Loads that need different numbers of points, and all orientations; in some samples off the array.
    shape, cells = SHAPES[name], Cells(WIDE, SPREAD)
    count = 23
    x, y = np.linspace(-0.07, 0.03, count), np.linspace(0.0, 0.02, count)
    angle = np.resize([0.0, math.pi / 2, 0.3, -math.pi, 2.0], count)
    force = np.geomspace(1e-3, 3.0, count)
    footprints = [shape.footprints(each, SPREAD, bend) for each in force.tolist()]
    together = cells.press(footprints, x, y, angle, force)
    assert together is not None
    for sample in range(count):
        whole, alone = np.zeros((2, WIDE.rows, WIDE.cols))
        whole[together.rows, together.cols] = together.force[sample]
        one = slice(sample, sample + 1)
        patch = cells.press(footprints[one], x[one], y[one], angle[one], force[one])
        if patch is not None:
            alone[patch.rows, patch.cols] = patch.force[0]
        np.testing.assert_allclose(whole, alone, rtol=0, atol=1e-13 * force[sample])


@pytest.mark.parametrize("bend", [FLAT, BENT, (0.0, 50.0), (20.0, 30.0)])
@pytest.mark.parametrize("name", PRESSED)
@settings(deadline=None, max_examples=30)  # of each shape on each bend
@given(force=decades(1e-4, 5.0))
def test_force_is_the_inverse_of_indentation(name: str, bend: Bend, force: float) -> None:
    shape = SHAPES[name]
    assert shape.force(shape.indentation(force, bend), bend) == pytest.approx(force, rel=1e-10)
    assert shape.force(0.0, bend) == shape.force(-1e-3, bend) == 0.0


@settings(deadline=None)
@given(decades(10.0, 1e3), decades(1.0, 1e3))
def test_an_elliptic_contact_satisfies_johnsons_equations(across: float, ratio: float) -> None:
    shape = hertz_ellipse(across, across * ratio, MODULUS)
    major, minor = shape.along, shape.across
    square = 1 - mpmath.mpf(minor / major) ** 2
    first, second = mpmath.ellipk(square), mpmath.ellipe(square)
    if square > 1e-6:
        curvatures = ((major / minor) ** 2 * second - first) / (first - second)
        assert float(curvatures) == pytest.approx(ratio, rel=1e-7)
    assert shape.depth == pytest.approx(3 * float(first) / (2 * math.pi * major * MODULUS), rel=1e-9)


def test_slices_overestimate_cylinder_contact_length_on_a_bent_chip_as_documented() -> None:
    ratios = []
    for radius in (1e-3, 2e-3, 3e-3, 5e-3, 10e-3):
        for bent in (10e-3, 20e-3, 50e-3, 100e-3):
            for length in (4e-3, 10e-3, 20e-3):
                rod, bend = Cylinder(length, MODULUS, radius), (1 / bent, 0.0)
                for force in (0.01, 0.03, 0.1, 0.3, 1.0):
                    sliced, hertz = LineShape.line_load(rod, force, bend), rod.line_load(force, bend)
                    if force < rod.max_force and sliced.half_length < 0.999 * length / 2:
                        ratios.append(sliced.half_length / hertz.half_length)
    assert len(ratios) > 50
    assert (min(ratios), max(ratios)) == (pytest.approx(1.17, abs=0.005), pytest.approx(2.08, abs=0.005))


def displacement(x: float, y: float, along: float, across: float, force: float) -> float:
    """Displacement of the surface under an elliptic Hertz pressure: Boussinesq point loads, polar about (x, y)."""
    angle = (np.arange(400) + 0.5) * 2 * math.pi / 400
    cos, sin = np.cos(angle), np.sin(angle)
    a = (cos / along) ** 2 + (sin / across) ** 2
    b = x * cos / along**2 + y * sin / across**2
    c = 1 - (x / along) ** 2 - (y / across) ** 2
    end = (-b + np.sqrt(b * b + a * c)) / a  # of the chord, from (x, y)
    u = middles(1.0, 400)[:, None]  # r = end*(1 - s^2) removes the square-root singularity at the edge
    s = (u + 1) / 2
    r = end * (1 - s**2)
    pressure = np.sqrt(np.maximum(c - 2 * b * r - a * r * r, 0)) * 2 * s * end
    peak = 1.5 * force / (math.pi * along * across)
    return float(peak * pressure.mean(axis=0).sum() * 2 * math.pi / 400 / (math.pi * MODULUS))


def test_the_surface_under_a_sphere_on_a_bent_chip_follows_the_gap() -> None:
    shape = hertz_ellipse(1 / 5e-3 + 1 / 20e-3, 1 / 5e-3, MODULUS)
    force = 1.3
    along, across = shape.along * force ** (1 / 3), shape.across * force ** (1 / 3)
    depth = shape.depth * force ** (2 / 3)
    for x, y in ((0.0, 0.0), (0.5 * along, 0.0), (0.0, 0.6 * across), (0.4 * along, -0.5 * across)):
        gap = (1 / 5e-3 + 1 / 20e-3) * x * x / 2 + y * y / 2 / 5e-3
        assert displacement(x, y, along, across, force) == pytest.approx(depth - gap, abs=1e-4 * depth)


def test_line_indentation_agrees_with_boussinesq_point_loads() -> None:
    length, half = 8e-3, 0.4e-3
    u = middles(length / 2, 4000)
    for profile, pressure in ((1.0, lambda s: np.sqrt(1 - s * s)), (2.0, lambda s: np.arccosh(1 / s))):
        s = (middles(0.5, 2000) + 0.5) ** 2  # dense towards the centre, where the point load is singular
        weight = pressure(s) * np.sqrt(s)
        distance = np.array([np.mean(1 / np.hypot(u, s_i * half)) for s_i in s[::20]])
        # The rest is analytic along the line: asinh has only a logarithmic singularity.
        along = 2 * np.arcsinh(length / 2 / (s * half))
        assert np.allclose(distance[20:] * length, along[::20][20:], rtol=2e-3)
        found = float(weight @ along / weight.sum()) / (math.pi * MODULUS)  # for a load of 1 N/m
        assert 1 / line_stiffness(length, half, MODULUS, profile) == pytest.approx(found, rel=3e-3)


def test_crossed_cylinders_are_a_hertz_ellipse_until_its_ends() -> None:
    rod = Cylinder(20e-3, MODULUS, 3e-3)
    ellipse = hertz_ellipse(BENT[0], 1 / 3e-3, MODULUS)
    for force in (0.01, 1.0):
        load = rod.line_load(force, BENT)
        assert load.half_length == pytest.approx(ellipse.along * force ** (1 / 3), rel=1e-9)
        assert load.indentation == pytest.approx(ellipse.depth * force ** (2 / 3), rel=1e-9)
        assert rod.half_width(load.middle, 0.0) == pytest.approx(ellipse.across * force ** (1 / 3), rel=0.03)
    short = Cylinder(4e-3, MODULUS, 3e-3)
    closing = (2e-3 / ellipse.along) ** 3
    before, after = (short.line_load(closing * share, BENT) for share in (1 - 1e-9, 1 + 1e-9))
    assert before.half_length == pytest.approx(after.half_length, rel=1e-6)
    assert before.middle == pytest.approx(after.middle, rel=1e-6)
    assert before.indentation == pytest.approx(after.indentation, rel=1e-6)


def test_a_bent_chip_makes_the_contact_shorter_and_deeper() -> None:
    columns = np.arange(LAYOUT.cols) - (LAYOUT.cols - 1) / 2
    for name in (each for each in PRESSED if each != "rectangle"):  # for flat chips
        shape = SHAPES[name]
        flat, bent = (forces(shape, 0.0, 0.0, 0.0, 0.05, bend).sum(axis=0) for bend in (FLAT, (200.0, 0.0)))
        assert bent @ columns**2 < 0.999 * (flat @ columns**2)
        assert shape.indentation(0.05, (200.0, 0.0)) > shape.indentation(0.05, FLAT)


def boussinesq(edges_x: np.ndarray, edges_y: np.ndarray) -> np.ndarray:
    """Share of a point force in rectangles at depth 1: the stress 3/(2*pi*(r^2 + 1)^2.5), integrated in closed form."""
    x, y = edges_x[None, :], edges_y[:, None]
    r = np.sqrt(x * x + y * y + 1)
    corner = (np.arctan2(x * y, r) + x * y / r * (1 / (x * x + 1) + 1 / (y * y + 1))) / (2 * math.pi)
    return np.diff(np.diff(corner, axis=0), axis=1)


def test_the_closed_form_of_boussinesq_against_a_dense_sum() -> None:
    edges = np.array([-0.9, 0.3, 2.0])
    found = boussinesq(edges, edges)
    for row, (low_y, high_y) in enumerate(pairwise(edges)):
        for col, (low_x, high_x) in enumerate(pairwise(edges)):
            x = low_x + (np.arange(400) + 0.5) / 400 * (high_x - low_x)
            y = low_y + (np.arange(400) + 0.5) / 400 * (high_y - low_y)
            stress = 1.5 / math.pi * (x**2 + y[:, None] ** 2 + 1) ** -2.5
            area = (high_x - low_x) * (high_y - low_y)
            assert stress.mean() * area == pytest.approx(found[row, col], abs=1e-6)


def mismatch(spread: float, pitch: float, points: np.ndarray) -> float:
    """Return the maximum difference of a cell's share between Gaussian and Boussinesq, lengths in skin thicknesses."""
    worst = 0.0
    for offset_x in (0.0, 0.25, 0.5):
        for offset_y in (0.0, 0.25, 0.5):
            exact, spread_out = 0.0, 0.0
            for x, y in points:
                edges_x = (np.arange(12) - 5.5 - offset_x) * pitch - x
                edges_y = (np.arange(12) - 5.5 - offset_y) * pitch - y
                exact = exact + boussinesq(edges_x, edges_y) / len(points)
                within = [np.diff(normal_below(edges / spread)) for edges in (edges_y, edges_x)]
                spread_out = spread_out + np.outer(*within) / len(points)
            worst = max(worst, float(np.abs(exact - spread_out).max()))
    return worst


PITCHES = (1.5, 1.75, 2.0)
"""Cells over the cover's thickness; 1.75 on the shipped sensor."""


def test_the_deviation_of_the_gaussian_from_boussinesq_matches_the_document() -> None:
    point = np.zeros((1, 2))
    assert skin_spread(1e-3) == pytest.approx(0.7e-3, rel=1e-12)
    worst = [mismatch(SPREAD_PER_THICKNESS, pitch, point) for pitch in PITCHES]
    assert 0.03 < max(worst) < 0.037
    assert max(mismatch(SPREAD_PER_THICKNESS, pitch, point) for pitch in (1.0, 2.5)) < 0.061
    assert max(worst) < max(mismatch(0.6, pitch, point) for pitch in PITCHES)
    assert max(worst) < max(mismatch(0.8, pitch, point) for pitch in PITCHES)
    theta = (np.arange(6) + 0.5) / 6 * math.pi / 2
    radius = np.sqrt(1 - np.cos(theta) ** 2)  # for a uniform pressure likewise: as wide as thick
    angle = np.arange(8) * math.pi / 4
    wide = np.stack([np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()], axis=1)
    assert max(mismatch(SPREAD_PER_THICKNESS, pitch, 1.5 * wide) for pitch in PITCHES) < max(worst)


@settings(deadline=None)
@given(st.sampled_from(sorted(SHAPES)), st.floats(-6.3, 6.3), st.floats(-4e-3, 4e-3), st.floats(-3e-3, 3e-3))
def test_taxel_forces_are_never_negative(name: str, angle: float, x: float, y: float) -> None:
    found = forces(SHAPES[name], x, y, angle, 0.7)
    assert found.min() >= -1e-15
    assert found.sum() <= 0.7 * (1 + 1e-12)
