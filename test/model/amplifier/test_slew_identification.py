# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Identification of a slewing follower from gain and bandwidth."""

import math
from dataclasses import replace

import pytest

from posfet_model.amplifier.closed_loop import ClosedLoop
from posfet_model.amplifier.differential_pair import NO_LEAD
from posfet_model.amplifier.one_stage import CIRCUIT_C, one_stage_figures
from posfet_model.amplifier.slew_identification import (
    OVERDRIVE,
    SlewModel,
    one_stage_model,
    slew_model,
    two_stage_model,
)
from posfet_model.amplifier.two_stage import CIRCUIT_B, figures_of_merit
from support.sweep import assert_refused

ONE_POLE = 1.5e6 * (1 + 1 / 10 ** (42.3 / 20))


@pytest.mark.parametrize("ratio", [1e-6, 0.708, 1.0, 1.38, 1e6])
def test_the_circuit_is_the_one_that_is_stated(ratio: float) -> None:
    loop = ClosedLoop(0.99, ratio * ONE_POLE)
    unknown, one, two = (slew_model(loop, stages=stages) for stages in (None, 1, 2))
    assert [model.amplifier for model in (unknown, one, two)] == [
        "one pole",
        "one stage and an output follower",
        "two stages",
    ]
    assert unknown.loop == loop and unknown.overdrive == OVERDRIVE
    for model in (one, two, slew_model(loop, 1.5e6)):
        assert model.loop.bandwidth == pytest.approx(ONE_POLE, rel=1e-12)
        assert model.loop.gain == model.follower().gain == 0.99


@pytest.mark.parametrize("ratio", [0.708, 0.8, 0.94, 0.999])
def test_the_zero_of_two_stages_reproduces_the_bandwidth(ratio: float) -> None:
    follower = slew_model(ClosedLoop(0.99, ratio * ONE_POLE), stages=2).follower()
    assert follower.response(ratio * ONE_POLE).gain == pytest.approx(0.99 / math.sqrt(2), abs=1e-12)


def test_overdrives_are_those_of_the_hand_formulas() -> None:
    two, one = figures_of_merit(), one_stage_figures()
    assert slew_model(ClosedLoop(0.99, ONE_POLE), stages=2).overdrive == two.slew_overdrive
    assert slew_model(ClosedLoop(0.99, ONE_POLE), stages=1).overdrive == one.slew_overdrive
    assert one.slew_overdrive < OVERDRIVE < two.slew_overdrive
    # The follower has the slew rate of the op-amp, corrected for gain and gain-bandwidth product.
    for figures in (two, one):
        follower = SlewModel("", figures.closed_loop, figures.slew_overdrive).follower()
        a0 = figures.open_loop_gain
        assert follower.slew_rate == pytest.approx(figures.slew_rate * (1 + 1 / a0) * a0 / (1 + a0), rel=1e-12)


def test_all_figures_scale_with_the_gain_bandwidth_product() -> None:
    model = slew_model(ClosedLoop(0.99, 0.94 * ONE_POLE / 1000), 1.5e3, 2)
    usual = slew_model(ClosedLoop(0.99, 0.94 * ONE_POLE), stages=2)
    assert model.loop.bandwidth == pytest.approx(usual.loop.bandwidth / 1000, rel=1e-12)
    assert model.lead.linear == pytest.approx(usual.lead.linear, abs=1e-12)
    assert model.follower(0.2).overdrive == 0.2
    assert slew_model(ClosedLoop(0.99, 1e5)).lead == NO_LEAD


def test_hand_formulas_of_a_ringing_op_amp_give_nothing_valid() -> None:
    for make, bias in ((two_stage_model, CIRCUIT_B), (one_stage_model, CIRCUIT_C)):
        loaded = replace(bias, load_capacitance=100e-12)
        for of, usable in ((bias, True), (loaded, False)):
            found = make(of).follower().run([0.0, 1e-6], [0.0, 0.01])
            assert found.valid.tolist() == [usable, usable]


def test_stages_are_one_or_two() -> None:
    assert_refused(slew_model, {"loop": ClosedLoop(0.99, 1e6), "stages": 3}, "stages")


@pytest.mark.parametrize("value", [0.0, -1.0, 1e15])
def test_a_gain_bandwidth_product_out_of_range_is_rejected_by_name(value: float) -> None:
    assert_refused(slew_model, {"loop": ClosedLoop(0.99, 1e6), "gain_bandwidth": value}, "gain_bandwidth")
