# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Find film, bias and compensation of a sensor element with the best signal-to-noise ratio within given limits.

python examples/optimise_design.py                       # some seconds
python examples/optimise_design.py --most-power 2e-3 --netlist best.cir

An evolution strategy on arrays: each generation is one `PosfetDesign` of many elements, drawn log-normally about the
best of the last. Designs that are not valid, or beyond a limit, cannot win.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from posfet_model.design import report
from posfet_model.design.posfet_design import PosfetDesign

FIELDS = {
    "film_thickness": (1e-6, 10e-6),
    "film_area": (0.25e-6, 4e-6),
    "reference_current": (20e-6, 400e-6),
    "compensation": (10e-12, 200e-12),
    "zero_resistor": (300.0, 10e3),
    "gate_width": (300e-6, 6000e-6),
}
"""Fields that are varied, with their bounds in SI units."""


def score(design: PosfetDesign, least_bandwidth: float, most_power: float, most_area: float) -> np.ndarray:
    """Return the signal-to-noise ratio [dB] of each design, -inf where it is not valid or beyond a limit."""
    figures = report.values(design, ["snr_db", "bandwidth_hz", "power_w", "area_m2", "phase_margin_deg"])
    good = design.valid & (figures["phase_margin_deg"] >= 60)
    good &= (figures["bandwidth_hz"] >= least_bandwidth) & (figures["power_w"] <= most_power)
    good &= figures["area_m2"] <= most_area
    return np.where(good, figures["snr_db"], -np.inf)


def main(words: Sequence[str] | None = None) -> int:
    """Optimise, and print the best design; return 1 if none is within the limits."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--designs", type=int, default=200, help="designs in a generation")
    parser.add_argument("--generations", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--least-bandwidth", type=float, default=1e6, metavar="HZ")
    parser.add_argument("--most-power", type=float, default=4e-3, metavar="W")
    parser.add_argument("--most-area", type=float, default=1.5e-6, metavar="M2")
    parser.add_argument("--netlist", type=Path, metavar="OUT.cir", help="write the best op-amp for SPICE")
    options = parser.parse_args(words)

    generator = np.random.default_rng(options.seed)
    low, high = np.log(np.array(list(FIELDS.values()))).T
    centre, spread = 0.5 * (low + high), 0.5 * (high - low)
    best, best_score = centre, -np.inf
    for generation in range(options.generations):
        drawn = np.clip(centre + spread * generator.standard_normal((options.designs, len(FIELDS))), low, high)
        drawn[0] = best
        design = PosfetDesign(**dict(zip(FIELDS, np.exp(drawn).T, strict=True)))
        scores = score(design, options.least_bandwidth, options.most_power, options.most_area)
        good = int(np.isfinite(scores).sum())
        if good:
            best, best_score = drawn[scores.argmax()], float(scores.max())
            elite = drawn[np.argsort(-scores)[: max(good // 4, 1)]]
            centre, spread = elite.mean(axis=0), np.maximum(elite.std(axis=0), 0.02)
        print(f"generation {generation + 1}: {good} of {options.designs} within the limits, best {best_score:.2f} dB")
    if not np.isfinite(best_score):
        print("no design is within the limits")
        return 1
    winner = PosfetDesign(**{name: float(value) for name, value in zip(FIELDS, np.exp(best), strict=True)})
    print(*(f"{name}: {float(getattr(winner, name)):.4g}" for name in FIELDS), sep="\n")
    print(report.as_text(winner))
    if options.netlist:
        options.netlist.write_text(winner.netlist() + "\n", encoding="ascii")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
