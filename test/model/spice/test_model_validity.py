# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Which models are valid on a run: said without their error, and confirmed by it."""

import json

import numpy as np
import pytest

from posfet_model import spice_compare
from posfet_model.amplifier.closed_loop import FollowerLimits
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.amplifier.slew_identification import slew_model
from posfet_model.spice.model_comparison import calibrated_models, deviation
from posfet_model.spice.model_validity import BEYOND, GAIN, LAG, SLEWING, reasons
from posfet_model.spice.ngspice import CIRCUITS, closed_loop
from posfet_model.spice.run_file import FollowerRun
from support.spice_data import path, small_signal, transient


@pytest.mark.parametrize(("circuit", "stages"), list(zip(CIRCUITS, (2, 1), strict=True)))
@pytest.mark.parametrize("stimulus", ["press", "tap", "sine", "step"])
def test_a_model_that_is_called_valid_is_near_ngspice(circuit: str, stages: int, stimulus: str) -> None:
    loop, run = closed_loop(small_signal(circuit, "ac")), transient(circuit, stimulus)
    models = calibrated_models(loop, slew_model(loop, stages=stages).follower())
    found = {name: reasons(run, model, loop) for name, model in models.items()}
    for name, model in models.items():
        if not found[name]:
            error = deviation(run, model)
            assert error.max_pct <= 0.5 or (name, stimulus) == ("square_law_slew", "step")
            assert error.rms_pct <= 0.9  # a step of the slewing model
    if stimulus == "step":
        assert found["ideal"] == [GAIN, LAG, SLEWING]
        assert found["static"] == [LAG, SLEWING]
        assert found["one_pole"] == found["two_pole"] == [SLEWING]
        assert found["square_law_slew"] == []
    else:
        assert [name for name, why in found.items() if why] == ([] if stimulus == "sine" else ["ideal"])


def test_a_run_beyond_the_range_of_a_model_is_said() -> None:
    loop, time = closed_loop(small_signal("opamp_b", "ac")), np.linspace(0, 1e-3, 101)
    run = FollowerRun(time, 2 * time / 1e-3, 2 * time / 1e-3)
    limited = OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth, limits=FollowerLimits(v_low=-1, v_high=1))
    assert reasons(run, limited, loop) == [BEYOND]


def test_the_command_says_what_is_valid_when_asked(capsys: pytest.CaptureFixture[str]) -> None:
    assert spice_compare.main([str(path("opamp_b", "step")), "--validity"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed["ideal"]["blind"]) == {"max_pct", "rms_pct", "valid", "reasons"}
    valid = [name for name, result in printed.items() if result["blind"]["valid"]]
    assert valid == ["square_law_slew"]
    assert printed["one_pole"]["blind"]["reasons"] == [SLEWING]
