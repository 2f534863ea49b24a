# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts verified against a numerical solution of the elastic half-space (test/reference/half_space.py)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from posfet_model.sensor.description import Layout
from posfet_sim.contact.indenters import FLAT, Bend, FlatIndenter, Shape, Sphere
from posfet_sim.contact.line_contacts import Cylinder, Edge
from posfet_sim.contact.rectangular_indenter import RectangularIndenter
from posfet_sim.contact.taxel_forces import Cells
from reference.half_space import Contact, axis, press

LAYOUT = Layout(id=1, rows=5, cols=5, pitch_x=1.5e-3, pitch_y=1.5e-3, taxel_area=1e-6)
SPREAD = 0.6e-3
MODULUS = 2e6
FORCE = 1.0
COUNT = 128
ALONG: Bend = (1 / 20e-3, 0.0)
SLOPE = math.tan(math.radians(20))
SQUARE_PLATE = 0.36679
"""Capacity of a square plate over 4*pi*eps0 and its side (F. H. Read, J. Comput. Phys. 133, 1997, to five digits).

The charge of a plate follows the equations of the pressure of a punch. A disc of radius a has the capacity 2*a/pi, and
a round punch the stiffness 2*a*E, so that a square punch of side l has pi*0.36679*l*E.
"""

normal_below = np.vectorize(lambda z: 0.5 * math.erfc(-z / math.sqrt(2)))


Gap = Callable[[np.ndarray, np.ndarray], np.ndarray]


def parabola(along: float, across: float) -> Gap:
    """Return the gap function of a body with these curvatures [1/m]."""
    return lambda x, y: (along * x**2 + across * y**2) / 2


def wedge(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return SLOPE * np.abs(y) + 0 * x


def disc(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.where(x**2 + y**2 < 1.5e-3**2, 0.0, np.inf)


def contact(gap: Gap, half_x: float, half_y: float) -> Contact:
    """Solve the contact on a grid with these half sides [m]."""
    x, y = axis(half_x, COUNT)[None], axis(half_y, COUNT)[:, None]
    return press(gap(x, y), x, y, FORCE, MODULUS)


def on_taxels(found: Contact, x: float, y: float, angle: float) -> np.ndarray:
    """Return the force on each taxel [N] of a solved contact at (x, y) [m], rotated, under the Gaussian of the skin."""
    u, v = (each.ravel() for each in np.broadcast_arrays(found.x, found.y))
    edges = (np.arange(6) - 2.5) * 1.5e-3
    at_x, at_y = x + u * math.cos(angle) - v * math.sin(angle), y + u * math.sin(angle) + v * math.cos(angle)
    within_x = np.diff(normal_below((edges - at_x[:, None]) / SPREAD), axis=1)
    within_y = np.diff(normal_below((edges - at_y[:, None]) / SPREAD), axis=1)
    return (within_y * found.force.ravel()[:, None]).T @ within_x


def taxels(shape: Shape, bend: Bend, x: float, y: float, angle: float) -> np.ndarray:
    """Return the same from the simulation."""
    forces = np.zeros((5, 5))
    where = [np.array([value]) for value in (x, y, angle, FORCE)]
    patch = Cells(LAYOUT, SPREAD).press([shape.footprints(FORCE, SPREAD, bend)], *where)
    assert patch is not None
    forces[patch.rows, patch.cols] = patch.force[0]
    return forces


FACE = parabola(0.0, 0.0)
CASES: dict[str, tuple[Shape, Bend, Gap, float, float, float, float]] = {
    # shape, bend, its gap, half sides of the grid [m], error of indentation [1] and of a taxel's force [N]
    "sphere": (Sphere(5e-3, MODULUS), FLAT, parabola(200.0, 200.0), 1.8e-3, 1.8e-3, 1e-4, 1e-4),
    "sphere, bent": (Sphere(5e-3, MODULUS), ALONG, parabola(250.0, 200.0), 1.8e-3, 1.8e-3, 1e-4, 1e-4),
    "punch": (FlatIndenter(1.5e-3, MODULUS), FLAT, disc, 1.52e-3, 1.52e-3, 3e-3, 1e-3),
    "crossed cylinders": (
        Cylinder(8e-3, MODULUS, 3e-3), ALONG, parabola(50.0, 1 / 3e-3), 4e-3, 1.6e-3, 1e-4, 0.01),
    "square": (RectangularIndenter(3e-3, 3e-3, MODULUS), FLAT, FACE, 1.5e-3, 1.5e-3, 3e-3, 1e-3),
    "rectangle": (RectangularIndenter(4e-3, 2e-3, MODULUS), FLAT, FACE, 2e-3, 1e-3, 3e-3, 1e-3),
    "narrow rectangle": (RectangularIndenter(6e-3, 0.6e-3, MODULUS), FLAT, FACE, 3e-3, 0.3e-3, 3e-3, 1e-3),
    "rectangle, across": (RectangularIndenter(1e-3, 4e-3, MODULUS), FLAT, FACE, 0.5e-3, 2e-3, 3e-3, 1e-3),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_contact_agrees_with_the_half_space_solution(case: tuple[Shape, Bend, Gap, float, float, float, float]) -> None:
    shape, bend, gap, half_x, half_y, sunk_error, force_error = case
    found = contact(gap, half_x, half_y)
    assert shape.indentation(FORCE, bend) == pytest.approx(found.indentation, rel=sunk_error)
    for x, y, angle in ((0.0, 0.0, 0.0), (0.4e-3, -0.3e-3, math.pi / 2), (-0.2e-3, 0.5e-3, 0.6)):
        expected = on_taxels(found, x, y, angle)
        np.testing.assert_allclose(taxels(shape, bend, x, y, angle), expected, rtol=0, atol=force_error)


def test_square_indenter_stiffness_agrees_with_the_capacitance_of_a_square_plate() -> None:
    stiffness = math.pi * SQUARE_PLATE * 3e-3 * MODULUS
    assert FORCE / RectangularIndenter(3e-3, 3e-3, MODULUS).indentation(FORCE, FLAT) == pytest.approx(
        stiffness, rel=1.5e-3
    )
    assert FORCE / contact(FACE, 1.5e-3, 1.5e-3).indentation == pytest.approx(stiffness, rel=5e-3)


@pytest.mark.parametrize(
    ("shape", "gap", "half_y", "less", "sunk"),
    [
        (Cylinder(4e-3, MODULUS, 3e-3), parabola(0.0, 1 / 3e-3), 1.2e-3, 0.21, 0.10),
        (Cylinder(8e-3, MODULUS, 3e-3), parabola(0.0, 1 / 3e-3), 1.2e-3, 0.16, 0.09),
        (Edge(4e-3, MODULUS, SLOPE), wedge, 0.8e-3, 0.17, 0.09),
        (Edge(8e-3, MODULUS, SLOPE), wedge, 0.8e-3, 0.11, 0.07),
    ],
    ids=["short rod", "rod", "short edge", "edge"],
)
def test_end_effects_of_a_stiff_line_match_the_document(
    shape: Cylinder | Edge, gap: Gap, half_y: float, less: float, sunk: float
) -> None:
    found = contact(gap, shape.length / 2, half_y)
    middle = float(found.force[:, COUNT // 2].sum()) * COUNT / FORCE
    assert 1 - middle == pytest.approx(less, abs=0.01)
    assert 1 - found.indentation / shape.indentation(FORCE, FLAT) == pytest.approx(sunk, abs=0.01)
