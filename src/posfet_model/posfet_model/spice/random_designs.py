# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""How often the model's verdict about stability disagrees with ngspice's, on random designs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from posfet_model.amplifier.one_stage import CIRCUIT_C
from posfet_model.amplifier.open_loop import LEAST_PHASE_MARGIN, MOST_OVERSHOOT
from posfet_model.amplifier.operating_point import CIRCUIT_B, TABLE_II
from posfet_model.spice import ngspice
from posfet_model.spice.circuit_models import from_sizes
from posfet_model.spice.circuits import Circuit, with_film, with_widths
from posfet_model.spice.measurement import measure_bias_point, measure_loop, oscillates, overshoot
from posfet_model.spice.netlist import subcircuit
from posfet_model.spice.stimuli import slewing_time, step

VERDICTS: Final = ("unstable", "not usable", "usable")
"""Usable: stable, a phase margin of 45 degrees and at most 10 % of overshoot."""

STEP: Final = 0.05
"""Step on which overshoot and oscillation are seen [V]."""

WIDTHS: Final = {"M1": (5e-4, 4e-3), "M3": (8e-5, 3.2e-4), "M5": (6e-5, 1.6e-4), "M7": (1.2e-4, 9.6e-4)}
"""Ranges of the widths [m]; those of M2 and M4 follow, and M8 for an offset near zero."""

BIAS: Final = {
    "reference_current": (2e-5, 4e-4),
    "compensation": (2e-12, 1e-10),
    "load_capacitance": (1e-12, 3e-10),
    "load_resistance": (4e3, 1e6),
    "modulation": (0.003, 0.1),
}
"""Ranges of the bias, in the units of AmplifierBias; all ranges are drawn from logarithmically."""

ZERO_RESISTOR: Final = (300.0, 8000.0)
"""Range of Rz [ohm]."""

WITHOUT_RESISTOR: Final = 0.4
"""Share of the designs that have none [1]."""

FILM: Final = (1e-6, 5e-6)
"""Range of the film's thickness [m]."""


@dataclass(frozen=True)
class Verdict:
    """What ngspice and the model say about one design."""

    circuit: Circuit
    spice: str
    """One of `VERDICTS`."""
    model: str
    """One of `VERDICTS`."""
    phase_margin: tuple[float, float]
    """By ngspice, by the model [degrees]."""
    unity_crossing: tuple[float, float]
    """By ngspice, by the model [Hz]."""
    oscillates: bool
    """Whether the step in ngspice does not come to rest."""


def random_circuit(generator: np.random.Generator, number: int) -> Circuit:
    """Return a random circuit; unchecked.

    Parameters
    ----------
    generator : numpy.random.Generator
        Source of randomness.
    number : int
        Its number, for the name; even ones have two stages.
    """

    def draw(ends: tuple[float, float]) -> float:
        return float(np.exp(generator.uniform(*np.log(ends))))

    widths = {name: draw(ends) for name, ends in WIDTHS.items()}
    widths["M2"], widths["M4"] = widths["M1"], widths["M3"]
    widths["M8"] = widths["M5"] * widths["M7"] / (2 * widths["M3"])
    bias = {name: draw(ends) for name, ends in BIAS.items()}
    bias["zero_resistor"] = 0.0 if generator.random() < WITHOUT_RESISTOR else draw(ZERO_RESISTOR)
    design = with_film(draw(FILM), with_widths(TABLE_II, **widths))
    two_stages = number % 2 == 0
    return Circuit(
        f"random_{number}", 2 if two_stages else 1, replace(CIRCUIT_B if two_stages else CIRCUIT_C, **bias), design
    )


def verdicts(count: int, seed: int) -> Iterator[Verdict]:
    """Yield the verdicts on random designs of which all transistors are saturated in ngspice.

    Parameters
    ----------
    count : int
        Number of designs.
    seed : int
        Of the random generator.

    Yields
    ------
    Verdict
        What ngspice and the model say.

    Raises
    ------
    ngspice.SpiceError
        ngspice is missing or a run failed.
    """
    generator = np.random.default_rng(seed)
    number = found = 0
    while found < count:
        circuit = random_circuit(generator, number)
        number += 1
        verdict = judge(circuit)
        if verdict is not None:
            found += 1
            yield verdict


