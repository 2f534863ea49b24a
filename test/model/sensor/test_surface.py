# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The surface of a bent chip, verified against that of the scenes, and contacts on it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.config import ConfigError
from posfet_model.contacts.detection import Region
from posfet_model.contacts.placement import placement_on
from posfet_model.contacts.tracker import Contact, ContactState
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import SENSOR_FOLDER, load_sensor
from posfet_model.sensor.surface import Surface, taxel_normals, taxel_points
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import ChipBend, load_scene

FLAT = load_sensor()
FILE = (SENSOR_FOLDER / "posfet_5x5.yaml").read_text(encoding="utf-8")

lengths = st.floats(-3.75e-3, 3.75e-3)
surfaces = st.builds(Surface, st.floats(3e-3, 1.0), st.booleans())


def bent_file(folder: Path, radius: object, axis: str = "y") -> Path:
    path = folder / "bent.yaml"
    keys = f"  bend_radius_mm: {radius}\n  bend_axis: {axis}\n"
    path.write_text(FILE.replace("  # bend_radius_mm", keys + "  # bend_radius_mm"), encoding="utf-8")
    return path


@given(surfaces, lengths, lengths)
def test_the_surface_equals_that_of_the_scenes(surface: Surface, x: float, y: float) -> None:
    point, tilt = ChipBend(surface.radius, surface.axis_x).surface_point(x, y)
    np.testing.assert_allclose(surface.point(x, y), point, rtol=0, atol=1e-15)
    assert surface.tilt(x, y) == tilt
    assert math.hypot(*surface.normal(x, y)) == pytest.approx(1.0, abs=1e-12)


@given(surfaces, lengths, lengths, st.floats(-1, 1), st.floats(-1, 1))
def test_tangent_vectors_equal_the_slopes_of_the_surface(
    surface: Surface, x: float, y: float, u: float, v: float
) -> None:
    step = 1e-7
    ahead, behind = (np.array(surface.point(x + way * u * step, y + way * v * step)) for way in (1, -1))
    along = surface.along(x, y, (u, v))
    np.testing.assert_allclose(along, (ahead - behind) / (2 * step), rtol=0, atol=1e-7)
    assert np.dot(along, surface.normal(x, y)) == pytest.approx(0.0, abs=1e-12)
    assert math.hypot(*along) == pytest.approx(math.hypot(u, v), abs=1e-12)


@given(surfaces, lengths, lengths)
def test_the_orientation_rotates_z_to_the_normal(surface: Surface, x: float, y: float) -> None:
    i, j, k, w = surface.orientation(x, y)
    turned = (2 * (i * k + j * w), 2 * (j * k - i * w), 1 - 2 * (i * i + j * j))
    np.testing.assert_allclose(turned, surface.normal(x, y), rtol=0, atol=1e-12)


def test_a_flat_chip_lies_in_its_frame() -> None:
    surface = Surface.of(FLAT.layout)
    assert surface.flat
    assert surface.point(1e-3, -2e-3) == (1e-3, -2e-3, 0.0)
    assert surface.normal(1e-3, -2e-3) == (0.0, 0.0, 1.0)
    np.testing.assert_array_equal(taxel_points(FLAT.layout)[:, :2], FLAT.layout.positions)
    np.testing.assert_array_equal(taxel_normals(FLAT.layout), np.tile([0.0, 0.0, 1.0], (25, 1)))


@pytest.mark.parametrize("axis", ["x", "y"])
def test_contacts_on_a_bent_chip_have_the_true_normals(tmp_path: Path, axis: str) -> None:
    sensor = load_sensor(bent_file(tmp_path, 6.0, axis))
    place, reconstructor = placement_on(Surface.of(sensor.layout)), Reconstructor(sensor)
    scene = load_scene("press_slide_lift", sensor)
    assert scene.bend == ChipBend(6e-3, axis == "x")
    tilted = 0.0
    for scan, truth in received_scans(sensor, scene, 2.5, 1):
        contacts = reconstructor.process(scan).contacts
        objects = truth.objects
        if not contacts or not len(objects.contact_objects) or objects.contact_forces[0] < 0.5:
            continue
        head, _ = place(contacts[0])
        normal, force = np.array(head[6:9]), np.array(head[9:12])
        tilted = max(tilted, math.acos(normal[2]))
        assert normal @ objects.contact_normals[0] > math.cos(0.1e-3 / 6e-3)
        np.testing.assert_allclose(force, -contacts[0].region.force * normal, rtol=0, atol=1e-12)
        true = Surface.of(sensor.layout).point(*objects.contact_centres[0])
        assert math.dist(head[:3], true) < 0.1e-3
    assert tilted > 0.1


def test_unknown_values_stay_unknown_and_transforms_stay_valid() -> None:
    region = Region(np.arange(1), np.arange(1), (0.0, 1e-3), (0.0, 0.0), 2.0, 0.01, 1e-6, 1.0, (1e-3, 0.0), (0.0, 1e-3))
    contact = Contact(1, ContactState.HELD, region, (0.0, 0.0), 1.0)
    uncertain = contact._replace(region=region._replace(force_variance=math.nan))
    for surface in (Surface(math.inf, True), Surface(5e-3, True)):
        head, tail = placement_on(surface)(contact)
        normal = np.array(surface.normal(0.0, 1e-3))
        assert np.isfinite(head[:12]).all()
        np.testing.assert_allclose(head[12:], 0.01 * np.outer(normal, normal).ravel(), rtol=1e-12, atol=0)
        assert np.isfinite(tail).all()
        assert not any(placement_on(surface)(uncertain)[0][12:]), "unknown as in sensor_msgs"
    fresh = contact._replace(velocity=(math.nan, math.nan))
    for surface in (Surface(math.inf, True), Surface(5e-3, False)):
        assert np.isnan(placement_on(surface)(fresh)[1][6:]).all()


@pytest.mark.parametrize(
    ("radius", "axis", "words"), [(1.0, "y", "bend_radius_mm"), ("x", "y", "bend_radius_mm"), (9, "z", "bend_axis")]
)
def test_an_impossible_bend_is_rejected_in_one_line(tmp_path: Path, radius: object, axis: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        load_sensor(bent_file(tmp_path, radius, axis))
    assert len(str(caught.value).splitlines()) == 1
