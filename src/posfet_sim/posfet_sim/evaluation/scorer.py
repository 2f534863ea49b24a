# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Errors of a reconstruction against the ground truth of a simulated board, scan by scan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.contacts.tracker import Contact, ContactState
from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.sensor.description import Sensor
from posfet_sim.device.ground_truth import Truth
from posfet_sim.evaluation.reliability_scorer import ReliabilityScorer
from posfet_sim.evaluation.slip_scorer import SlipScorer

MATCH: Final = 1.5
"""Maximum distance of the centres of pressure of a contact and its object [pitch]."""

MIN_FORCE: Final = 0.1
"""Minimum force of an object [N] to be compared. An object whose pressure is so wide that no taxel reaches the contact
threshold is not compared either."""

LONG_HOLD: Final = 5.0
"""Minimum duration of a constant force to count as held [s]."""

HOLD_MEAN: Final = 0.1
"""Averaging time of the error of a held force [s], so that noise does not count as drift."""

HOLD_BEGINS: Final = 0.2
"""Time from the start of a constant force to the start of its drift [s]."""


@dataclass(frozen=True)
class Score:
    """Errors of one run; None: not defined for the scene."""

    force_rmse_pct: float | None
    """RMS error of the force of a taxel during contact (without contact: always) [% of full scale]."""
    total_force_error_pct: float | None
    """Mean absolute error of the total force over the mean true total force, during contact [%]."""
    cop_error_mm: dict[str, float | None]
    """Distance of the centres of pressure from the true ones: `mean` and 95th percentile `p95` [mm]."""
    contact_precision: float | None
    """Fraction of the reported contacts that are true [1]."""
    contact_recall: float | None
    """Fraction of the true contacts that are reported [1]."""
    id_switches: int
    """Number of changes of the track id of a contact."""
    detection_latency_scans: int | None
    """Maximum number of scans from the first one in which a taxel reaches the contact threshold to the detection."""
    held_force_drift_pct: float | None
    """Maximum change of the error of the total force while it is held for 5 s or longer [% of the force]."""
    false_contacts_per_hour: float
    """Rate of contacts that never match a true one [1/h]."""
    slip_onset_delay_ms: dict[str, float | None]
    """Delay from the onset of a true slip to its detection, `mean` and `max` [ms]."""
    slip_recall: float | None
    """Fraction of the true slips that are detected within `SLIP_LATE` [1]."""
    false_slips_per_hour: float
    """Rate of slips detected without a true one [1/h]."""
    total_force_worst_pct: float | None
    """Greatest error of a valid total force of at least 50 mN over the true one [%]."""
    coverage_pct: dict[str, float | None]
    """Share of errors within two reported standard deviations, of each touched `taxel`, each `contact`, and the `total`
    force [%]."""
    valid_pct: float | None
    """Share of the scans that are valid [%]."""
    misleading_pct: float | None
    """Share of the scans that are valid although the total force is wrong by more than 10 % and 50 mN [%]."""
    contacts_left: int | None
    """Number of contacts at the end, at least 5 s after the last touch."""
    us_per_scan: float
    """Computation time of the reconstruction including the force image [us]."""


