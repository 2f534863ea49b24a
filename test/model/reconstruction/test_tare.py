# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Tare: forces are set to zero, by request at rest, and by force at any time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import force_noise_rms, volts_per_count
from reference.dense_pressure import sphere_forces
from support.scan_player import press, scans

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
FINGER = sphere_forces(0.6e-3, -0.4e-3, 1.0, 6e-3, 1e6, SENSOR.device.contact_spread, LAYOUT.pitch_x, LAYOUT.rows)
NOISE = force_noise_rms(SENSOR)
BLOCK = 20
"""Scans in a block."""


def drifting(index: int, scan: Scan) -> None:
    """Shift the signal of every taxel by 2 mN/s from 0.5 s on: drift, as fast as baselines are tracked."""
    drift = 2e-6 * max(index - 500, 0) * SENSOR.volts_per_newton / volts_per_count(SENSOR)
    scan.counts[:] = scan.counts + round(drift)


def well(index: int, scan: Scan) -> None:
    """No fault."""


def recording(
    duration: float, force: Callable[[float], float] = lambda _: 0.0, edit: Callable[[int, Scan], None] = well
) -> list[Scan]:
    """Return copies of the scans, 1 ms apart."""
    copies = []
    for index, (_, scan) in enumerate(scans(SENSOR, duration, force=force, shape=FINGER)):
        edit(index, scan)
        copies.append(scan.snapshot())
    return copies


def play(reconstructor: Reconstructor, recorded: list[Scan]) -> tuple[list[Reconstruction], list[float]]:
    """Return the results, and the total force after each scan [N]."""
    results, totals = [], []
    for scan in recorded:
        results.append(reconstructor.process(scan).snapshot())
        totals.append(reconstructor.image().total)
    return results, totals


@pytest.mark.parametrize("edit", [well, drifting])
@pytest.mark.parametrize("end", range(1045, 1065, 4))
def test_a_tare_leaves_a_rest_that_is_zero_within_the_noise(edit: Callable[[int, Scan], None], end: int) -> None:
    """Also in the middle of a block, and while drift is being corrected."""
    recorded = recording(1.2, edit=edit)
    reconstructor = Reconstructor(SENSOR)
    for scan in recorded[:end]:
        reconstructor.process(scan)
    tare = reconstructor.tare()
    assert tare.done
    forces = []
    for scan in recorded[end : end + 2 * BLOCK]:
        reconstructor.process(scan)
        forces.append(reconstructor.image().force.copy())
    # The mean of the block that set the zero, and the mean of two: 5 standard deviations on the greatest of 25 taxels.
    assert np.abs(np.mean(forces, axis=0)).max() < 5.0 * NOISE * math.sqrt(1.5 / BLOCK)


@pytest.mark.parametrize("at", [1000, 1007])
def test_a_forced_tare_under_load_ends_the_contact(at: int) -> None:
    """At the end and in the middle of a block; later changes count from the force at that time."""
    recorded = recording(2.5, lambda time: press(1.5, 0.5, 9.0)(time) + press(1.0, 2.0, 9.0)(time))
    reconstructor = Reconstructor(SENSOR)
    before, _ = play(reconstructor, recorded[:at])
    [held] = before[-1].contacts
    refused = reconstructor.tare()
    assert not refused.done
    assert "force the tare" in refused.message
    tare = reconstructor.tare(force=True)
    assert tare.done
    assert float(tare.force_change.sum()) == pytest.approx(-1.5, abs=0.05)
    after, totals = play(reconstructor, recorded[at:])
    assert [(contact.id, contact.state) for contact in after[0].contacts] == [(held.id, ContactState.RELEASED)]
    assert not any(result.contacts for result in after[1 : 2000 - at])
    # One scan sets the zero, another is compared with it, at most 1000 times.
    assert np.abs(totals[: 2000 - at]).max() < 5.0 * NOISE * math.sqrt(2 * LAYOUT.taxels)
    [later] = after[-1].contacts
    assert later.id != held.id
    assert later.region.force == pytest.approx(1.0, abs=0.03)


def test_a_forced_tare_is_done_while_forces_are_not_valid_but_not_before_the_first_scan() -> None:
    reconstructor = Reconstructor(SENSOR)
    assert not reconstructor.tare(force=True).done
    recorded = recording(2.0, press(1.5, -1.0, 0.3))
    results, _ = play(reconstructor, recorded[:50])
    assert not results[-1].valid
    assert not reconstructor.tare().done
    assert reconstructor.tare(force=True).done
    results, totals = play(reconstructor, recorded[50:])
    assert results[-1].valid
    assert totals[-1] == pytest.approx(0.0, abs=0.02)


def test_a_forced_tare_removes_a_force_whose_release_was_missed() -> None:
    """The touch ends while 300 ms of scans are lost: part of its force may stay."""
    reconstructor = Reconstructor(SENSOR)
    recorded = recording(3.5, lambda time: press(1.5, 0.6, 0.702, 0.005)(time) + press(1.0, 2.5, 9.0)(time))
    play(reconstructor, recorded[:700])
    play(reconstructor, recorded[1000:1300])
    assert reconstructor.tare(force=True).done
    after, totals = play(reconstructor, recorded[1300:])
    assert not any(result.contacts for result in after[1:1190])
    assert abs(totals[1100]) < 0.02
    assert after[1100].valid
    [contact] = after[-1].contacts
    assert abs(contact.region.force - 1.0) < 2.0 * math.sqrt(contact.region.force_variance)
    assert contact.region.force == pytest.approx(1.0, abs=0.03)
