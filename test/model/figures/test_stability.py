# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The map of integration schemes agrees with docs/stability.md, and the model uses only the exact scheme."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="the figures need matplotlib")

import posfet_model
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.figures.schemes import DIVERGED, SCHEMES, first_step_beyond, largest_error, remaining_error

BY_NAME = {scheme.name: scheme for scheme in SCHEMES}
RATIOS = np.logspace(-18, 12, 301)


@pytest.mark.parametrize(("name", "limit"), [("Euler", 2.0), ("Heun", 2.0), ("Runge-Kutta 4", 2.785293563)])
def test_explicit_schemes_diverge_beyond_their_stability_limit(name: str, limit: float) -> None:
    below, above = remaining_error(BY_NAME[name], np.array([0.95 * limit, 1.1 * limit]), steps=1000)
    assert below < 1e-9
    assert above > DIVERGED


def test_clipped_euler_stays_finite_but_is_wrong() -> None:
    scheme = BY_NAME["Euler, slew clipped"]
    assert remaining_error(scheme, np.array([1.9]))[0] < 1e-9
    wrong = remaining_error(scheme, np.logspace(math.log10(2.1), 6, 100))
    assert np.isfinite(wrong).all()
    assert (wrong > 0.1).all()


def test_the_trapezoidal_rule_rings() -> None:
    scheme = BY_NAME["trapezoidal"]
    assert largest_error(scheme, RATIOS).max() <= 1 + 1e-12
    lag = np.ones(1)
    signs = []
    for _ in range(6):
        lag = scheme.advance(lag, np.array([1e3]))
        signs.append(float(np.sign(lag[0])))
    assert signs == [-1, 1, -1, 1, -1, 1]
    assert remaining_error(scheme, np.array([1e4]))[0] > 0.9


def test_backward_euler_is_stable_but_inexact() -> None:
    error = largest_error(BY_NAME["backward Euler"], RATIOS)
    assert 0.2 < error.max() < 0.21
    assert remaining_error(BY_NAME["backward Euler"], RATIOS[RATIOS > 1]).max() < 1e-12


def test_the_exact_step_is_exact_and_is_the_one_in_the_model() -> None:
    scheme = BY_NAME["exact exponential"]
    assert largest_error(scheme, RATIOS).max() < 1e-13
    assert math.isnan(first_step_beyond(scheme, 1e-9))
    follower = OnePoleFollower(gain=1.0, bandwidth=1 / (2 * math.pi))
    ratio = RATIOS[RATIOS < 1e8]
    jumped = follower.advance(follower.start(np.zeros(ratio.size)), np.ones(ratio.size), 0.0)
    held = follower.advance(jumped, np.ones(ratio.size), ratio)
    np.testing.assert_allclose(held.lags[0], scheme.advance(np.ones(ratio.size), ratio), rtol=0, atol=2e-16)


def test_no_module_outside_the_figures_uses_the_other_schemes() -> None:
    package = Path(posfet_model.__file__).parent
    for module in package.rglob("*.py"):
        if module.parent.name == "figures":
            continue
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                assert not node.module.startswith("posfet_model.figures.schemes"), module
