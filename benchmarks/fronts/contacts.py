# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contact finding: thresholds and centroid, the largest taxel, moments with edge completion; one contact and two."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.fronts.interleaved import interleaved
from benchmarks.outcome import shown
from posfet_model._lib.types import Array
from posfet_model.contacts.detection import ContactFinder, ForceEstimate
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.signal_chain import force_noise_rms
from posfet_sim.contact.indenters import Sphere
from posfet_sim.contact.taxel_forces import Cells

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
REACH = 1.5 * LAYOUT.pitch_x
BALL = Sphere(4e-3, 2e6)
THRESHOLDS = (0.005, 0.02, 0.05, 0.1)
"""Thresholds of a taxel [N]; the second is that of the sensor file."""

Centre = tuple[float, float]
Method = Callable[[Array], Sequence[Centre]]


@dataclass(frozen=True)
class Image:
    """Forces on the taxels with noise, and the centres of what presses."""

    force: Array
    centres: tuple[Centre, ...]


def measure(effort: Effort) -> list[Front]:
    """Return a front for contacts in the middle, at the edge, and in pairs."""
    count = 40 if effort.short else 300
    half = 0.5 * LAYOUT.cols * LAYOUT.pitch_x
    kinds = {
        "middle": ("one contact in the middle", _singles(count, 0.0, 0.55 * half)),
        "edge": ("one contact near an edge", _singles(count, 0.7 * half, 0.95 * half)),
        "pairs": ("two contacts 3 to 4.5 mm apart", _pairs(count)),
    }
    return [_front(name, what, images, effort) for name, (what, images) in kinds.items()]


def _pressed(centres: Sequence[Centre], forces: Sequence[float], random: np.random.Generator) -> Image:
    cells, total = Cells(LAYOUT, SENSOR.device.contact_spread), np.zeros((LAYOUT.rows, LAYOUT.cols))
    for (x, y), force in zip(centres, forces, strict=True):
        one = np.ones(1)
        patch = cells.press([BALL.footprints(force, cells.spread, (0.0, 0.0))], x * one, y * one, 0 * one, force * one)
        assert patch is not None
        total[patch.rows, patch.cols] += patch.force[0]
    noise = force_noise_rms(SENSOR) * random.standard_normal(LAYOUT.taxels)
    return Image(total.ravel() + noise, tuple(centres))


def _singles(count: int, low: float, high: float) -> list[Image]:
    random, found = np.random.default_rng(5), []
    for _ in range(count):
        along, across = random.uniform(low, high), random.uniform(-0.5 * high, 0.5 * high)
        turn = int(random.integers(4))
        centre = ((along, across), (-across, along), (-along, -across), (across, -along))[turn]
        found.append(_pressed([centre], [float(random.uniform(0.3, 2.0))], random))
    return found


def _pairs(count: int) -> list[Image]:
    random, found = np.random.default_rng(6), []
    for _ in range(count):
        angle, distance = random.uniform(0, math.pi), random.uniform(3.0e-3, 4.5e-3)
        x, y = 0.5 * distance * math.cos(angle), 0.5 * distance * math.sin(angle)
        forces = [float(each) for each in random.uniform(0.6, 1.2, 2)]
        found.append(_pressed([(x, y), (-x, -y)], forces, random))
    return found


class Finder:
    """The finder of this stack, made for each image."""

    def __init__(self) -> None:
        self._variance = np.full(LAYOUT.taxels, force_noise_rms(SENSOR) ** 2)
        self._finder = ContactFinder(SENSOR)
        self._none = np.zeros(LAYOUT.taxels)

    def __call__(self, force: Array) -> list[Centre]:
        """Return the centres of pressure."""
        self._finder.find(self._none)
        self._finder.find(force)
        return [region.centre_of_pressure for region in self._finder.measure(ForceEstimate(force, self._variance))]


