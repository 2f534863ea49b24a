"""Designs adjusted to the figures that ngspice measured on another circuit: the follower is that circuit's."""

import numpy as np
import pytest

from posfet_model.design.design_file import load_design
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.recorded_runs import time_scale
from posfet_model.spice.stimuli import stimuli
from support.spice_data import recorded
from support.sweep import assert_refused


@pytest.mark.parametrize(
    ("nominal", "real"),
    [
        ("two_stage", "two_stage_100pf"),
        ("two_stage", "two_stage_half_cc"),
        ("one_stage", "one_stage_100pf"),
        ("one_stage", "one_stage_36db"),
    ],
)
def test_the_adjusted_follower_is_the_measured_circuit_in_ngspice(nominal: str, real: str) -> None:
    record = recorded(real)
    seen = record.exact_loop
    design = load_design(nominal).design.with_measured(record.open_loop.gain, seen.unity_crossing, seen.phase_margin)
    exact = load_design(real).design
    for field in ("compensation", "load_capacitance"):
        assert getattr(design, field) == pytest.approx(getattr(exact, field), rel=0.02)
    inputs = stimuli(CIRCUITS[real], time_scale(record.loop))
    for name in ("up_50_mv", "down_50_mv"):
        time, v_in = inputs[name].resolved(150)
        wanted = np.interp(time, record.runs[name].time, record.runs[name].v_out)
        error = design.follower().run(time, v_in).v_out - wanted
        assert 100 * np.sqrt(np.mean(error**2)) / 0.05 <= 0.05


def test_what_is_refused() -> None:
    good = {"gain": 400.0, "gain_bandwidth": 5e6, "phase_margin": 60.0}
    design = PosfetDesign()
    assert_refused(design.with_measured, {**good, "gain": 1e6}, "gain")
    assert_refused(design.with_measured, {**good, "gain_bandwidth": 0.0}, "gain_bandwidth")
    assert_refused(design.with_measured, {**good, "phase_margin": 180.0}, "phase_margin")
    with pytest.raises(ValueError, match=r"must be a single one, got arrays of shape \(2,\)"):
        PosfetDesign(supply=np.array([4.0, 5.0])).with_measured(**good)
