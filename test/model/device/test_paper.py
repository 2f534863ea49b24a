# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The numbers of the paper and its formulas as printed: values, sources and errors."""

import itertools
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from posfet_model.device import as_printed, charge, film, mechanics, paper, transistor
from posfet_model.device.transistor import Plane
from posfet_model.sensor.description import load_sensor
from support.sweep import assert_all_refused, refusals


def test_every_number_has_a_name_a_unit_and_a_source() -> None:
    quantities = paper.quantities()
    assert len(quantities) >= 20
    assert len({quantity.name for quantity in quantities}) == len(quantities)
    for quantity in quantities:
        assert quantity.name and quantity.unit and quantity.source
        assert math.isfinite(quantity.value)


def test_values_that_the_paper_does_not_give_are_marked_as_assumed() -> None:
    for quantity in paper.quantities():
        from_somewhere = quantity.source.startswith(("Table", "Sec.", "text", "Measurement Specialties"))
        assert quantity.assumed or from_somewhere
    assert [size.name for size in paper.AMPLIFIER_SIZES if size.assumed] == ["M8"]


def test_table_i_in_si() -> None:
    assert (paper.CHANNEL_WIDTH.value, paper.CHANNEL_LENGTH.value) == (3276e-6, 12e-6)
    assert (paper.MOBILITY.value, paper.OXIDE_THICKNESS.value) == (850e-4, 45e-9)
    assert paper.COERCIVE_FIELD.value * paper.FILM_THICKNESS.value == pytest.approx(40, rel=0, abs=1e-12)
    assert film.branch_steepness(160e5, 0.02, 0.05) == pytest.approx(1.8884e7, rel=0, abs=500)


def test_pressing_and_warming_change_the_charge_in_opposite_directions() -> None:
    coefficients = paper.PIEZOELECTRIC_COEFFICIENT.value, paper.PYROELECTRIC_COEFFICIENT.value
    assert charge.source_charge(-1e6, 0.0, *coefficients) == pytest.approx(38e-6, rel=0, abs=1e-15)
    assert charge.source_charge(0.0, 1.0, *coefficients) == pytest.approx(-40e-6, rel=0, abs=1e-15)
    device = load_sensor().device
    assert device.piezoelectric_coefficient == pytest.approx(coefficients[0], rel=0, abs=1e-20)
    assert device.pyroelectric_coefficient == pytest.approx(coefficients[1], rel=0, abs=1e-14)


def test_the_second_stage_balances() -> None:
    width = {size.name: size.width for size in paper.AMPLIFIER_SIZES}
    assert width["M7"] / width["M3"] == pytest.approx(2 * width["M8"] / width["M5"], rel=0, abs=1e-12)


STACKS = (transistor.Stack(1e-12, 1e-12), transistor.Stack(1e3, 1e3), transistor.Stack(1e-12, 1e3))
PLATES = {"pressure": (0.0, 1e12), "thickness": (1e-9, 1.0), "young_modulus": (1e3, 2e12)}
EXTREMES = [
    (
        as_printed.electric_displacement,
        {
            "stress": (-1e16, 1e16),
            "piezoelectric_coefficient": (-1e-6, 1e-6),
            "relative_permittivity": (1.0, 1e5),
        },
    ),
    (as_printed.threshold_shift, {"stack": STACKS, "charge": (-1e6, 1e6)}),
    (
        as_printed.signal_current,
        {
            "stack": STACKS,
            "charge": (-1e6, 1e6),
            "overdrive": (-1e6, 1e6),
            "mobility": (1e-9, 100.0),
            "aspect": (1e-9, 1e9),
        },
    ),
    (
        as_printed.saturation_current,
        {"gate_voltage": (-1e6, 1e6), "threshold_voltage": (-1e6, 1e6), "gain_factor": (1e-12, 1e6)},
    ),
    (as_printed.circular_deflection, {**PLATES, "radius": (1e-9, 1.0), "poisson_ratio": (-0.999, 0.5)}),
    (as_printed.square_deflection, {**PLATES, "side": (1e-9, 1.0)}),
]
"""The ends of every argument's range."""
NUMBERS = {"mobility", "aspect"}


