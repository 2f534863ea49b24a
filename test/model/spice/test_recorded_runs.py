# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The recorded runs of the set of circuits: that they are of the circuits now, and what ngspice gives now."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model.spice import recorded_runs
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.record_file import load
from posfet_model.spice.recorded_runs import THINNING, deck_hash, record, thinned, time_scale
from posfet_model.spice.stimuli import stimuli
from support.spice_data import recorded

needs_ngspice = pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")


@pytest.mark.parametrize("name", CIRCUITS)
def test_the_recorded_runs_are_of_the_circuit_as_it_is_now(name: str) -> None:
    """If this fails: python -m posfet_model.spice.recorded_runs test/data/spice/circuits."""
    found, inputs = recorded(name), stimuli(CIRCUITS[name], time_scale(recorded(name).loop))
    assert found.deck_hash == deck_hash(CIRCUITS[name], inputs)
    assert found.simulator.startswith("ngspice-")
    assert {*found.runs, *found.unstable} == set(inputs)
    assert found.loop.stable or not found.runs
    for label, run in found.runs.items():
        assert run.time[-1] == pytest.approx(inputs[label].stop, rel=1e-6)


def test_the_set_covers_gains_bandwidths_and_margins() -> None:
    loops = [recorded(name).loop for name in CIRCUITS]
    assert min(loop.gain_db for loop in loops) < 36.5
    assert max(loop.gain_db for loop in loops) > 59.5
    assert min(loop.unity_crossing for loop in loops) < 0.3e6
    assert max(loop.unity_crossing for loop in loops) > 10e6
    assert sum(loop.phase_margin < 0 for loop in loops) >= 2
    assert sum(0 < loop.phase_margin < 45 for loop in loops) >= 5


def test_the_reference_is_converged() -> None:
    """Half the tolerance and half the step change no run of a stable circuit by 0.05 % of full scale."""
    stable = [recorded(name) for name in CIRCUITS if recorded(name).loop.stable]
    assert max(run.uncertainty for found in stable for run in found.runs.values()) < 0.05


def test_inputs_to_which_a_circuit_is_unstable_have_no_run() -> None:
    """Without Rz the margin is 16 degrees at 0 V and -18 at -1 V, where ngspice's integration hides the oscillation."""
    assert recorded("two_stage_no_zero_resistor").unstable == ("sine_1000_hz", "sine_10000_hz")
    assert recorded("two_stage_100pf").unstable == ()


def test_thinning_keeps_a_curve_within_its_tolerance() -> None:
    time = np.linspace(0, 1, 3001) ** 2
    curve = np.where(time > 0.3, 1 - np.exp(-9 * (time - 0.3)) * np.cos(60 * (time - 0.3)), 0.0)
    kept = thinned(time, curve, 1e-3)
    assert (kept[0], kept[-1]) == (0, 3000)
    assert kept.size < 300
    assert np.abs(np.interp(time, time[kept], curve[kept]) - curve).max() <= 1e-3


@pytest.mark.spice
@needs_ngspice
@pytest.mark.parametrize("name", ["two_stage_100pf", "one_stage_narrow_pair_25ua"])
def test_recorded_runs_match_the_installed_ngspice(name: str) -> None:
    before, now = recorded(name), record(CIRCUITS[name], ["up_1000_mv"])
    assert now.loop.phase_margin == pytest.approx(before.loop.phase_margin, abs=0.1)
    assert now.loop.unity_crossing == pytest.approx(before.loop.unity_crossing, rel=1e-3)
    for label, point in before.bias_point.transistors.items():
        assert now.bias_point.transistors[label].transconductance == pytest.approx(point.transconductance, rel=1e-4)
    run, fresh = before.runs["up_1000_mv"], now.runs["up_1000_mv"]
    swing = np.ptp(run.v_out)
    change = np.abs(np.interp(run.time, fresh.time, fresh.v_out) - run.v_out).max() / swing
    assert change <= 4 * THINNING + 0.01 * (run.uncertainty + fresh.uncertainty) * 5


@pytest.mark.spice
@needs_ngspice
def test_the_command_records_a_circuit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    short = replace(recorded("one_stage"), runs={"up_50_mv": recorded("one_stage").runs["up_50_mv"]})
    monkeypatch.setattr(recorded_runs, "record", lambda circuit: short)
    assert recorded_runs.main([str(tmp_path / "new"), "--circuit", "one_stage"]) == 0
    assert capsys.readouterr().out.startswith("one_stage: 42.3 dB")
    assert set(load(tmp_path / "new" / "one_stage.npz").runs) == {"up_50_mv"}