def judge(circuit: Circuit) -> Verdict | None:
    """Return what ngspice and the model say, None where a transistor is not saturated or the gain is below 10.

    Parameters
    ----------
    circuit : Circuit
        The circuit.

    Returns
    -------
    Verdict or None
        The verdict.

    Raises
    ------
    ngspice.SpiceError
        ngspice is missing or a run failed.
    """
    text = subcircuit(circuit)
    point = measure_bias_point(circuit)
    if not all(transistor.saturated for transistor in point.transistors.values()):
        return None
    loop = measure_loop(ngspice.run_double_injection(text, highest=1e10))
    if loop.gain < 10:
        return None
    what = step(0.0, STEP, loop.unity_crossing, 3 * slewing_time(circuit, STEP))
    run = ngspice.run_follower(text, what.source, what.stop, what.largest_step)
    peak = overshoot(run.v_out, float(run.v_out[0]) + STEP * loop.gain / (1 + loop.gain))
    model = from_sizes(circuit)
    good = loop.phase_margin >= LEAST_PHASE_MARGIN and peak <= MOST_OVERSHOOT
    return Verdict(
        circuit=circuit,
        spice=_verdict(loop.stable, good),
        model=_verdict(model.stable, model.usable),
        phase_margin=(loop.phase_margin, model.phase_margin),
        unity_crossing=(loop.unity_crossing, model.unity_crossing),
        oscillates=oscillates(np.interp(np.linspace(what.time[2], what.stop, 2001), run.time, run.v_out)),
    )


def _verdict(stable: bool, usable: bool) -> str:
    return "unstable" if not stable else "usable" if usable else "not usable"


def confusion_table(found: list[Verdict]) -> str:
    """Return the counts of verdicts, ngspice by row and the model by column, and the designs that differ; unchecked.

    Parameters
    ----------
    found : list of Verdict
        The verdicts.

    Returns
    -------
    str
        Text of several lines.
    """
    counts = Counter((verdict.spice, verdict.model) for verdict in found)
    lines = [f"{'ngspice':14}" + "".join(f"{'model: ' + name:>20}" for name in VERDICTS)]
    lines += [f"{row:14}" + "".join(f"{counts[row, column]:20}" for column in VERDICTS) for row in VERDICTS]
    margins = np.array([verdict.phase_margin[1] - verdict.phase_margin[0] for verdict in found])
    crossings = np.array([100 * (verdict.unity_crossing[1] / verdict.unity_crossing[0] - 1) for verdict in found])
    wrong = [verdict for verdict in found if (verdict.spice == "unstable") != (verdict.model == "unstable")]
    swinging = sum(verdict.oscillates and verdict.spice != "unstable" for verdict in found)
    lines += [
        f"{len(found)} designs; stability differs on {len(wrong)}, usability on "
        f"{sum(verdict.spice != verdict.model for verdict in found) - len(wrong)}",
        f"phase margin: within 5 degrees on {int(np.sum(np.abs(margins) <= 5))}, worst {_worst(margins):+.1f}; "
        f"unity crossing: within 10 % on {int(np.sum(np.abs(crossings) <= 10))}, worst {_worst(crossings):+.1f} %",
        f"in ngspice {swinging} designs of positive phase margin still swing after a step of {1e3 * STEP:g} mV",
    ]
    return "\n".join(
        [
            *lines,
            *(f"{one.circuit.name}: {one.phase_margin[0]:.1f} / {one.phase_margin[1]:.1f} degrees" for one in wrong),
        ]
    )


def _worst(errors: np.ndarray) -> float:
    return float(errors[np.argmax(np.abs(errors))]) if errors.size else math.nan
