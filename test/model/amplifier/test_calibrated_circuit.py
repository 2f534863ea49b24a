# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Circuits adjusted to measured figures: what was changed is found again, and the follower is that of ngspice."""

import numpy as np
import pytest

from posfet_model.amplifier.calibration import calibrate_circuit
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import circuit_figures
from posfet_model.amplifier.one_stage import CIRCUIT_C
from posfet_model.amplifier.transient_follower import CircuitFollower
from posfet_model.spice.circuits import CIRCUITS
from support.sweep import assert_refused

NOMINAL = {2: AmplifierCircuit.from_design(), 1: AmplifierCircuit.from_design(CIRCUIT_C, stages=1)}
LOADED = ("two_stage", "two_stage_100pf", "two_stage_300pf", "two_stage_half_cc", "two_stage_10mhz_1pf")
OTHERS = ("one_stage_100pf", "one_stage_half_cc_30pf", "one_stage_36db", "one_stage_10mhz", "one_stage_300khz_300pf")


@pytest.mark.parametrize("name", LOADED + OTHERS)
def test_changed_load_compensation_and_modulation_are_found_again(name: str) -> None:
    of = CIRCUITS[name]
    exact = AmplifierCircuit.from_design(of.bias, of.design, of.stages)
    figures = circuit_figures(exact)
    found = calibrate_circuit(
        NOMINAL[of.stages], float(figures.gain), float(figures.gain_bandwidth), float(figures.phase_margin)
    )
    for field in ("compensation", "load_capacitance", "load_resistance", "modulation"):
        assert float(getattr(found, field)) == pytest.approx(float(getattr(exact, field)), rel=1e-4)


def test_another_pair_is_matched_in_small_signals() -> None:
    of = CIRCUITS["two_stage_narrow_pair_50pf"]
    exact = CircuitFollower.from_design(of.bias, of.design)
    wanted = exact.figures
    circuit = calibrate_circuit(
        NOMINAL[2], float(wanted.gain), float(wanted.gain_bandwidth), float(wanted.phase_margin)
    )
    follower = CircuitFollower(circuit=circuit)
    assert follower.figures.phase_margin == pytest.approx(float(wanted.phase_margin), abs=1e-4)
    time = np.linspace(0, 3e-6, 61)
    v_in = np.where(time > 2e-7, 0.05, 0.0)
    error = follower.run(time, v_in).v_out - exact.run(time, v_in).v_out
    assert 100 * np.sqrt(np.mean((error - error[0]) ** 2)) / 0.05 <= 0.5


def test_what_is_refused() -> None:
    good = {"circuit": NOMINAL[2], "gain": 130.0, "gain_bandwidth": 1.5e6, "phase_margin": 90.0}
    for name in ("gain", "gain_bandwidth"):
        assert_refused(calibrate_circuit, {**good, name: 0.0}, name)
    assert_refused(calibrate_circuit, {**good, "phase_margin": 180.0}, "phase_margin")
    assert_refused(calibrate_circuit, {**good, "gain": 1e6}, "gain")  # more than two stages of these sizes have
    assert_refused(calibrate_circuit, {**good, "circuit": AmplifierCircuit.stack([NOMINAL[2]] * 2)}, "circuit")
