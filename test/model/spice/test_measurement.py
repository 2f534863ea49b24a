# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Numbers from loop gains and steps, and the operating point of ngspice."""

import math
import shutil

import numpy as np
import pytest

from posfet_model.amplifier.step_test import mean_slope
from posfet_model.amplifier.two_stage import figures_of_merit
from posfet_model.spice import ngspice
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.measurement import (
    measure_bias_point,
    measure_loop,
    oscillates,
    overshoot,
)
from posfet_model.spice.netlist import subcircuit
from support.spice_data import recorded

needs_ngspice = pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")


def loop_gain(a0: float, *poles: float) -> ngspice.SmallSignal:
    frequency = np.geomspace(1.0, 1e9, 2000)
    transfer = a0 / np.prod([1 + 1j * frequency / pole for pole in poles], axis=0)
    return ngspice.SmallSignal(frequency=frequency, transfer=transfer)


def test_one_and_two_poles_have_their_known_numbers() -> None:
    one = measure_loop(loop_gain(1000.0, 1e3))
    assert one.gain_db == pytest.approx(60, abs=1e-4)
    assert one.dominant_pole == pytest.approx(1e3, rel=1e-4)
    assert one.unity_crossing == pytest.approx(1e6, rel=1e-4)
    assert one.phase_margin == pytest.approx(90 + math.degrees(1e-3), abs=1e-2)
    two = measure_loop(loop_gain(1000.0, 1e3, 1e6))
    ratio = math.sqrt((math.sqrt(5) - 1) / 2)  # crossing over second pole: x^2*(1 + x^2) = 1
    assert two.unity_crossing == pytest.approx(1e6 * ratio, rel=1e-3)
    assert two.phase_margin == pytest.approx(90 - math.degrees(math.atan(ratio)), abs=0.1)
    assert two.stable


def test_three_poles_may_be_unstable() -> None:
    measured = measure_loop(loop_gain(1000.0, 1e3, 1e5, 1e5))
    assert measured.phase_margin < 0
    assert not measured.stable


def test_a_loop_gain_above_one_throughout_is_an_error() -> None:
    with pytest.raises(ngspice.SpiceError, match="fall to 1"):
        measure_loop(ngspice.SmallSignal(frequency=np.array([1.0, 10.0]), transfer=np.array([9.0 + 0j, 8.0])))


def test_overshoot_and_slope_of_either_direction() -> None:
    time = np.linspace(0, 10, 5001)
    ringing = 1 - np.exp(-0.5 * time) * np.cos(2 * time)
    exact = 1 + math.exp(-0.5 * (math.pi - math.atan(0.25)) / 2) * math.cos(math.atan(0.25))
    assert overshoot(2 + 3 * ringing, 5.0) == pytest.approx(exact - 1, abs=1e-4)
    assert overshoot(2 - 3 * ringing, -1.0) == pytest.approx(exact - 1, abs=1e-4)
    assert overshoot(1 - np.exp(-time), 1.0) == 0
    ramp = np.clip(time - 3, 0, 2)
    assert mean_slope(time, ramp, 2.0) == pytest.approx(1, rel=1e-9)
    assert mean_slope(time, -2 * ramp, -4.0) == pytest.approx(2, rel=1e-9)
    assert math.isnan(mean_slope(time, ramp, 4.0))


def test_what_oscillates() -> None:
    time = np.linspace(0, 10, 2001)
    assert oscillates(np.sin(9 * time))
    assert oscillates(np.exp(0.2 * time) * np.sin(9 * time))
    assert not oscillates(1 - np.exp(-0.5 * time) * np.cos(9 * time))


def test_recorded_operating_points_are_those_of_square_laws() -> None:
    """gm = 2*I/Vov, gds = lambda*I/(1 + lambda*Vds), Cgs two thirds of the gate in saturation."""
    for name, circuit in CIRCUITS.items():
        for label, point in recorded(name).bias_point.transistors.items():
            assert point.saturated
            overdrive = point.gate_voltage - circuit.bias.threshold
            assert point.transconductance == pytest.approx(2 * point.current / overdrive, rel=1e-3)
            lam = circuit.bias.modulation
            assert point.output_conductance == pytest.approx(
                lam * point.current / (1 + lam * point.drain_voltage), rel=1e-3
            )
            area = circuit.design.size(label).width * circuit.design.size(label).length
            per_area = circuit.design.stack.series if label in ("M1", "M2") else circuit.design.stack.oxide
            assert point.gate_source_capacitance == pytest.approx(2 / 3 * area * per_area, rel=1e-3)
            assert point.gate_drain_capacitance < 0.01 * point.gate_source_capacitance


@pytest.mark.spice
@needs_ngspice
def test_the_operating_point_is_that_of_the_hand_formulas() -> None:
    found, figures = measure_bias_point(CIRCUITS["two_stage"]), figures_of_merit()
    assert found.transistors["M5"].current == pytest.approx(figures.tail_current, rel=1e-2)
    assert found.transistors["M7"].current == pytest.approx(figures.output_current, rel=1e-2)
    assert found.transistors["M1"].transconductance == pytest.approx(figures.input_transconductance, rel=1e-2)
    assert found.v_out == pytest.approx(figures.systematic_offset, abs=1e-4)


@pytest.mark.spice
@needs_ngspice
def test_an_unknown_quantity_is_an_error() -> None:
    with pytest.raises(ngspice.SpiceError):
        ngspice.run_operating_point(subcircuit(CIRCUITS["two_stage"]), ["v(out)", "@m.xdut.m9[gm]"])


@pytest.mark.spice
@needs_ngspice
@pytest.mark.parametrize("name", ["two_stage_100pf", "one_stage"])
def test_the_loop_gain_agrees_with_the_follower(name: str) -> None:
    """H = T/(1 + T) where the input does not reach the output past the op-amp, well below the unity crossing."""
    text = subcircuit(CIRCUITS[name])
    loop = ngspice.run_loop_gain(text, highest=1e5, per_decade=10)
    follower = ngspice.run_follower_ac(text, highest=1e5, per_decade=10)
    np.testing.assert_allclose(follower.transfer, loop.transfer / (1 + loop.transfer), rtol=2e-3)
    opened = ngspice.run_open_loop_ac(text, highest=1e5, per_decade=10)
    np.testing.assert_allclose(opened.transfer, loop.transfer, rtol=2e-2)
