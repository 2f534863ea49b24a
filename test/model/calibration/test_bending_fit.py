# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Bending of the chip from untouched taxels: sources as the estimator has them, and what a recording does not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import TouchResponse
from posfet_model.calibration.bending_fit import BendingFit, BendingSources, UntouchedTaxel, fit_bending
from posfet_model.calibration.fit_checks import MAX_BENDING, FitError, check_bending
from posfet_model.calibration.taxel_calibration import CHIP_WARMING_TIMES, NOMINAL_BENDING_DEVIATION
from posfet_model.estimation.error_states import BENDS, ErrorPriors, Shared
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.grid import compiled_layout

Array = NDArray[np.float64]
LAYOUT = replace(load_sensor().layout, rows=3, cols=4)
TAXELS = LAYOUT.taxels
BLOCK = 0.02
NOISE = 1e-4
SIZES = np.array([8e-3, 1e-3, -2e-3, 3e-3])
FILM_LAG, PER_KELVIN = 0.05, -1.05


def presses(places: Sequence[int]) -> Array:
    """Return forces of 1 N for 0.6 s on some taxels in turn, shape [blocks, taxels]."""
    force = np.zeros((40 * len(places), TAXELS))
    for number, taxel in enumerate(places):
        course = np.concatenate([np.linspace(0.0, 1.0, 8), np.ones(16), np.linspace(1.0, 0.0, 8), np.zeros(8)])
        force[40 * number : 40 * (number + 1), taxel] = course
    return force


def found(
    force: Array,
    sizes: Array,
    common: Array | float = 0.0,
    profile: Array | None = None,
    beside: Array | None = None,
) -> BendingFit:
    """Return the fit to what a chip with this bending and profile shows, and with what all taxels show besides [N].

    What presses beside the array [N] bends the chip like what presses on it.
    """
    rng = np.random.default_rng(1)
    time = BLOCK * np.arange(len(force))
    off = np.zeros(len(force)) if beside is None else beside
    sources, taxels = BendingSources(LAYOUT, time, force, off, FILM_LAG), []
    for taxel in range(TAXELS):
        part = 1.0 if profile is None else float(profile[taxel])
        charge = sources.of_bending(taxel, part) @ sizes + sizes[0] * off + common
        charge += NOISE * rng.standard_normal(len(force))
        untouched = force[:, taxel] == 0.0
        used = untouched & (force.sum(axis=1) > 0.0)
        taxels.append(UntouchedTaxel(charge, sources.of_all(taxel, PER_KELVIN, np.zeros(len(force))), used, NOISE))
    return fit_bending(taxels)


def test_the_sources_are_the_responses_of_the_estimator() -> None:
    force = np.random.default_rng(1).random((1, TAXELS))
    response = TouchResponse(compiled_layout(LAYOUT), np.ones(TAXELS), np.ones(TAXELS), ErrorPriors())
    response.advance(force[0], force[0], force[0], BLOCK)
    sources = BendingSources(LAYOUT, np.zeros(1), force, np.zeros(1), FILM_LAG)
    ours = np.stack([sources.of_bending(taxel)[0] for taxel in range(TAXELS)])
    expected = response.matrix()[:, Shared.BEND : Shared.BEND + BENDS]
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12)


def test_presses_on_each_taxel_show_all_of_the_bending() -> None:
    fit = found(presses(range(TAXELS)), SIZES)
    assert (np.abs(fit.sizes - SIZES) < 4.0 * fit.deviations).all()
    assert (fit.deviations < 1e-4).all()


@pytest.mark.parametrize("size", [2e-3, 8e-3, -8e-3])
def test_a_chip_that_is_held_at_its_edges_bends_most_in_the_middle(size: float) -> None:
    # With the same on all taxels, forces in the middle were wrong by 5.6 % at 8 mN/N, three times their deviation.
    rows, cols = np.divmod(np.arange(TAXELS), LAYOUT.cols)
    profile = 1.4 - 0.4 * ((cols - 1.5) / 1.5) ** 2 - 0.4 * (rows - 1.0) ** 2
    fit = found(presses(range(TAXELS)), np.array([size, 0.0, 0.0, 0.0]), profile=profile)
    of_taxels = fit.sizes[0] * fit.profile
    np.testing.assert_allclose(of_taxels, size * profile, rtol=0, atol=max(0.04 * abs(size), 2e-4))
    assert fit.profile[5] > fit.profile[0] + 0.3


