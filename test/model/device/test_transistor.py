# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The transistor: currents and derivatives against 40-digit references, continuity, inverses, planes, and a sweep."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.device import paper, threshold_extraction, transistor
from posfet_model.device.transistor import Plane, Stack
from support.sweep import (
    ErrorMap,
    assert_all_refused,
    assert_finite,
    assert_monotone,
    corners,
    decades,
    reference,
    refusals,
    signed_decades,
)

EPS = np.finfo(np.float64).eps
STACK = paper.STACK
CURRENT_GOOD = {
    "gate_voltage": 1.7,
    "drain_voltage": 5.0,
    "threshold_voltage": 0.7,
    "gain_factor": 1e-3,
    "channel_length_modulation": 0.0,
}
OPERATORS = (transistor.drain_current, transistor.transconductance, transistor.output_conductance)


class TestStack:
    def test_capacitances_of_the_paper(self) -> None:
        assert STACK.oxide == pytest.approx(7.6736e-4, rel=0, abs=5e-9)
        assert STACK.film == pytest.approx(4.2500e-5, rel=0, abs=5e-10)
        assert STACK.series == pytest.approx(4.0270e-5, rel=0, abs=5e-10)

    def test_against_the_40_digit_table(self) -> None:
        table = reference("stack")
        oxide = transistor.capacitance_per_area(table["oxide"], table["oxide_height"])
        film = transistor.capacitance_per_area(table["film"], table["film_height"])
        stacks = [Stack(*pair) for pair in zip(oxide.tolist(), film.tolist(), strict=True)]
        charges = list(zip(table["charge"], stacks, table["kappa"], strict=True))
        computed = {
            "of_oxide": oxide,
            "of_film": film,
            "series": [stack.series for stack in stacks],
            "shift_gate": [transistor.threshold_shift(q, stack, Plane.GATE, kappa) for q, stack, kappa in charges],
            "shift_oxide": [transistor.threshold_shift(q, stack, Plane.OXIDE, kappa) for q, stack, kappa in charges],
            "gain_factor": transistor.gain_factor(0.085, [stack.series for stack in stacks], 3276e-6, 12e-6),
        }
        for name, values in computed.items():
            assert (np.abs(values - table[name]) <= 8 * EPS * np.abs(table[name])).all(), name

    @given(decades(1e-12, 1e3), decades(1e-12, 1e3))
    def test_inverse_capacitances_in_series_add(self, oxide: float, film: float) -> None:
        series = Stack(oxide, film).series
        assert 1 / series == pytest.approx(1 / oxide + 1 / film, rel=4 * EPS, abs=0)

    def test_signal_current_divides_the_same_charge_between_oxide_and_film(self) -> None:
        at_gate, at_oxide = (
            STACK.drive(plane) * transistor.threshold_shift(1e-5, STACK, plane, 1.0)
            for plane in (Plane.GATE, Plane.OXIDE)
        )
        share = STACK.oxide / (STACK.oxide + STACK.film)
        assert at_gate / at_oxide == pytest.approx(share, rel=4 * EPS, abs=0)

    def test_shift_of_the_paper_and_the_fraction_for_one_volt(self) -> None:
        shift = transistor.threshold_shift(0.07, STACK, Plane.OXIDE, 1.0)
        assert shift == pytest.approx(-91.222, rel=0, abs=5e-4)
        fraction = transistor.uncompensated_fraction(-1.0, 0.07, STACK, Plane.OXIDE)
        assert fraction == pytest.approx(0.010962, rel=0, abs=5e-7)

    @given(st.floats(1e-6, 1), signed_decades(1e-9, 1.0).filter(bool), st.sampled_from(Plane))
    def test_the_fraction_is_recovered(self, fraction: float, charge: float, plane: Plane) -> None:
        shift = transistor.threshold_shift(charge, STACK, plane, fraction)
        found = transistor.uncompensated_fraction(shift, charge, STACK, plane)
        assert found == pytest.approx(fraction, rel=1e-12, abs=0)

    @pytest.mark.parametrize("shift", [1.0, -92.0])
    def test_a_shift_that_the_charge_cannot_explain_is_rejected(self, shift: float) -> None:
        with pytest.raises(ValueError, match=r"kappa .* must be in \[0, 1\]"):
            transistor.uncompensated_fraction(shift, 0.07, STACK, Plane.OXIDE)


