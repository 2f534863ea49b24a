# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Tolerance analysis of a design: Monte Carlo over spreads of its fields and mismatch of its transistors, in arrays.

A field with a spread is log-normal, with the nominal value as its median, so that it never changes its sign. Mismatch
of a pair follows M. J. M. Pelgrom et al., IEEE J. Solid-State Circuits 24 (1989) 1433, doi:10.1109/JSSC.1989.572629:
the standard deviation of the difference is A/sqrt(W*L), for the threshold and for the relative gain factor.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, FloatArray, Mask
from posfet_model.design import report
from posfet_model.design.posfet_design import PosfetDesign

QUANTILES: Final = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
"""Quantiles of the output."""

OFFSET: Final = "offset_v"
"""Key of the offset [V], at the top electrode: here with that by mismatch."""

MAX_SAMPLES: Final = 1_000_000
"""Most samples."""

THRESHOLD_MISMATCH: Final = 45e-9
"""A of the threshold [V m], 45 mV um: 1 mV um for each nm of oxide, a usual rule; assumed."""

GAIN_MISMATCH: Final = 0.02e-6
"""A of the relative gain factor [m], 2 % um; assumed."""


@dataclass(frozen=True)
class Limit:
    """Allowed range of a figure of merit; unchecked."""

    key: str
    """Key of the figure, of `report.KEYS`."""
    low: float = -math.inf
    """Smallest allowed value."""
    high: float = math.inf
    """Largest allowed value."""


@dataclass(frozen=True)
class Tolerance:
    """Spreads, mismatch and limits; unchecked."""

    samples: int = 1000
    """Number of samples."""
    seed: int = 1
    """Seed of the random numbers."""
    spread: tuple[tuple[str, float], ...] = ()
    """Field, and its relative standard deviation [1]."""
    threshold_mismatch: float = THRESHOLD_MISMATCH
    """A of the threshold [V m]."""
    gain_mismatch: float = GAIN_MISMATCH
    """A of the relative gain factor [m]."""
    limits: tuple[Limit, ...] = ()
    """What a good sample has to meet, besides being valid."""


@dataclass(frozen=True, eq=False)
class ToleranceResult:
    """Outcome of a tolerance analysis."""

    figures: dict[str, FloatArray]
    """Figures of merit of each sample by key (`report.KEYS`), shape [samples]."""
    valid: Mask
    """Which samples are valid designs."""
    passed: dict[str, Mask]
    """Which samples meet each limit, by its key."""

    @property
    def yielded(self) -> float:
        """Share of the samples that are valid and meet every limit [1]."""
        return float(np.mean(np.logical_and.reduce([self.valid, *self.passed.values()])))

    def quantiles(self, key: str) -> Array:
        """Return the quantiles `QUANTILES` of a figure; NaN where no sample has a known value.

        Parameters
        ----------
        key : str
            Key of the figure.
        """
        known = self.figures[key][~np.isnan(self.figures[key])]
        if not known.size:
            return np.full(len(QUANTILES), np.nan)
        return np.asarray(np.quantile(known, QUANTILES, method="inverted_cdf"))

    def csv(self) -> str:
        """Return the samples as CSV, with valid and pass as 1 or 0; unknown is nan."""
        good = np.logical_and.reduce([self.valid, *self.passed.values()])
        columns = {**self.figures, "valid": self.valid, "pass": good}
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        return "\n".join([",".join(columns), *(",".join(f"{value:.12g}" for value in row) for row in rows), ""])


def run_tolerance(design: PosfetDesign, tolerance: Tolerance) -> ToleranceResult:
    """Return the figures of merit of random samples of a design.

    Parameters
    ----------
    design : PosfetDesign
        Nominal design, of numbers.
    tolerance : Tolerance
        Spreads, mismatch and limits.

    Returns
    -------
    ToleranceResult
        Samples, and which of them meet the limits.

    Raises
    ------
    ValueError
        The design has arrays, or a sample is not plausible.
    """
    if design.shape:
        raise ValueError(f"design must be a single one, got arrays of shape {design.shape}; use design.at(...)")
    generator = np.random.default_rng(tolerance.seed)
    count = tolerance.samples

    def normal() -> Array:
        return generator.standard_normal(count)

    changed = {
        name: getattr(design, name) * np.exp(math.sqrt(math.log1p(relative**2)) * normal())
        for name, relative in tolerance.spread
    }

    def mismatch(part: str) -> tuple[Array, Array]:
        """Return differences of threshold [V] and relative gain factor [1] of a pair, or of a mirror to M6."""
        root = math.sqrt(getattr(design, f"{part}_width") * getattr(design, f"{part}_length"))
        return tolerance.threshold_mismatch / root * normal(), tolerance.gain_mismatch / root * normal()

    pair, load, tail, sink = (mismatch(part) for part in ("gate", "load", "tail", "sink"))
    for name, (threshold, gain) in (("tail_width", tail), ("sink_width", sink)):
        current = 1 + gain - 2 * threshold / _mirror_overdrive(design)
        changed[name] = changed.get(name, getattr(design, name)) * np.maximum(current, 0.1)
    samples = dataclasses.replace(design, **changed)
    amplifier = samples.amplifier
    ratio = amplifier.load_transconductance / amplifier.input_transconductance
    offset = pair[0] / samples.coupling + ratio * load[0] + 0.5 * amplifier.overdrive * (pair[1] + load[1])
    figures: dict[str, FloatArray] = {key: np.array(value) for key, value in report.values(samples).items()}
    figures[OFFSET] = figures[OFFSET] + offset
    passed = {
        limit.key: np.asarray((figures[limit.key] >= limit.low) & (figures[limit.key] <= limit.high))
        for limit in tolerance.limits
    }
    return ToleranceResult(figures, np.array(samples.valid), passed)


def _mirror_overdrive(design: PosfetDesign) -> float:
    """Return the overdrive of M6 [V], without its channel-length modulation."""
    beta = design.electron_mobility * design.oxide_capacitance * design.mirror_width / design.mirror_length
    return math.sqrt(2 * float(design.reference_current / beta))
