# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Membranes and bent chips: against 40-digit references, an independent plate solution, and the laws of bending."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import legendre

from posfet_model.device import mechanics
from posfet_model.device.mechanics import Layer
from support.sweep import ErrorMap, assert_all_refused, assert_finite, assert_monotone, decades, reference, refusals

EPS = np.finfo(np.float64).eps
SILICON = {"young_modulus": 169e9, "poisson_ratio": 0.3}
CIRCLE = {"pressure": 100.0, "radius": 5e-3, "thickness": 50e-6, **SILICON}
SQUARE = {"pressure": 100.0, "side": 1e-2, "thickness": 50e-6, **SILICON}
CHIP = [Layer(20e-6, 169e9, 0.3), Layer(2.5e-6, 3e9, 0.35)]
RANGES = {
    "pressure": [-1, 2e12],
    "thickness": [0, -20e-6, 2],
    "young_modulus": [0, -1, 169],
    "poisson_ratio": [-1, 0.51],
}


def _clamped_square_centre(order: int) -> float:
    """Return the centre deflection of a clamped square plate in P*a^4/D, by Galerkin with Shen's Legendre functions."""
    functions = []
    for k in range(0, order, 2):
        weights = np.zeros(k + 5)
        weights[[k, k + 2, k + 4]] = 1, -2 * (2 * k + 5) / (2 * k + 7), (2 * k + 3) / (2 * k + 7)
        functions.append(weights)
    nodes, weights = legendre.leggauss(order + 8)
    value = np.array([legendre.legval(nodes, f) for f in functions])
    second = np.array([legendre.legval(nodes, legendre.legder(f, 2)) for f in functions])
    bend, mixed, mass = second * weights @ second.T, value * weights @ second.T, value * weights @ value.T
    load = value @ weights
    stiffness = np.kron(bend, mass) + np.kron(mass, bend) + 2 * np.kron(mixed, mixed)
    solution = np.linalg.solve(stiffness, np.kron(load, load))
    centre = np.array([legendre.legval(0.0, f) for f in functions])
    return float(solution @ np.kron(centre, centre)) / 2**4


class TestMembranes:
    @pytest.mark.parametrize(
        ("function", "column"), [(mechanics.circular_deflection, "circular"), (mechanics.square_deflection, "square")]
    )
    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    def test_against_the_40_digit_table(self, function, column, dtype, record_property) -> None:
        table = reference("membrane")
        names = ("pressure", "span", "thickness", "young_modulus", "poisson_ratio")
        with np.errstate(over="raise", invalid="raise"):
            bent = function(*(table[name].astype(dtype) for name in names))
        assert bent.deflection.dtype == dtype
        assert_finite(bent.deflection)
        found = ErrorMap(bound=16 * np.finfo(dtype).eps)
        found.add(column, (bent.deflection - table[column]) / np.where(table[column] == 0, 1, table[column]))
        found.check(record_property)
        np.testing.assert_array_equal(bent.small, bent.deflection <= table["thickness"].astype(dtype) / 2)

    def test_coefficient_of_the_square_plate_against_another_solution(self) -> None:
        assert _clamped_square_centre(40) == pytest.approx(mechanics.SQUARE_PLATE_COEFFICIENT, rel=0, abs=2e-14)

    def test_printed_coefficient_is_reproduced_at_its_poisson_ratio(self) -> None:
        assert pytest.approx(0.0138, rel=0, abs=2e-5) == 12 * mechanics.SQUARE_PLATE_COEFFICIENT * (1 - 0.3**2)

    @pytest.mark.parametrize(("thickness", "limit"), [(20e-6, 97.85), (50e-6, 3822.1)])
    def test_the_validity_flag_drops_where_the_deflection_exceeds_half_the_thickness(self, thickness, limit) -> None:
        bent = mechanics.square_deflection([0.0, 0.999 * limit, 1.001 * limit], 1e-2, thickness, **SILICON)
        assert bent.small.tolist() == [True, True, False]

    @given(decades(1e-6, 1e6), decades(1e-4, 1e-1), decades(1e-7, 1e-3), st.floats(-0.9, 0.5))
    def test_thickness_and_deflection_are_a_round_trip(self, pressure, span, thickness, poisson) -> None:
        for forward, inverse in (
            (mechanics.circular_deflection, mechanics.circular_thickness),
            (mechanics.square_deflection, mechanics.square_thickness),
        ):
            deflection = forward(pressure, span, thickness, 169e9, poisson).deflection
            if 1e-15 <= deflection <= 1:
                back = inverse(deflection, pressure, span, 169e9, poisson)
                assert back == pytest.approx(thickness, rel=1e-12, abs=0)

    def test_thinner_membranes_deflect_more(self) -> None:
        thickness = np.logspace(-6, -3, 500)
        bent = mechanics.circular_deflection(100.0, 5e-3, thickness, **SILICON)
        assert_monotone(bent.deflection, rising=False)
        assert not bent.small[0] and bent.small[-1]

    @pytest.mark.parametrize("size", [0, 1, 1_000_000])
    def test_any_number_of_pressures(self, size: int) -> None:
        bent = mechanics.square_deflection(np.linspace(0, 1e5, size), 1e-2, 50e-6, **SILICON)
        assert bent.deflection.shape == bent.small.shape == (size,)


def test_mask_opening_of_the_paper() -> None:
    assert mechanics.mask_opening(1e-2, 450e-6) - 1e-2 == pytest.approx(636.3961e-6, rel=0, abs=1e-10)