class Scorer:
    """Accumulates errors scan by scan; `score` returns the result."""

    def __init__(self, sensor: Sensor) -> None:
        """Create a scorer for reconstructions of this sensor."""
        layout = sensor.layout
        self._sensor = sensor
        self._reach = MATCH * max(layout.pitch_x, layout.pitch_y)
        self._half = (0.5 * layout.cols * layout.pitch_x, 0.5 * layout.rows * layout.pitch_y)
        self._positions = layout.positions
        self._square = [0.0, 0.0]  # sum of squared errors: of all scans, of those with contact
        self._taxels = [0, 0]
        self._total_error: list[float] = []
        self._total_true: list[float] = []
        self._distances: list[float] = []
        self._reported = self._right = self._true = self._found = 0
        self._ids: dict[int, int] = {}  # last track id of each object
        self._switches = 0
        self._waiting: dict[int, int] = {}  # scans since each object reached the threshold without detection
        self._latencies: list[int] = []
        self._matched: set[int] = set()
        self._seen: set[int] = set()
        self._held = _Hold()
        self._slips = SlipScorer()
        self._reliability = ReliabilityScorer(sensor.contact.threshold)
        self._seconds = 0.0

    def add(self, result: Reconstruction, image: ForceImage, truth: Truth) -> None:
        """Add one scan; scans that are not valid only count for contacts.

        Parameters
        ----------
        result : Reconstruction
            Contacts and their motion.
        image : ForceImage
            Reconstructed forces.
        truth : Truth
            Ground truth of the scan.
        """
        self._seconds = truth.time
        touched = bool(truth.force.any())
        if result.valid:
            self._add_forces(image, truth, touched)
        live = [contact for contact in result.contacts if contact.state is not ContactState.RELEASED]
        pairs = self._pairs(live, [tuple(centre) for centre in truth.objects.contact_centres.tolist()])
        partners = self._add_contacts(live, truth, pairs)
        self._reliability.add(result, image, truth, pairs, len(live))
        slipping = {contact.id for contact in live if result.motions[contact.id].slipping}
        self._slips.add(truth, partners, slipping)

    def _add_forces(self, image: ForceImage, truth: Truth, touched: bool) -> None:
        known = np.isfinite(image.force)
        error = (image.force - truth.force)[known]
        square, count = float(error @ error), int(np.count_nonzero(known))
        for kind in (0, 1) if touched else (0,):
            self._square[kind] += square
            self._taxels[kind] += count
        true = float(truth.force.sum())
        total_error = image.total - true
        if touched and true > 0:
            self._total_error.append(total_error)
            self._total_true.append(true)
        self._held.add(truth.time, truth.force, total_error, true)

    def _add_contacts(
        self, live: Sequence[Contact], truth: Truth, pairs: Sequence[tuple[Contact, int]]
    ) -> dict[int, int]:
        """Compare contacts with true ones; return the track id of the contact of each detected object."""
        objects = truth.objects
        numbers = [int(number) for number in objects.contact_objects]
        centres = [tuple(centre) for centre in objects.contact_centres.tolist()]
        on_chip = [self._on_chip(centre) for centre in centres]
        partners = {index: contact for contact, index in pairs}
        self._reported += len(live)
        self._seen |= {contact.id for contact in live}
        for contact in live:
            near = any(math.dist(contact.region.centre_of_pressure, centre) <= self._reach for centre in centres)
            self._right += near
            if near:
                self._matched.add(contact.id)
        for index, number in enumerate(numbers):
            partner = partners.get(index)
            near = np.hypot(*(self._positions - centres[index]).T) <= self._reach
            peak, limits = float(truth.force[near].max(initial=0.0)), self._sensor.contact
            detectable = peak >= limits.threshold
            if partner is None and peak < limits.threshold - limits.deadband:
                self._end_contact(number)  # still in contact, but below the release threshold
            self._follow_id(number, partner)
            self._measure_latency(number, partner, detectable)
            if objects.contact_forces[index] >= MIN_FORCE and on_chip[index] and (detectable or partner):
                self._true += 1
                if partner:
                    self._found += 1
                    self._distances.append(math.dist(partner.region.centre_of_pressure, centres[index]))
        for gone in (self._ids.keys() | self._waiting.keys()) - set(numbers):
            self._end_contact(gone)
        return {numbers[index]: contact.id for index, contact in partners.items()}

    def _end_contact(self, number: int) -> None:
        """End the contact of an object: when it presses again, that is another contact."""
        self._ids.pop(number, None)
        waited = self._waiting.pop(number, 0)
        if waited > 0:
            self._latencies.append(waited)  # never detected

    def _on_chip(self, centre: Sequence[float]) -> bool:
        return abs(centre[0]) <= self._half[0] and abs(centre[1]) <= self._half[1]

    def _pairs(self, live: Sequence[Contact], centres: Sequence[Sequence[float]]) -> list[tuple[Contact, int]]:
        """Return contacts with the true contact of each, nearest first."""
        distances = sorted(
            (distance, contact.id, contact_index, index)
            for contact_index, contact in enumerate(live)
            for index, centre in enumerate(centres)
            if (distance := math.dist(contact.region.centre_of_pressure, centre)) <= self._reach
        )
        pairs: list[tuple[Contact, int]] = []
        used: tuple[set[int], set[int]] = (set(), set())
        for _, _, contact_index, index in distances:
            if contact_index not in used[0] and index not in used[1]:
                used[0].add(contact_index)
                used[1].add(index)
                pairs.append((live[contact_index], index))
        return pairs

    def _follow_id(self, number: int, partner: Contact | None) -> None:
        if partner is None:
            return
        last = self._ids.get(number, partner.id)
        if last in partner.merged_ids:
            return  # merged into that track; the id returns when they separate
        self._switches += last != partner.id
        self._ids[number] = partner.id

    def _measure_latency(self, number: int, partner: Contact | None, detectable: bool) -> None:
        """Count the scans from the first one in which an object is detectable to its detection."""
        waited = self._waiting.get(number, 0)
        if waited < 0:
            return
        if partner is not None:
            self._latencies.append(waited)
            self._waiting[number] = -1  # detected, until the contact ends
            return
        if waited or detectable:
            self._waiting[number] = waited + 1

    def score(self, us_per_scan: float) -> Score:
        """Return the errors so far.

        Parameters
        ----------
        us_per_scan : float
            Computation time of the reconstruction [us].
        """
        touched = 1 if self._taxels[1] else 0
        full_scale = self._sensor.device.force_max
        rmse = math.sqrt(self._square[touched] / self._taxels[touched]) if self._taxels[touched] else None
        late = [waited for waited in self._waiting.values() if waited > 0]
        distances = np.array(self._distances) * 1e3
        return Score(
            force_rmse_pct=None if rmse is None else 100 * rmse / full_scale,
            total_force_error_pct=100 * float(np.mean(np.abs(self._total_error)) / np.mean(self._total_true))
            if self._total_true
            else None,
            cop_error_mm={
                "mean": float(distances.mean()) if len(distances) else None,
                "p95": float(np.quantile(distances, 0.95)) if len(distances) else None,
            },
            contact_precision=self._right / self._reported if self._reported else None,
            contact_recall=self._found / self._true if self._true else None,
            id_switches=self._switches,
            detection_latency_scans=max(self._latencies + late, default=None),
            held_force_drift_pct=self._held.maximum(),
            false_contacts_per_hour=len(self._seen - self._matched) * 3600 / self._seconds if self._seconds else 0.0,
            slip_onset_delay_ms=self._slips.delay(),
            slip_recall=self._slips.recall(),
            false_slips_per_hour=self._slips.false * 3600 / self._seconds if self._seconds else 0.0,
            total_force_worst_pct=self._reliability.worst,
            coverage_pct=self._reliability.coverage,
            valid_pct=self._reliability.valid,
            misleading_pct=self._reliability.misleading,
            contacts_left=self._reliability.contacts_left,
            us_per_scan=us_per_scan,
        )