class TestAsPrinted:
    def test_steepness_of_the_swapped_values_is_undefined(self) -> None:
        assert math.isnan(as_printed.branch_steepness(160e5, 0.05, 0.02))
        assert as_printed.branch_steepness(160e5, 0.02, 0.05) == pytest.approx(paper.FILM.steepness, rel=1e-12, abs=0)

    def test_a_formula_without_a_value_is_nan(self) -> None:
        """The logarithm of 1, a division by zero, and the logarithm of a negative number."""
        for remnant in (0.0, 1e-30, 0.05, math.nextafter(0.05, 1), 10.0):
            value = as_printed.branch_steepness(160e5, remnant, 0.05)
            assert math.isnan(value) != (remnant == 1e-30)

    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    @pytest.mark.parametrize(("function", "good"), EXTREMES, ids=lambda value: getattr(value, "__name__", ""))
    def test_nothing_overflows_at_the_ends_of_the_ranges(self, function, good, dtype) -> None:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            for values in itertools.product(*good.values()):
                arguments = {
                    name: np.array([value], dtype) if isinstance(value, float) and name not in NUMBERS else value
                    for name, value in zip(good, values, strict=True)
                }
                assert np.isfinite(function(**arguments)).all(), arguments
            for name, ends in good.items():
                if isinstance(ends[-1], float):
                    with pytest.raises(ValueError, match=name):
                        function(**{other: value[0] for other, value in good.items()} | {name: 1e300})

    def test_saturation_current_jumps_by_two(self) -> None:
        right = transistor.drain_current(1.7, 1.0, 0.7, 1e-3)
        assert as_printed.saturation_current(1.7, 0.7, 1e-3) / right == pytest.approx(2, rel=0, abs=1e-12)
        assert as_printed.saturation_current(0.6, 0.7, 1e-3) == 0

    def test_signal_current_is_too_small_by_the_ratio_of_the_capacitances(self) -> None:
        aspect = paper.CHANNEL_WIDTH.value / paper.CHANNEL_LENGTH.value
        printed = as_printed.signal_current(1e-5, 0.5, paper.MOBILITY.value, aspect, paper.STACK)
        shift = transistor.threshold_shift(1e-5, paper.STACK, Plane.GATE, 1.0)
        right = -paper.channel_gain_factor(Plane.GATE) * 0.5 * shift
        assert right / printed == pytest.approx(18.06, rel=0, abs=5e-3)

    def test_shift_and_displacement(self) -> None:
        assert as_printed.threshold_shift(0.07, paper.STACK) == pytest.approx(-91.222, rel=0, abs=5e-4)
        right = charge.electric_displacement(-1e6, 0.0, -38e-12, 12.0)
        assert right == pytest.approx(3.8e-5, rel=0, abs=1e-19)
        assert charge.electric_displacement(0.0, 1e7, -38e-12, 12.0) == pytest.approx(1.0625e-3, rel=0, abs=1e-8)
        wrong = as_printed.electric_displacement(-1e6, -38e-12, 12.0)
        assert wrong == pytest.approx(3.8e-5 - 12 * 8.8541878188e-6, rel=0, abs=1e-18)

    def test_deflections(self) -> None:
        plate = (100.0, 5e-3, 50e-6, 169e9)
        right = mechanics.circular_deflection(*plate, 0.3).deflection
        assert right / as_printed.circular_deflection(*plate, 0.3) == pytest.approx(math.pi, rel=0, abs=1e-12)
        right = mechanics.square_deflection(*plate, 0.3).deflection
        assert as_printed.square_deflection(*plate) / right == pytest.approx(1, rel=0, abs=2e-3)


PLATE = {"pressure": 100.0, "thickness": 50e-6, "young_modulus": 169e9}
NO_PLATE = {"pressure": [-1.0], "thickness": [0.0, -50e-6], "young_modulus": [0.0, -1.0]}


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(
            as_printed.circular_deflection,
            {**PLATE, "radius": 5e-3, "poisson_ratio": 0.3},
            **NO_PLATE,
            radius=[0.0, -1.0, [1e-3, 2e-3, [3e-3]]],
            poisson_ratio=[0.6],
        ),
        refusals(as_printed.square_deflection, {**PLATE, "side": 5e-3}, **NO_PLATE, side=[0.0, -1.0]),
        refusals(as_printed.threshold_shift, {"charge": 0.07, "stack": paper.STACK}, charge=[], stack=[]),
        refusals(
            as_printed.signal_current,
            {"charge": 1e-5, "overdrive": 0.5, "mobility": 0.085, "aspect": 273.0, "stack": paper.STACK},
            charge=[],
            overdrive=[],
            mobility=[],
            aspect=[[1.0, 2.0]],
            stack=[],
        ),
    ],
)
def test_the_printed_forms_reject_invalid_arguments_by_name(function, cases) -> None:
    assert_all_refused(function, cases)


def test_the_model_needs_neither_ros_nor_matplotlib() -> None:
    modules = ("film", "transistor", "threshold_extraction", "charge", "mechanics", "paper", "as_printed")
    program = (
        "import sys\n"
        + "".join(f"import posfet_model.device.{name}\n" for name in modules)
        + "print([name for name in ('rclpy', 'matplotlib', 'scipy', 'yaml', 'can') if name in sys.modules])"
    )
    path = str(Path(paper.__file__).parents[2])
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env={"PYTHONPATH": path}
    )
    assert run.stdout.strip() == "[]"
