# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Labelling of 8-connected contact regions: compiled, with the rings around them, and by scipy.ndimage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from benchmarks.outcome import Outcome, Table
from benchmarks.timing import microseconds
from posfet_model.contacts.detection import ContactFinder
from posfet_model.sensor.description import load_sensor

EIGHT = np.ones((3, 3))
BLOBS = {5: 1, 16: 3, 32: 6, 64: 12}
"""Number of regions, by the side of the array."""


def touched_map(size: int, blobs: int) -> np.ndarray:
    """Return a mask with round regions, shape [size, size], like those of fingertips."""
    rng = np.random.default_rng(size)
    y, x = np.mgrid[:size, :size]
    mask = np.zeros((size, size), bool)
    for row, col in rng.uniform(1, size - 2, (blobs, 2)):
        mask |= (y - row) ** 2 + (x - col) ** 2 < 2.5
    return mask


def measure(full: bool) -> Outcome:
    """Time both on the same masks, and count differing regions."""
    sensor = load_sensor()
    rows = []
    values = {}
    for size, blobs in BLOBS.items():
        mask = touched_map(size, blobs)
        forces, none = mask.reshape(-1).astype(float), np.zeros(mask.size)
        finder = ContactFinder(replace(sensor, layout=replace(sensor.layout, rows=size, cols=size)))
        finder.find(forces)
        ours = [region.tolist() for region in finder.regions]
        labels, count = ndimage.label(mask, EIGHT)
        theirs = [np.flatnonzero(labels == number).tolist() for number in range(1, count + 1)]
        repeats = 60 if full else 15

        def label(finder: ContactFinder = finder, forces: np.ndarray = forces, none: np.ndarray = none) -> None:
            finder.find(forces)
            finder.find(none)  # so that the next scan differs from the last one

        compiled = microseconds(label, repeats)
        scipy = microseconds(lambda mask=mask: ndimage.label(mask, EIGHT), repeats)
        force = mask.astype(float)
        centres = microseconds(
            lambda force=force, labels=labels, count=count: ndimage.center_of_mass(force, labels, range(1, count + 1)),
            repeats,
        )
        rows.append(
            (
                f"{size} x {size}",
                len(ours),
                compiled,
                scipy,
                scipy + centres,
                len(set(map(tuple, ours)) ^ set(map(tuple, theirs))),
            )
        )
        values[f"labelling_{size}x{size}_us"] = compiled
        values[f"labelling_{size}x{size}_scipy_us"] = scipy
    columns = ("array", "regions", "compiled us", "scipy label us", "scipy with centres us", "differing regions")
    return Outcome(
        values, [Table("Labelling", columns, rows, "Differing regions: the error; 0 means identical results.")]
    )