def test_what_does_not_bend_has_no_profile() -> None:
    np.testing.assert_allclose(found(presses(range(TAXELS)), np.zeros(4)).profile, 1.0, rtol=0, atol=0.05)


def test_what_presses_beside_the_array_counts_as_no_bending_by_the_taxels() -> None:
    # A ball over the edge presses less on the taxels than its load cell shows: bending came out a tenth too large.
    force = presses(range(TAXELS))
    beside = 0.4 * force[:, [0, 3, 8, 11]].sum(axis=1)
    fit = found(force, SIZES, beside=beside)
    assert (np.abs(fit.sizes - SIZES) < 4.0 * fit.deviations).all()
    assert (fit.deviations < 1e-4).all()


def test_a_chip_that_does_not_bend_has_a_deviation_that_covers_zero() -> None:
    fit = found(presses(range(TAXELS)), np.zeros(4))
    assert (np.abs(fit.sizes) < 4.0 * fit.deviations).all()


def test_an_object_that_warms_the_chip_does_not_bend_it() -> None:
    force = presses(range(TAXELS))
    sources = BendingSources(LAYOUT, BLOCK * np.arange(len(force)), force, np.zeros(len(force)), FILM_LAG)
    warming = np.array([0.01, 0.02, 0.05])
    warmth = sources.of_all(0, PER_KELVIN, np.zeros(len(force)))[:, BENDS : BENDS + len(CHIP_WARMING_TIMES)] @ warming
    fit = found(force, SIZES, warmth)
    np.testing.assert_allclose(fit.sizes, SIZES, rtol=0, atol=2e-4)
    # What all of it amounts to within the presses is known better than which time constant it has.
    after = -np.expm1(-2.0 / np.array(CHIP_WARMING_TIMES))
    assert fit.warming @ after == pytest.approx(warming @ after, rel=0.05)


def test_a_temperature_that_changes_on_all_taxels_makes_it_less_certain() -> None:
    force = presses(range(TAXELS))
    walk = 1e-3 * np.cumsum(np.random.default_rng(2).standard_normal(len(force)))
    fit, calm = found(force, SIZES, walk), found(force, SIZES)
    assert (np.abs(fit.sizes - SIZES) < 4.0 * fit.deviations).all()
    assert fit.deviations[0] > 3.0 * calm.deviations[0]


def test_presses_at_a_single_place_do_not_tell_a_gradient_from_the_moment() -> None:
    fit = found(presses([0, 0, 0]), SIZES)
    corner = np.array([-1.0, -1.0])
    assert abs(fit.sizes[0] - SIZES[0]) < 3e-4
    np.testing.assert_allclose(fit.sizes[1:3] + fit.sizes[3] * corner, SIZES[1:3] + SIZES[3] * corner, atol=3e-4)
    assert (fit.deviations[1:] > 0.3 * np.array(NOMINAL_BENDING_DEVIATION[1:])).all()


def test_without_a_press_it_is_as_unknown_as_without_a_calibration() -> None:
    fit = found(np.zeros((100, TAXELS)), SIZES)
    np.testing.assert_array_equal(fit.sizes, 0.0)
    np.testing.assert_allclose(fit.deviations, NOMINAL_BENDING_DEVIATION, rtol=1e-9)


@pytest.mark.parametrize("part", range(4))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_bending_that_no_chip_has_is_refused_with_its_name(part: int, sign: float) -> None:
    sizes = np.zeros(4)
    sizes[part] = sign * 0.9 * MAX_BENDING
    check_bending(BendingFit(sizes, np.zeros(4), np.zeros(3), np.ones(TAXELS)))
    with pytest.raises(FitError, match=r"^bending: must be within .* got "):
        check_bending(BendingFit(2.0 * sizes, np.zeros(4), np.zeros(3), np.ones(TAXELS)))


def test_a_part_in_it_that_no_taxel_has_is_refused() -> None:
    profile = np.ones(TAXELS)
    profile[3] = 5.0
    with pytest.raises(FitError, match=r"^bending: must be within .* got 50:"):
        check_bending(BendingFit(np.array([0.01, 0.0, 0.0, 0.0]), np.zeros(4), np.zeros(3), profile))