class TestDrainCurrent:
    def test_current_and_derivatives_against_the_40_digit_table(self, record_property) -> None:
        table = reference("transistor")
        arguments = [table[name] for name in ("overdrive", "drain_voltage")]
        factors = [table[name] for name in ("gain_factor", "channel_length_modulation")]
        found = ErrorMap(bound=8 * EPS)
        for function in OPERATORS:
            expected = table[function.__name__]
            error = function(*arguments, 0.0, *factors) - expected
            found.add(function.__name__, error / np.where(expected == 0, 1.0, np.abs(expected)))
        found.check(record_property)

    @given(decades(1e-9, 1e6), decades(1e-12, 1e6), st.sampled_from([0.0, 0.0248, 0.1, 10.0]))
    def test_the_current_is_continuous_at_the_edge_of_saturation(
        self, overdrive: float, beta: float, modulation: float
    ) -> None:
        edge = [math.nextafter(overdrive, 0), overdrive, math.nextafter(overdrive, math.inf)]
        edge = np.minimum(edge, 1e6)
        for function in OPERATORS[:2]:
            values = function(overdrive, edge, 0.0, beta, modulation)
            assert np.ptp(values) <= 1e-12 * values[1]

    @given(decades(1e-3, 1e3), decades(1e-3, 1e3), st.floats(-5, 5), st.sampled_from([0.0, 0.1]))
    def test_conductances_are_the_slopes(self, overdrive: float, drain: float, vth: float, modulation: float) -> None:
        # Id is piecewise a polynomial of degree 3, so away from the edge a five-point rule has rounding error only;
        # a complex step would need complex arguments, which are rejected.
        step = 0.01 * min(overdrive, drain)
        if abs(overdrive - drain) <= 4 * step:
            drain = 2 * overdrive
        weights, offsets = np.array([1, -8, 8, -1]) / 12, np.array([-2, -1, 1, 2])
        for function, gate_step, drain_step in (
            (transistor.transconductance, step, 0.0),
            (transistor.output_conductance, 0.0, step),
        ):
            currents = transistor.drain_current(
                vth + overdrive + gate_step * offsets, drain + drain_step * offsets, vth, 1e-3, modulation
            )
            slope = weights @ currents / step
            value = function(vth + overdrive, drain, vth, 1e-3, modulation)
            rounding = 8 * EPS * (currents.max() * (1 + (abs(vth) + overdrive) / overdrive) / step)
            assert abs(slope - value) <= rounding + 1e-12 * value

    @given(decades(1e-9, 1e2), decades(1e-6, 1e2), decades(1e-12, 0.1), st.sampled_from([0.0, 0.1, 10.0]))
    def test_gate_voltage_and_current_are_a_round_trip(
        self, overdrive: float, drain: float, beta: float, modulation: float
    ) -> None:
        current = transistor.drain_current(overdrive, drain, 0.0, beta, modulation)
        assert transistor.gate_voltage(current, drain, 0.0, beta, modulation) == pytest.approx(
            overdrive, rel=1e-12, abs=0
        )

    def test_zero_current_gives_the_threshold(self) -> None:
        assert transistor.gate_voltage(0.0, 5.0, 0.7, 1e-3) == 0.7


