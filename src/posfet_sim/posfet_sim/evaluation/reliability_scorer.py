# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Whether a reconstruction knows how wrong it is: coverage of deviations, validity, contacts that do not end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from posfet_model.contacts.tracker import Contact
from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_sim.device.ground_truth import Truth

DEVIATIONS: Final = 2.0
"""Reported standard deviations within which an error counts as covered [1]."""

WRONG_SHARE: Final = 0.1
"""A total force is wrong when its error exceeds this share of the true one [1], and"""

WRONG_FORCE: Final = 0.05
"""this force [N]."""

SETTLED: Final = 5.0
"""Time without touch after which no contact may be left [s]."""


class ReliabilityScorer:
    """Compares reported uncertainty and validity with true errors, scan by scan.

    Parameters
    ----------
    threshold : float
        True force from which a taxel counts as touched [N].
    """

    def __init__(self, threshold: float) -> None:
        self._threshold = threshold
        self._scans = self._valid = self._misleading = 0
        self._taxels, self._contacts, self._totals = _Coverage(), _Coverage(), _Coverage()
        self._worst: float | None = None
        self._touched = -math.inf  # time of the last touch [s]
        self._time = 0.0
        self._live = 0

    def add(
        self, result: Reconstruction, image: ForceImage, truth: Truth, pairs: Sequence[tuple[Contact, int]], live: int
    ) -> None:
        """Add one scan.

        Parameters
        ----------
        result : Reconstruction
            Its `valid` is compared.
        image : ForceImage
            Reconstructed forces.
        truth : Truth
            Ground truth of the scan.
        pairs : sequence of tuple of (Contact, int)
            Contacts with the index of the true contact of each.
        live : int
            Number of contacts that are not released.
        """
        self._scans += 1
        self._time, self._live = truth.time, live
        loaded = bool(truth.force.any())
        if loaded:
            self._touched = truth.time
        if not result.valid:
            return
        self._valid += 1
        known = np.isfinite(image.force)
        true = float(truth.force.sum())
        error = abs(image.total - true)
        self._misleading += error > max(WRONG_SHARE * true, WRONG_FORCE)
        if not loaded:
            return
        if true >= WRONG_FORCE:
            self._worst = max(self._worst or 0.0, error / true)
        self._totals.add(error, image.total_standard_deviation)
        for taxel in (known & (truth.force >= self._threshold)).nonzero()[0]:
            self._taxels.add(abs(image.force[taxel] - truth.force[taxel]), float(image.standard_deviation[taxel]))
        # What an object presses beside the array, no taxel feels.
        objects = truth.objects
        on_taxels = float(truth.force.sum()) / float(objects.contact_forces.sum())
        for contact, index in pairs:
            expected = on_taxels * float(objects.contact_forces[index])
            self._contacts.add(abs(contact.region.force - expected), math.sqrt(contact.region.force_variance))

    @property
    def worst(self) -> float | None:
        """Greatest error of a valid total force over the true one, where that is at least `WRONG_FORCE` [%]."""
        return None if self._worst is None else 100.0 * self._worst

    @property
    def coverage(self) -> dict[str, float | None]:
        """Share of errors within `DEVIATIONS` reported deviations, while valid and touched [%].

        Returns
        -------
        dict of str to (float or None)
            `taxel`: of the taxels whose true force reaches the threshold; `contact`: of the contacts of an object,
            against its share of the force on the taxels; `total`: of the total force. None: there was none.
        """
        shares = {"taxel": self._taxels, "contact": self._contacts, "total": self._totals}
        return {name: share.percent for name, share in shares.items()}

    @property
    def valid(self) -> float | None:
        """Share of the scans whose forces are valid [%]."""
        return 100.0 * self._valid / self._scans if self._scans else None

    @property
    def misleading(self) -> float | None:
        """Share of the scans that are valid although the total force is wrong [%]."""
        return 100.0 * self._misleading / self._scans if self._scans else None

    @property
    def contacts_left(self) -> int | None:
        """Number of contacts in the last scan; None: something touched less than `SETTLED` before."""
        return self._live if self._time - self._touched >= SETTLED else None


class _Coverage:
    """Share of errors within `DEVIATIONS` of their deviation; an unknown deviation (NaN) does not count."""

    def __init__(self) -> None:
        self._within = self._count = 0

    def add(self, error: float, deviation: float) -> None:
        """Add an absolute error with its reported deviation."""
        if not math.isnan(deviation):
            self._within += error <= DEVIATIONS * deviation
            self._count += 1

    @property
    def percent(self) -> float | None:
        """The share [%]; None: there is no error."""
        return 100.0 * self._within / self._count if self._count else None
