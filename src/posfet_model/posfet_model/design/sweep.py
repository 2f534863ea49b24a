# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sweeps of a design over ranges of its fields, and the Pareto front of signal-to-noise, bandwidth, power and area."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from posfet_model._lib.types import Array, FloatArray, Mask
from posfet_model.design import report
from posfet_model.design.posfet_design import PosfetDesign

OBJECTIVES: Final = {"snr_db": 1, "bandwidth_hz": 1, "power_w": -1, "area_m2": -1}
"""Figures of the Pareto front; 1: the larger the better, -1: the smaller the better."""

MAX_POINTS: Final = 10_000
"""Most points of one range."""

MAX_DESIGNS: Final = 1_000_000
"""Most designs of a sweep."""

CHUNK: Final = 2_000
"""Designs that are computed at once, between two updates of the progress."""


@dataclass(frozen=True)
class Axis:
    """Range of one field; unchecked."""

    field: str
    """Name of the field of `PosfetDesign`."""
    start: float
    """First value, in SI."""
    stop: float
    """Last value, in SI."""
    points: int
    """Number of values, 2 or more."""
    log: bool = False
    """Whether their logarithms are evenly spaced, not the values."""

    @property
    def values(self) -> Array:
        """Values of the field, shape [points]."""
        space = np.geomspace if self.log else np.linspace
        return np.asarray(space(self.start, self.stop, self.points))


@dataclass(frozen=True)
class Sweep:
    """Every combination of the values of some fields."""

    axes: tuple[Axis, ...]
    """Ranges; the last one changes fastest."""

    @property
    def designs(self) -> int:
        """Number of combinations."""
        return int(np.prod([axis.points for axis in self.axes], dtype=object))

    def fields(self) -> dict[str, Array]:
        """Return the values of each field, shape [designs]."""
        grid = np.meshgrid(*(axis.values for axis in self.axes), indexing="ij")
        return {axis.field: part.ravel() for axis, part in zip(self.axes, grid, strict=True)}


@dataclass(frozen=True, eq=False)
class SweepResult:
    """Figures of merit of all designs of a sweep, all arrays of shape [designs]."""

    fields: dict[str, Array]
    """Value of each field that was swept."""
    figures: dict[str, FloatArray]
    """Figures of merit by key (`report.KEYS`)."""
    valid: Mask
    """Which designs are valid."""
    reasons: dict[str, int]
    """Number of designs that are not valid for each reason, the most frequent first; one may have several."""
    pareto: Mask
    """Which valid designs no other valid design beats in one of `OBJECTIVES` without being worse in another."""

    def csv(self) -> str:
        """Return the table as CSV: fields, figures, valid and pareto as 1 or 0; unknown is nan."""
        columns = {**self.fields, **self.figures, "valid": self.valid, "pareto": self.pareto}
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        lines = (",".join(f"{value:.12g}" for value in row) for row in rows)
        return "\n".join([",".join(columns), *lines, ""])


def run_sweep(
    design: PosfetDesign, sweep: Sweep, jobs: int = 1, progress: Callable[[int], None] = lambda done: None
) -> SweepResult:
    """Return the figures of merit of a design at every point of a sweep.

    Parameters
    ----------
    design : PosfetDesign
        Design whose other fields stay.
    sweep : Sweep
        Ranges.
    jobs : int, default 1
        Processes; more than 1 needs joblib, and is 1 without it.
    progress : callable
        Called with the number of designs that are done.

    Returns
    -------
    SweepResult
        Fields and figures of merit.

    Raises
    ------
    ValueError
        A value of a range is not plausible, or values contradict each other.
    """
    fields = sweep.fields()
    chunks = []
    for begin in range(0, sweep.designs, CHUNK):
        part: dict[str, Any] = {name: value[begin : begin + CHUNK] for name, value in fields.items()}
        chunks.append(dataclasses.replace(design, **part))
    parts, done, reasons = [], 0, Counter[str]()
    for computed in _computed(chunks, jobs):
        parts.append(computed)
        reasons.update(computed[2])
        done += len(computed[1])
        progress(done)
    figures = {key: np.concatenate([one[0][key] for one in parts]) for key in report.KEYS}
    valid = np.concatenate([one[1] for one in parts])
    return SweepResult(fields, figures, valid, dict(reasons.most_common()), _best(figures, valid))


def joblib_is_there() -> bool:
    """Return whether joblib is installed."""
    return importlib.util.find_spec("joblib") is not None


def pareto_front(costs: Array) -> Mask:
    """Return which rows no other row beats: not larger in any column, and smaller in one; unchecked.

    Parameters
    ----------
    costs : ndarray
        What is to be small, shape [n, k].

    Returns
    -------
    ndarray
        Mask, shape [n]; equal rows are all on the front, or none.
    """
    order = np.lexsort(costs.T[::-1])  # no row is beaten by a later one, but for ties of all columns
    left, front = order, np.zeros(len(costs), np.bool_)
    while left.size:
        best = costs[left[0]]
        same = np.all(costs[left] == best, axis=1)
        front[left[same]] = True
        left = left[np.any(costs[left] < best, axis=1)]
    return front


def _best(figures: dict[str, FloatArray], valid: Mask) -> Mask:
    costs: Array = np.stack([-sign * np.asarray(figures[key], np.float64) for key, sign in OBJECTIVES.items()], axis=1)
    known = valid & np.isfinite(costs).all(axis=1)
    best = np.zeros(valid.shape, np.bool_)
    best[known] = pareto_front(costs[known])
    return best


_Chunk: TypeAlias = "tuple[dict[str, FloatArray], Mask, dict[str, int]]"
"""Figures and validity of designs, and how many are not valid for each reason."""


def _chunk(design: PosfetDesign) -> _Chunk:
    figures: dict[str, FloatArray] = {key: np.array(value) for key, value in report.values(design).items()}
    masks = ((reason, np.broadcast_to(mask, design.shape)) for reason, mask in design.validity.findings.items())
    reasons = {reason: int(np.count_nonzero(mask)) for reason, mask in masks if np.any(mask)}
    return figures, np.array(design.valid), reasons


def _computed(chunks: list[PosfetDesign], jobs: int) -> Iterator[_Chunk]:
    if jobs == 1 or len(chunks) == 1 or not joblib_is_there():
        yield from map(_chunk, chunks)
        return
    joblib: Any = importlib.import_module("joblib")
    for begin in range(0, len(chunks), jobs):  # a batch for all processes, then an update of the progress
        yield from joblib.Parallel(n_jobs=jobs)(joblib.delayed(_chunk)(one) for one in chunks[begin : begin + jobs])