class TestSweep:
    BIAS = corners(
        gate_voltage=[-1e6, -5.0, 0.7, 0.7 + 1e-9, 1.7, 5.0, 1e6],
        drain_voltage=[0.0, 1e-9, 1.0, 5.0, 1e6],
        threshold_voltage=[-1e6, 0.7, 1e6],
        gain_factor=[1e-12, 9.3446e-4, 1e6],
        channel_length_modulation=[0.0, 0.1, 10.0],
    )

    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    @pytest.mark.parametrize("function", OPERATORS)
    def test_results_are_finite_and_never_negative(self, function, dtype) -> None:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            values = function(**{name: value.astype(dtype) for name, value in self.BIAS.items()})
        assert values.dtype == dtype
        assert_finite(values)
        assert (values >= 0).all()

    @pytest.mark.parametrize("modulation", [0.0, 0.1])
    def test_current_rises_with_either_voltage(self, modulation: float) -> None:
        volts = np.linspace(0, 10, 2001)
        gate, drain = np.meshgrid(volts, volts[::20])
        currents = transistor.drain_current(gate, drain, 0.7, 1e-3, modulation)
        slack = 4 * EPS * currents.max()
        assert_monotone(currents, rising=True, slack=slack)
        assert_monotone(currents.T, rising=True, slack=slack)

    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    @pytest.mark.parametrize("size", [0, 1, 1_000_000])
    def test_any_number_of_taxels(self, size: int, dtype) -> None:
        gate = np.linspace(0, 5, size, dtype=dtype)
        rest = (5.0, 0.7, 9.3446e-4, 0.0)  # scalars do not change the dtype of the array
        currents = transistor.drain_current(gate, *rest)
        assert currents.shape == (size,) and currents.dtype == dtype
        back = transistor.gate_voltage(currents, *rest)
        atol = 8 * np.finfo(dtype).eps * 5
        np.testing.assert_allclose(back, np.maximum(gate, rest[1]), rtol=0, atol=atol)