def _centroid(force: Array, threshold: float, ring: bool = False) -> list[Centre]:
    """Return the force-weighted centres of connected regions; with `ring` their neighbours count, too."""
    rest, found = set(np.flatnonzero(force >= threshold).tolist()), []
    cols = LAYOUT.cols
    while rest:
        group, edge = [], [rest.pop()]
        while edge:
            taxel = edge.pop()
            group.append(taxel)
            near = [
                each for each in rest if max(abs(each // cols - taxel // cols), abs(each % cols - taxel % cols)) <= 1
            ]
            rest.difference_update(near)
            edge += near
        if ring:
            rows, columns = np.divmod(np.array(group), cols)
            every = np.arange(LAYOUT.taxels)
            far = np.maximum(abs(every[:, None] // cols - rows), abs(every[:, None] % cols - columns)).min(axis=1)
            group = every[far <= 1].tolist()
        weight = np.maximum(force[group], 0.0)
        x, y = weight @ LAYOUT.positions[group] / weight.sum()
        found.append((float(x), float(y)))
    return found


def _largest(force: Array) -> list[Centre]:
    x, y = LAYOUT.positions[int(force.argmax())]
    return [(float(x), float(y))]


def methods() -> dict[tuple[str, str], Method]:
    """Return the methods by series and parameter."""
    found: dict[tuple[str, str], Method] = {
        ("centroid above a threshold", f"{level * 1e3:g} mN"): (lambda force, level=level: _centroid(force, level))
        for level in THRESHOLDS
    }
    found["centroid with a ring of neighbours", ""] = lambda force: _centroid(
        force, SENSOR.contact.threshold, ring=True
    )
    found["largest taxel", ""] = _largest
    found["moments, edge completion, separation", ""] = Finder()
    return found


def _judge(method: Method, images: Sequence[Image]) -> tuple[float, float, float]:
    """Return the mean error of a centre [mm], a missed one counting as the reach, and what is missed and false [%]."""
    distances, missed, false, true, reported = [], 0, 0, 0, 0
    for image in images:
        free = list(method(image.force))
        reported += len(free)
        for centre in image.centres:
            true += 1
            nearest = min(free, key=lambda each: math.dist(each, centre), default=None)
            if nearest is None or math.dist(nearest, centre) > REACH:
                missed += 1
                distances.append(REACH)
                continue
            free.remove(nearest)
            distances.append(math.dist(nearest, centre))
        false += len(free)
    return 1e3 * float(np.mean(distances)), 100 * missed / true, 100 * false / max(reported, 1)


def _front(name: str, what: str, images: Sequence[Image], effort: Effort) -> Front:
    makers = methods()
    judged = {key: _judge(method, images) for key, method in makers.items()}
    some = images[:20]

    def call(method: Method) -> Callable[[], None]:
        def run() -> None:
            for image in some:
                method(image.force)

        return run

    seconds = interleaved({"|".join(key): call(method) for key, method in makers.items()}, effort.repeats)
    choices = tuple(
        Choice(*key, error, tuple(each / len(some) for each in seconds["|".join(key)]), (missed, false))
        for key, (error, missed, false) in judged.items()
    )
    shipped = "moments, edge completion, separation"
    own = next(each for each in choices if each.series == shipped)
    plain = next(each for each in choices if each.parameter == f"{SENSOR.contact.threshold * 1e3:g} mN")
    largest = next(each for each in choices if each.series == "largest taxel")
    uniform = 1e3 * LAYOUT.pitch_x * (math.sqrt(2) + math.asinh(1)) / 6
    checks = (
        *((Check("error of the largest taxel over that of a uniform place within its cell [1]", largest.error / uniform,
                 0.7, 1.4),) if name == "middle" else ()),
        Check("error of the shipped method over that of the centroid above the same threshold [1]",
              own.error / plain.error, 0.0, 1.0 if name != "middle" else 3.0),
        Check("images in which forces sum up to what presses [share]", float(np.mean(
            [image.force.max() > SENSOR.contact.threshold for image in images])), 1.0, 1.0),
    )  # fmt: skip
    return Front(
        f"contacts_{name}",
        f"Contact finding, {what}",
        "one image of 25 taxels",
        "mean error of a centre of pressure [mm]",
        f"centres of the balls that press; a missed one counts {1e3 * REACH:g} mm",
        0.0,
        choices,
        shipped,
        checks,
        f"With {what} the shipped method errs by {shown(own.error)} mm, a centroid above the same threshold by "
        f"{shown(plain.error)} mm, in {shown(plain.median / own.median)} of the run time. Choose the centroid only "
        "where one contact never comes near an edge or another one.",
        why_not="In the middle a centroid does as well: what is shipped pays at edges and between contacts, and it "
        "also gives variances and axes.",
        question={"edge": "the place of a contact at an edge", "pairs": "the places of two contacts"}.get(name, ""),
        rival=plain.name if name in ("edge", "pairs") else "",
        columns=("missed %", "false %"),
    )