def test_bending_and_mask_opening_against_the_40_digit_table() -> None:
    table = reference("bending")
    for row in range(table["radius"].size):
        now = {name: float(column[row]) for name, column in table.items()}
        chip = Layer(now["chip"], now["chip_modulus"], now["chip_poisson"])
        film = Layer(now["film"], now["film_modulus"], now["film_poisson"])
        bent = mechanics.bend_on_cylinder([chip, film], now["radius"])
        height = now["chip"] + now["film"]
        assert abs(bent.neutral_axis - now["neutral_axis"]) <= 8 * EPS * height
        for name in ("back_strain", "top_strain", "film_strain"):  # a difference of heights, divided by the radius
            assert abs(getattr(bent, name) - now[name]) <= 16 * EPS * height / (now["radius"] + now["neutral_axis"])
        opening = mechanics.mask_opening(now["film"], now["chip"])
        assert abs(opening - now["opening"]) <= 2 * EPS * now["opening"]


class TestBending:
    def test_one_layer_bends_about_its_midplane(self) -> None:
        bent = mechanics.bend_on_cylinder([Layer(50e-6, 169e9, 0.3)], 10e-3)
        assert bent.neutral_axis == pytest.approx(25e-6, rel=0, abs=1e-20)
        assert bent.top_strain == pytest.approx(25e-6 / 10.025e-3, rel=0, abs=1e-17)
        assert bent.back_strain == -bent.top_strain
        assert abs(bent.film_strain) <= EPS

    def test_a_layer_split_in_two_bends_identically(self) -> None:
        whole = mechanics.bend_on_cylinder([Layer(20e-6, 169e9, 0.3)], 5e-3)
        cut = mechanics.bend_on_cylinder([Layer(8e-6, 169e9, 0.3), Layer(12e-6, 169e9, 0.3)], 5e-3)
        assert cut.neutral_axis == pytest.approx(whole.neutral_axis, rel=0, abs=1e-19)
        assert cut.top_strain == pytest.approx(whole.top_strain, rel=0, abs=1e-16)

    @given(
        st.lists(st.tuples(decades(1e-8, 1e-3), decades(1e6, 1e12), st.floats(0, 0.49)), min_size=1, max_size=6),
        decades(1e-3, 1e3),
    )
    def test_bending_causes_no_net_force_along_the_chip(self, stack, radius) -> None:
        layers = [Layer(*layer) for layer in stack]
        bent = mechanics.bend_on_cylinder(layers, radius)
        bottoms = np.cumsum([0.0, *(layer.thickness for layer in layers[:-1])])
        forces = [
            layer.plane_modulus * layer.thickness * (bottom + layer.thickness / 2 - bent.neutral_axis)
            for layer, bottom in zip(layers, bottoms, strict=True)
        ]
        height = float(bottoms[-1] + layers[-1].thickness)
        stiffness = sum(layer.plane_modulus * layer.thickness for layer in layers)
        assert abs(sum(forces)) <= 32 * EPS * stiffness * height
        assert bent.back_strain < 0 < bent.top_strain
        assert bent.back_strain <= bent.film_strain <= bent.top_strain

    def test_a_tighter_bend_and_a_thicker_chip_strain_the_film_more(self) -> None:
        assert_monotone(
            [mechanics.bend_on_cylinder(CHIP, radius).film_strain for radius in np.logspace(-3, 1, 50)], rising=False
        )
        thick = [Layer(height, 169e9, 0.3) for height in np.linspace(10e-6, 450e-6, 50)]
        assert_monotone([mechanics.bend_on_cylinder([chip, CHIP[1]], 0.1).film_strain for chip in thick], rising=True)


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(
            mechanics.mask_opening,
            {"membrane_width": 1e-2, "etch_depth": 450e-6},
            membrane_width=[0, -1, 2],
            etch_depth=[0, 450],
        ),
        refusals(mechanics.circular_deflection, CIRCLE, radius=[0, -1, 2], **RANGES),
        refusals(mechanics.square_deflection, SQUARE, side=[0, -1, 2], **RANGES),
        refusals(
            mechanics.circular_thickness,
            {"deflection": 1e-6, "pressure": 100.0, "radius": 5e-3, **SILICON},
            deflection=[0, -1e-6, 2],
            pressure=[0, -1],
            radius=[0, 2],
            young_modulus=[0],
            poisson_ratio=[0.6],
        ),
        refusals(
            mechanics.square_thickness,
            {"deflection": 1e-6, "pressure": 100.0, "side": 1e-2, **SILICON},
            deflection=[0],
            pressure=[0],
            side=[0],
            young_modulus=[0],
            poisson_ratio=[0.6],
        ),
        refusals(
            Layer,
            {"thickness": 1e-6, "young_modulus": 169e9, "poisson_ratio": 0.3},
            thickness=[0, -1e-6, [1e-6]],
            young_modulus=[0],
            poisson_ratio=[-1, 0.6],
        ),
        refusals(
            mechanics.bend_on_cylinder,
            {"layers": CHIP, "cylinder_radius": 1e-2},
            layers=[[], [1, 2], [None], 5.0],
            cylinder_radius=[0, -1, [1e-2, 1e-2]],
        ),
    ],
)
def test_invalid_arguments_are_rejected_by_name(function, cases) -> None:
    assert_all_refused(function, cases)


def test_a_chip_without_layers_is_rejected() -> None:
    with pytest.raises(ValueError, match="layers must be a sequence of one Layer or more"):
        mechanics.bend_on_cylinder([], 1e-2)
