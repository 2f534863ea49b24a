# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Tolerance analysis of a design: Monte Carlo over spreads of its fields and mismatch of its transistors, in arrays.

A field with a spread is log-normal, with the nominal value as its median, so that it never changes its sign. Of each
sample, offset and common-mode rejection are those of the circuit whose pairs differ (`mismatch`).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, FloatArray, Mask
from posfet_model.amplifier.circuit_figures import circuit_figures
from posfet_model.design import report
from posfet_model.design.amplifier_figures import circuit_blocks
from posfet_model.design.mismatch import deviations, mismatched
from posfet_model.design.posfet_design import PosfetDesign

QUANTILES: Final = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
"""Quantiles of the output."""

OFFSET: Final = "offset_v"
"""Key of the offset [V], at the top electrode: here with that by mismatch."""

MAX_SAMPLES: Final = 1_000_000
"""Most samples."""

CMRR: Final = "cmrr_db"
"""Key of the common-mode rejection with mismatch [dB], of samples only."""

KEYS: Final = (*report.KEYS, CMRR)
"""Keys of the figures of a sample."""


@dataclass(frozen=True)
class Limit:
    """Allowed range of a figure of merit; unchecked."""

    key: str
    """Key of the figure, of `KEYS`."""
    low: float = -math.inf
    """Smallest allowed value."""
    high: float = math.inf
    """Largest allowed value."""


@dataclass(frozen=True)
class Tolerance:
    """Spreads and limits; unchecked."""

    samples: int = 1000
    """Number of samples."""
    seed: int = 1
    """Seed of the random numbers."""
    spread: tuple[tuple[str, float], ...] = ()
    """Field, and its relative standard deviation [1]."""
    limits: tuple[Limit, ...] = ()
    """What a good sample has to meet, besides being valid."""


@dataclass(frozen=True, eq=False)
class ToleranceResult:
    """Outcome of a tolerance analysis."""

    figures: dict[str, FloatArray]
    """Figures of merit of each sample by key (`KEYS`), shape [samples]."""
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
        Spreads and limits.

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

    def differences(part: str) -> tuple[Array, Array]:
        volts, gain = deviations(design, part)
        return volts * normal(), gain * normal()

    (volts, gain), load = differences("gate"), differences("load")
    # M5 and M8 repeat the current of M6, whose own deviation they share.
    tail, mirror, sink = (np.divide(differences(part), math.sqrt(2)) for part in ("tail", "mirror", "sink"))
    for name, (shift, stronger) in (("tail_width", tail - mirror), ("sink_width", sink - mirror)):
        current = 1 + stronger - 2 * shift / _mirror_overdrive(design)
        changed[name] = changed.get(name, getattr(design, name)) * np.maximum(current, 0.1)
    samples = dataclasses.replace(design, **changed)
    circuit = mismatched(samples.op_amp, (volts / samples.coupling, gain), load)
    real = [circuit_figures(block) for block in circuit_blocks(circuit, (count,))]
    figures: dict[str, FloatArray] = {key: np.array(value) for key, value in report.values(samples).items()}
    figures[OFFSET] = np.concatenate([one.offset for one in real])
    with np.errstate(divide="ignore", invalid="ignore"):
        figures[CMRR] = 20 * np.log10(np.concatenate([one.common_mode_rejection for one in real]))
    passed = {
        limit.key: np.asarray((figures[limit.key] >= limit.low) & (figures[limit.key] <= limit.high))
        for limit in tolerance.limits
    }
    return ToleranceResult(figures, np.array(samples.valid), passed)


def _mirror_overdrive(design: PosfetDesign) -> float:
    """Return the overdrive of M6 [V], without its channel-length modulation."""
    beta = design.electron_mobility * design.oxide_capacitance * design.mirror_width / design.mirror_length
    return math.sqrt(2 * float(design.reference_current / beta))
