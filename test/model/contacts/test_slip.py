# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The dynamic (high-pass) channel: power of a known vibration; slip distinguished from presses, taps and vibration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.contacts.slip import CORNER_FREQUENCY, DynamicChannel
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.commands.score import Run
from posfet_sim.commands.score import run as score
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.scene import load_scene
from reference.dense_pressure import sphere_forces
from support.long_cases import long_cases
from support.scan_player import press, scans

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
FINGER = sphere_forces(0.6e-3, -0.4e-3, 1.0, 6e-3, 1e6, SENSOR.device.contact_spread, LAYOUT.pitch_x, LAYOUT.rows)
CALIBRATED = replace(
    ErrorModel.default(), gain_spread=0.0, area_spread=0.0, leak_spread=0.0, dead_probability=0.0, stuck_probability=0.0
)
MISMATCH = Calibration.nominal(SENSOR).with_gain_error(0.05, np.random.default_rng(2))


def channel() -> DynamicChannel:
    return DynamicChannel(LAYOUT, 0.35e-3)


@pytest.mark.parametrize("frequency", [5.0, 50.0, 200.0, 400.0])
def test_the_dynamic_channel_is_a_one_pole_high_pass(frequency: float) -> None:
    fast, step = channel(), 1e-4  # fine steps: against the pole itself, not its sampled form
    seen = []
    force = FINGER * np.sin(2 * math.pi * frequency * step * np.arange(-1, 5000))[:, None]
    for change in np.diff(force, axis=0):
        fast.advance(change, step)
        seen.append(fast.high_passed[12])
    expected = FINGER[12] * frequency / math.hypot(frequency, CORNER_FREQUENCY)
    assert np.abs(seen[3000:]).max() == pytest.approx(expected, rel=0.04)


def test_a_step_passes_and_decays_and_a_pause_resets_the_channel() -> None:
    fast = channel()
    fast.advance(np.zeros(LAYOUT.taxels), 1e-3)
    fast.advance(FINGER, 1e-3)
    passed = 2 * math.pi * CORNER_FREQUENCY * 1e-3
    decay = math.exp(-passed)
    np.testing.assert_allclose(fast.high_passed, FINGER * (1 - decay) / passed, rtol=0, atol=1e-12)
    fast.advance(np.zeros(LAYOUT.taxels), 1e-3)
    np.testing.assert_allclose(fast.high_passed, FINGER * decay * (1 - decay) / passed, rtol=0, atol=1e-12)
    fast.pause()
    fast.advance(FINGER, 1e-3)
    assert not fast.high_passed.any()


def shaken(time: float) -> float:
    return press(1.0, 0.3, 9.0)(time) * (1.0 + 0.2 * math.sin(2 * math.pi * 180 * time))


def test_the_reported_vibration_of_a_held_contact_is_its_amplitude_in_the_band() -> None:
    reconstructor = Reconstructor(SENSOR)
    reconstructor.vibration_wanted = True
    found, taxel = [], []
    for time, scan in scans(SENSOR, 1.0, force=shaken, shape=FINGER):
        result = reconstructor.process(scan)
        if time < 0.29:
            assert not reconstructor.vibration()[12] > 2e-3
        if time > 0.5:
            [contact] = result.contacts
            share = FINGER[contact.region.taxels].sum()
            found.append(result.motions[contact.id].vibration / share)
            assert not result.motions[contact.id].slipping
            taxel.append(float(reconstructor.vibration()[12]))
    # 0.2 N at 180 Hz, attenuated by the high pass.
    passes = 180 / math.hypot(180, CORNER_FREQUENCY) * 0.2 / math.sqrt(2)
    assert np.mean(found) == pytest.approx(passes, rel=0.02)
    assert np.mean(taxel) == pytest.approx(passes * FINGER[12], rel=0.02)


def test_the_channel_is_not_computed_without_contact_and_subscriber(monkeypatch: pytest.MonkeyPatch) -> None:
    reconstructor = Reconstructor(SENSOR)
    monkeypatch.setattr(DynamicChannel, "advance", lambda *_: pytest.fail("computed although not needed"))
    for _, scan in scans(SENSOR, 0.3):
        reconstructor.process(scan)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4))])
def test_each_jerk_of_a_slipping_cylinder_is_detected_within_6_ms(seed: int) -> None:
    found = score(Run(SENSOR, load_scene("grasp_lift_slip", SENSOR), 5.0, seed, CALIBRATED, MISMATCH))
    assert found.slip_recall == 1.0
    assert found.slip_onset_delay_ms["max"] is not None and found.slip_onset_delay_ms["max"] <= 6.1
    assert found.false_slips_per_hour == 0.0


@pytest.mark.parametrize(
    "scene", long_cases(["press", "tap", "vibration", "two_fingers", "slide", "texture"], ["tap", "vibration", "slide"])
)
def test_no_slip_is_reported_without_slip(scene: str) -> None:
    found = score(Run(SENSOR, load_scene(scene, SENSOR), 3.0, 2, CALIBRATED, MISMATCH))
    assert found.slip_recall is None
    assert found.false_slips_per_hour == 0.0
    assert found.contact_recall is not None and found.contact_recall > 0.9
