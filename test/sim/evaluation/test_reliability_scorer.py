# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Coverage, validity and contacts that are left, against examples computed by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from unittest.mock import Mock

import numpy as np
import pytest

from posfet_model.contacts.detection import Region
from posfet_model.contacts.tracker import Contact, ContactState
from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_sim.device.ground_truth import Truth
from posfet_sim.evaluation.reliability_scorer import ReliabilityScorer
from posfet_sim.loads import Loads, ObjectsState

THRESHOLD = 0.02
NO_FORCE = (0.0, 0.0, 0.0)


def reconstruction(valid: bool = True) -> Reconstruction:
    return Reconstruction(True, False, 0, 0, valid, (), {}, 0)


def image(force: Sequence[float], deviation: float = 0.01, total_deviation: float = 0.02) -> ForceImage:
    known = np.array(force, np.float32)
    spread = np.full(3, deviation, np.float32)
    load = np.nan_to_num(known.astype(float))
    return ForceImage(known, spread, np.zeros(3, np.uint8), load, np.zeros(3), float(load.sum()), total_deviation)


def truth(time: float, force: Sequence[float], objects: Sequence[float] = ()) -> Truth:
    """Return a ground truth of three taxels with objects of these forces [N]."""
    count = len(objects)
    state = ObjectsState(
        tuple(f"object {index}" for index in range(count)),
        np.zeros((count, 3)),
        np.zeros((count, 4)),
        np.arange(count),
        np.zeros((count, 2)),
        np.zeros((count, 3)),
        np.array(objects, float),
    )
    loads = Mock(spec=Loads, objects=Mock(return_value=state))
    return Truth(0, time, np.array(force, float), 25.0, 25.0, np.zeros(3, np.uint8), loads)


def contact(force: float, deviation: float) -> Contact:
    taxels, origin = np.zeros(1, np.intp), (0.0, 0.0)
    region = Region(taxels, taxels, origin, origin, force, deviation**2, 1e-6, 1.0, origin, origin)
    return Contact(1, ContactState.HELD, region, (0.0, 0.0), 1.0)


def test_coverage_counts_touched_taxels_contacts_and_totals_within_two_deviations() -> None:
    scorer = ReliabilityScorer(THRESHOLD)
    # Errors of 19 and 21 mN at a deviation of 10 mN; the third taxel is below the threshold and does not count. The
    # total is off by 40 mN + 90 mN at 2*20 mN. The object presses 1.25 N, of which the taxels feel 1.01 N.
    pressed = truth(1.0, (0.6, 0.4, 0.01), (1.25,))
    scorer.add(reconstruction(), image((0.619, 0.421, 0.1)), pressed, [(contact(1.05, 0.03), 0)], 1)
    # All within; a contact of 1.05 N with a deviation of 10 mN is not.
    scorer.add(reconstruction(), image((0.61, 0.4, 0.01)), pressed, [(contact(1.05, 0.01), 0)], 1)
    assert scorer.coverage == {"taxel": 75.0, "contact": 50.0, "total": 50.0}
    assert scorer.worst == pytest.approx(100 * 0.13 / 1.01, rel=1e-5)


def test_the_true_force_is_divided_among_the_objects() -> None:
    scorer = ReliabilityScorer(THRESHOLD)
    # 0.9 N of 1.2 N reach the taxels: 0.3 N of the first object, and 0.6 N of the second.
    pairs = [(contact(0.31, 0.01), 0), (contact(0.65, 0.01), 1)]
    scorer.add(reconstruction(), image((0.3, 0.6, 0.0)), truth(1.0, (0.3, 0.6, 0.0), (0.4, 0.8)), pairs, 2)
    assert scorer.coverage["contact"] == 50.0


def test_an_unknown_force_or_deviation_does_not_count_and_the_total_misses_what_is_not_estimated() -> None:
    scorer = ReliabilityScorer(THRESHOLD)
    pressed = truth(1.0, (0.5, 0.5, 0.0), (1.0,))
    scorer.add(reconstruction(), image((math.nan, 0.5, 0.0)), pressed, [], 0)
    assert scorer.coverage == {"taxel": 100.0, "contact": None, "total": 0.0}
    assert scorer.misleading == 100.0
    saturated = ReliabilityScorer(THRESHOLD)
    saturated.add(reconstruction(), image((0.1, 0.1, 0.0), math.nan, math.nan), pressed, [], 0)
    assert saturated.coverage == {"taxel": None, "contact": None, "total": None}


@pytest.mark.parametrize(
    ("true", "read", "wrong"),
    [(0.2, 0.249, False), (0.2, 0.251, True), (2.0, 2.19, False), (2.0, 1.79, True), (0.0, 0.06, True)],
)
def test_a_valid_total_is_wrong_beyond_a_tenth_and_50_mN(true: float, read: float, wrong: bool) -> None:
    scorer = ReliabilityScorer(THRESHOLD)
    objects = (true,) if true else ()
    for valid in (True, False, False, False):
        scorer.add(reconstruction(valid), image((read, 0.0, 0.0)), truth(1.0, (true, 0.0, 0.0), objects), [], 1)
    assert scorer.valid == 25.0
    assert scorer.misleading == (25.0 if wrong else 0.0)


def test_contacts_are_left_5_s_after_the_last_touch() -> None:
    scorer = ReliabilityScorer(THRESHOLD)
    assert (scorer.valid, scorer.misleading, scorer.worst) == (None, None, None)
    scorer.add(reconstruction(False), image(NO_FORCE), truth(2.0, (0.1, 0.0, 0.0), (0.1,)), [], 1)
    scorer.add(reconstruction(), image(NO_FORCE), truth(6.9, NO_FORCE), [], 3)
    assert scorer.contacts_left is None
    scorer.add(reconstruction(), image(NO_FORCE), truth(7.0, NO_FORCE), [], 2)
    assert scorer.contacts_left == 2
    scorer.add(reconstruction(), image(NO_FORCE), truth(7.1, NO_FORCE), [], 0)
    assert scorer.contacts_left == 0
