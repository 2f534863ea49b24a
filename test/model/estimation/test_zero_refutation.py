# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Until when something wide presses whose zeros were refuted."""

from posfet_core.scan_path import ZeroRefutation

BLOCK, DEVIATION = 0.02, 0.05


def refuted(*totals: float) -> ZeroRefutation:
    """Return the policy after blocks of these total forces [N], since zeros were refuted."""
    policy = ZeroRefutation()
    policy.refute()
    for total in totals:
        policy.end_block(BLOCK, total, DEVIATION)
    return policy


def test_what_presses_is_wide_while_its_force_is_significant() -> None:
    assert not ZeroRefutation().wide
    assert refuted(*[0.11] * 1000).wide
    assert refuted(*[0.11] * 1000).significant
    assert not refuted(0.11, 0.09).significant


def test_what_presses_has_left_once_most_of_its_force_is_gone() -> None:
    assert refuted(1.0, 0.5, 0.31, 0.31).wide
    assert not refuted(1.0, 0.0).wide
    assert refuted(0.3, 0.09).wide, "as much as its error"
    assert refuted(0.0, 0.05, 0.0).wide, "it has hardly begun"


def test_what_does_not_become_significant_is_forgotten() -> None:
    assert refuted(*[0.09] * 499).wide
    assert not refuted(*[0.09] * 501).wide
    policy = refuted(*[0.09] * 499)
    policy.refute()
    policy.end_block(BLOCK, 0.09, DEVIATION)
    assert policy.wide


def test_what_presses_next_has_a_peak_of_its_own() -> None:
    policy = refuted(5.0, 0.0)
    policy.refute()
    policy.end_block(BLOCK, 0.05, DEVIATION)
    assert policy.wide
    policy.clear()
    assert not policy.wide
