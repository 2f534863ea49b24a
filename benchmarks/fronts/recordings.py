# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recorded scans with ground truth, and the figures by which every method is judged alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.ground_truth import Truth
from posfet_sim.emulation.offline import received_scans
from posfet_sim.evaluation.scorer import MATCH, MIN_FORCE
from posfet_sim.scene import Keyframes, Scene, SceneObject

DEVIATIONS = 2.0
"""Reported standard deviations within which an error counts as covered [1]."""

Contact = tuple[float, float]


@dataclass(frozen=True)
class Recording:
    """Scans of one scene on one board, with the truth of each."""

    scans: list[Scan]
    truths: list[Truth]


def record(sensor: Sensor, scene: Scene, seconds: float, seed: int, board: ErrorModel) -> Recording:
    """Return the scans that a driver would receive."""
    scans, truths = [], []
    for scan, truth in received_scans(sensor, scene, seconds, seed, board):
        scans.append(scan.snapshot())
        truths.append(truth)
        truth.objects  # noqa: B018  # computed now, while its loads are at this time
    return Recording(scans, truths)


def random_scene(seed: int, presses: int) -> Scene:
    """Return presses and slides of a ball at random places, forces and durations: a scene that nothing was tuned to."""
    random = np.random.default_rng(seed)
    time, times, values = 1.0, [0.0], [(0.0, 0.0, 0.0, 0.0)]
    for _ in range(presses):
        places = random.uniform(-2.2e-3, 2.2e-3, (2, 2))
        force, rise, held, rest = random.uniform((0.2, 0.05, 0.1, 0.3), (3.0, 0.4, 2.0, 1.0))
        for after, place, load in (
            (0.0, places[0], 0.0),
            (rise, places[0], force),
            (rise + held, places[1], force),
            (2 * rise + held, places[1], 0.0),
        ):
            times.append(time + after)
            values.append((*place.tolist(), 0.0, load))
        time += 2 * rise + held + rest
    path = Keyframes(tuple(times), tuple(values))
    ball = SceneObject("ball", Sphere(float(random.uniform(3e-3, 8e-3)), 2e6), path)
    return Scene(
        name=f"random {seed}", description="random presses and slides", period=math.inf, objects=(ball,),
        temperature=Keyframes((0.0,), ((25.0,),)),
    )  # fmt: skip


@dataclass
class Tally:
    """Errors of one method, over any number of recordings."""

    sensor: Sensor
    force_error: float = 0.0
    force_true: float = 0.0
    distances: list[float] = field(default_factory=list)
    excluded: float = 0.0
    covered: int = 0
    with_deviation: int = 0
    valid: int = 0
    touched: int = 0
    true: int = 0
    missed: int = 0
    reported: int = 0
    false: int = 0

    def add(
        self,
        truth: Truth,
        total: float,
        contacts: Sequence[Contact],
        deviation: float = math.nan,
        valid: bool = True,
        excluded: float = 0.0,
    ) -> None:
        """Add one scan: total force [N], contacts' centres [m], reported standard deviation of the total [N].

        A method without an answer (NaN) answers 0. `excluded` is the true force on taxels that it declares faulty
        [N], which is part of the true total: whoever holds the object has to bear it.
        """
        layout = self.sensor.layout
        true = float(truth.force.sum())
        if true > 0:
            self.touched += 1
            self.valid += valid
            self.excluded += excluded
            error = abs((total if math.isfinite(total) else 0.0) - true)
            self.force_error += error
            self.force_true += true
            if valid and math.isfinite(deviation):
                self.with_deviation += 1
                self.covered += error <= DEVIATIONS * deviation
        reach = MATCH * max(layout.pitch_x, layout.pitch_y)
        objects = truth.objects
        centres = [tuple(centre) for centre in objects.contact_centres.tolist()]
        self.reported += len(contacts)
        self.false += sum(not any(math.dist(each, centre) <= reach for centre in centres) for each in contacts)
        free = list(contacts)
        for centre, force in zip(centres, objects.contact_forces, strict=True):
            near = np.hypot(*(layout.positions - centre).T) <= reach
            on_chip = abs(centre[0]) <= 0.5 * layout.cols * layout.pitch_x
            on_chip = on_chip and abs(centre[1]) <= 0.5 * layout.rows * layout.pitch_y
            if force < MIN_FORCE or not on_chip or truth.force[near].max(initial=0.0) < self.sensor.contact.threshold:
                continue
            self.true += 1
            nearest = min(free, key=lambda each: math.dist(each, centre), default=None)
            if nearest is None or math.dist(nearest, centre) > reach:
                self.missed += 1
                continue
            free.remove(nearest)
            self.distances.append(math.dist(nearest, centre))

    @property
    def force_percent(self) -> float:
        """Mean absolute error of the total force over the mean true one, while touched [%]."""
        return 100 * self.force_error / self.force_true

    @property
    def figures(self) -> tuple[float, ...]:
        """Further figures, by `HEADINGS`."""
        return (
            1e3 * float(np.mean(self.distances)) if self.distances else math.nan,
            100 * self.missed / self.true if self.true else math.nan,
            100 * self.false / self.reported if self.reported else math.nan,
            100 * self.covered / self.with_deviation if self.with_deviation else math.nan,
            100 * self.valid / self.touched,
            100 * self.excluded / self.force_true,
        )


HEADINGS = (
    "CoP error mm",
    "missed contacts %",
    "false contacts %",
    "two-sigma coverage %",
    "declared valid %",
    "force on taxels declared faulty %",
)