class TestThresholdFit:
    GATE = np.linspace(0, 3, 61)

    @given(st.floats(0.1, 1.5), decades(1e-6, 1.0), st.sampled_from([0.0, 0.1]))
    def test_saturation_curve(self, vth: float, beta: float, modulation: float) -> None:
        current = transistor.drain_current(self.GATE, 5.0, vth, beta, modulation)
        fit = threshold_extraction.fit_saturation_curve(self.GATE, current, 5.0)
        assert fit.threshold_voltage == pytest.approx(vth, rel=1e-12, abs=0)
        assert fit.gain_factor == pytest.approx(beta * (1 + 5 * modulation), rel=1e-12, abs=0)
        assert 2 <= fit.points < 61

    @given(st.floats(0.1, 1.5), decades(1e-6, 1.0))
    def test_linear_curve(self, vth: float, beta: float) -> None:
        current = transistor.drain_current(self.GATE, 0.05, vth, beta)
        fit = threshold_extraction.fit_linear_curve(self.GATE, current, 0.05)
        assert fit.threshold_voltage == pytest.approx(vth, rel=1e-12, abs=0)
        assert fit.gain_factor == pytest.approx(beta, rel=1e-12, abs=0)

    def test_meter_offset_and_noise_do_not_bias_the_threshold(self) -> None:
        """Readings below threshold have either sign; they are excluded."""
        generator = np.random.default_rng(8)
        for fit, drain in (
            (threshold_extraction.fit_saturation_curve, 5.0),
            (threshold_extraction.fit_linear_curve, 0.05),
        ):
            current = transistor.drain_current(self.GATE, drain, 0.7, 1e-3)
            noisy = current + generator.normal(-1e-3, 1e-3, current.size) * current.max()
            assert noisy.min() < 0
            found = fit(self.GATE, noisy, drain)
            assert found.threshold_voltage == pytest.approx(0.7, abs=0.01)
            assert found.gain_factor == pytest.approx(1e-3, abs=1e-5)

    def test_poling_moves_the_fitted_threshold_by_the_shift(self) -> None:
        shift = transistor.threshold_shift(0.07, STACK, Plane.OXIDE, 0.010962)
        fits = [
            threshold_extraction.fit_saturation_curve(
                self.GATE, transistor.drain_current(self.GATE, 5.0, vth, 1e-3), 5.0
            )
            for vth in (1.2, 1.2 + shift)
        ]
        moved = fits[1].threshold_voltage - fits[0].threshold_voltage
        assert moved == pytest.approx(float(shift), rel=0, abs=1e-12)

    def test_curves_from_the_wrong_region_are_rejected(self) -> None:
        linear = transistor.drain_current(self.GATE, 0.05, 0.7, 1e-3)
        with pytest.raises(ValueError, match="to saturate"):
            threshold_extraction.fit_saturation_curve(self.GATE, linear, 0.05)
        saturated = transistor.drain_current(self.GATE, 5.0, 0.7, 1e-3)
        with pytest.raises(ValueError, match="for the linear region"):
            threshold_extraction.fit_linear_curve(self.GATE, saturated, 5.0)

    @pytest.mark.parametrize("fit", [threshold_extraction.fit_linear_curve, threshold_extraction.fit_saturation_curve])
    @pytest.mark.parametrize(
        ("gate", "current", "complaint"),
        [
            ([], [], "gate_voltage must have two different"),
            ([1.0, 1.0], [1e-3, 1e-3], "gate_voltage must have two different"),
            ([1.0, 2.0], [1e-3, 0.9e-3], "drain_current must rise"),
            ([1.0, 2.0], [0.0, -1e-9], "drain_current must rise above 0"),
            ([1.0, 2.0, 3.0], [1e-3, 2e-3], r"shape \(n,\), got \(3,\) and \(2,\)"),
            (1.0, 1e-3, r"shape \(n,\)"),
        ],
    )
    def test_curves_unusable_for_a_fit_are_rejected(self, fit, gate, current, complaint) -> None:
        with pytest.raises(ValueError, match=complaint):
            fit(gate, current, 0.1)


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(Stack, {"oxide": 1e-3, "film": 1e-5}, oxide=[0, -1e-3, 1e4], film=[0, [1e-5]]),
        refusals(
            transistor.capacitance_per_area,
            {"relative_permittivity": 3.9, "thickness": 45e-9},
            relative_permittivity=[0, 0.5, -12],
            thickness=[0, -45e-9, 2.5],
        ),
        refusals(
            transistor.threshold_shift,
            {"charge": 0.07, "stack": STACK, "plane": Plane.OXIDE, "uncompensated_fraction": 1.0},
            charge=[2e6],
            stack=[],
            plane=["gate"],
            uncompensated_fraction=[-0.1, 1.1],
        ),
        refusals(
            transistor.uncompensated_fraction,
            {"shift": -1.0, "charge": 0.07, "stack": STACK, "plane": Plane.OXIDE},
            shift=[2e6],
            charge=[0, 2e6],
            stack=[],
            plane=["gate"],
        ),
        refusals(
            transistor.gain_factor,
            {"mobility": 0.085, "capacitance": 4e-5, "width": 1e-3, "length": 1e-5},
            mobility=[0, -0.085, 850],
            capacitance=[0],
            width=[0, -1],
            length=[0, 12],
        ),
        *(
            refusals(
                function,
                CURRENT_GOOD,
                gate_voltage=[2e6],
                drain_voltage=[-1e-9, 2e6],
                threshold_voltage=[-2e6],
                gain_factor=[0, -1],
                channel_length_modulation=[-0.1, 11],
            )
            for function in OPERATORS
        ),
        refusals(
            transistor.gate_voltage,
            {**{k: v for k, v in CURRENT_GOOD.items() if k != "gate_voltage"}, "drain_current": 1e-3},
            drain_current=[-1e-9, 2e6],
            drain_voltage=[0, -1],
            threshold_voltage=[2e6],
            gain_factor=[0],
            channel_length_modulation=[-1],
        ),
        *(
            refusals(
                function,
                {"gate_voltage": [1, 2], "drain_current": [1e-3, 2e-3], "drain_voltage": 5.0, "lowest_share": 0.1},
                gate_voltage=[[1, 2e6]],
                drain_current=[[-2e6, 1e-3]],
                drain_voltage=[0, -1, [5.0, 5.0]],
                lowest_share=[0, 1],
            )
            for function in (threshold_extraction.fit_linear_curve, threshold_extraction.fit_saturation_curve)
        ),
    ],
)
def test_invalid_arguments_are_rejected_by_name(function, cases) -> None:
    assert_all_refused(function, cases)


@pytest.mark.parametrize("plane", ["gate", "GATE", None, 0])
def test_a_value_that_is_no_plane_is_rejected(plane) -> None:
    with pytest.raises(ValueError, match=r"plane must be Plane.GATE or Plane.OXIDE, got"):
        STACK.drive(plane)
    with pytest.raises(ValueError, match=r"plane must be"):
        transistor.threshold_shift(0.07, STACK, plane, 1.0)


def test_incompatible_shapes_are_rejected_by_name() -> None:
    with pytest.raises(ValueError, match=r"shapes must broadcast.*gate_voltage \(3,\), drain_voltage \(2,\)"):
        transistor.drain_current(np.zeros(3), np.zeros(2), 0.7, 1e-3)