class _Hold:
    """Drift of the error, in means over `HOLD_MEAN`, while the true forces are constant."""

    def __init__(self) -> None:
        self._force: NDArray[np.float64] | None = None
        self._total = 0.0
        self._since = math.nan
        self._times: list[float] = []
        self._errors: list[float] = []
        self._drifts: list[float] = []

    def add(self, time: float, force: NDArray[np.float64], error: float, total: float) -> None:
        """Add a scan: time [s], true forces [N], error of their sum [N], and true sum [N]."""
        constant = self._force is not None and total > MIN_FORCE and bool(np.array_equal(force, self._force))
        self._force = force
        if not constant:
            self._end()
            self._since, self._total = time, total
        elif time - self._since >= HOLD_BEGINS:
            self._times.append(time - self._since)
            self._errors.append(error)

    def _end(self) -> None:
        if self._times and self._times[-1] >= LONG_HOLD:
            spans = (np.array(self._times) / HOLD_MEAN).astype(np.intp)
            sums, counts = np.bincount(spans, self._errors), np.bincount(spans)
            means = sums[counts > 0] / counts[counts > 0]
            self._drifts.append(100 * float(np.abs(means - means[0]).max()) / self._total)
        self._times, self._errors = [], []

    def maximum(self) -> float | None:
        """Return the maximum drift [%] of all held forces; None when there was none."""
        self._end()
        return max(self._drifts, default=None)
