# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Write the 40-digit reference tables of the device model: ``python test/data/device/generate.py``.

Each table is computed with mpmath at 80 digits, straight from the equation of the paper as corrected in docs/errata.md,
in textbook form and with no code of posfet_model. The inputs are float64 numbers and enter exactly.
"""

from __future__ import annotations

import csv
import itertools
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mpmath
from mpmath import mpf

DIGITS = 40
VACUUM_PERMITTIVITY = 8.8541878188e-12  # F/m, CODATA 2022
mpmath.mp.dps = 2 * DIGITS


@dataclass(frozen=True)
class Table:
    """One file: what it holds, the input and output columns, the cases, and the equation."""

    title: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    cases: Callable[[], Iterable[Sequence[float]]]
    solve: Callable[..., Sequence[mpf]]

    def row(self, case: Sequence[float]) -> list[str]:
        """One line of the file."""
        solved = self.solve(*(mpf(value) for value in case))
        return [repr(float(value)) for value in case] + [mpmath.nstr(value, DIGITS) for value in solved]


def first_order_hold_cases() -> Iterable[Sequence[float]]:
    """h/tau from 1e-18 to 1e12, over the corners of step and time constant and every decade between."""
    pairs = [(1e-9, 10.0**k) for k in range(-12, 10)] + [(1e3, 10.0**k) for k in range(-9, 10)]
    pairs += [(1e-3, 0.27), (0.05, 0.27), (0.27, 0.27), (1.0, 0.27), (10.0, 0.27), (0.135, 0.27)]
    charges = [(0.0, 0.0, 1e-5), (1e-5, 0.0, 0.0), (1e-5, 2e-5, -3e-5), (-4.2e-2, 1e-9, 3.8e-5)]
    return [(*charge, *pair) for pair, charge in itertools.product(pairs, charges)]


def first_order_hold(charge: mpf, start: mpf, end: mpf, step: mpf, tau: mpf) -> Sequence[mpf]:
    """Solve d(sigma)/dt = dq/dt - sigma/tau for a straight q, and for a q that jumps first."""
    decay = mpmath.exp(-step / tau)
    slope = (end - start) / step
    return charge * decay + slope * tau * (1 - decay), (charge + end - start) * decay


def leak_cases() -> Iterable[Sequence[float]]:
    """Frequency or time against time constant, every third decade."""
    return itertools.product([0.0] + [10.0**k for k in range(-9, 10, 3)], [10.0**k for k in range(-9, 10, 3)])


def leak(variable: mpf, tau: mpf) -> Sequence[mpf]:
    """High pass at the frequency `variable`, and what is left of a step after the time `variable`."""
    turn = 2 * mpmath.pi * variable * tau
    return turn**2 / (1 + turn**2), turn / (1 + turn**2), mpmath.exp(-variable / tau)


FILMS = [(160e5, 0.02, 0.05, 12.0), (500e5, 0.06, 0.065, 7.5), (1e6, 1e-4, 0.25, 300.0)]
"""Table I, a well poled copolymer, a nearly linear film: Ec, Pr, Ps, epsF."""


def film_cases() -> Iterable[Sequence[float]]:
    """Fields of both signs, every half decade to 1e12 V/m, and the neighbourhood of the coercive field."""
    near = [0.0, 0.5, 0.99, 1.0, 1.01, 2.0, 3.0, 5.0]
    for film in FILMS:
        fields = [film[0] * value for value in near] + [10 ** (k / 2) for k in range(25)]
        yield from ((sign * field, *film) for field in fields for sign in (1, -1))


def film_branches(field: mpf, coercive: mpf, remnant: mpf, saturation: mpf, permittivity: mpf) -> Sequence[mpf]:
    """Steepness, rising and falling branch: eq. (3), (2), (4)."""
    delta = coercive / mpmath.log((1 + remnant / saturation) / (1 - remnant / saturation))
    linear = permittivity * mpf(VACUUM_PERMITTIVITY) * field
    rising = saturation * mpmath.tanh((field - coercive) / (2 * delta)) + linear
    falling = saturation * mpmath.tanh((field + coercive) / (2 * delta)) + linear
    return delta, rising, falling


def minor_loop_cases() -> Iterable[Sequence[float]]:
    """A film never poled: up to one field, down to a second, up to a third that may pass the first."""
    ups, downs, ends = (0.3, 1.0, 2.5, 10.0), (-10.0, -1.5, -0.2, 0.1), (0.2, 0.99, 2.0, 4.0, 12.0)
    for film in FILMS:
        yield from ((*(film[0] * x for x in path), *film) for path in itertools.product(ups, downs, ends))


def minor_loop(
    up: mpf, down: mpf, end: mpf, coercive: mpf, remnant: mpf, saturation: mpf, permittivity: mpf
) -> Sequence[mpf]:
    """Polarisation at the three fields, from the branches scaled between turning points."""
    delta = coercive / mpmath.log((1 + remnant / saturation) / (1 - remnant / saturation))

    def rise(field: mpf) -> mpf:
        return saturation * mpmath.tanh((field - coercive) / (2 * delta))

    def fall(field: mpf) -> mpf:
        return saturation * mpmath.tanh((field + coercive) / (2 * delta))

    def to_saturation(field: mpf, start: mpf, switched: mpf) -> mpf:
        return saturation - (saturation - switched) * (saturation - rise(field)) / (saturation - rise(start))

    first = to_saturation(up, mpf(0), mpf(0))
    if down > -up:
        second = -first + 2 * first * (fall(down) - fall(-up)) / (fall(up) - fall(-up))
        tip, height = up, first
    else:
        second = -to_saturation(-down, mpf(0), mpf(0))
        tip, height = -down, -second
    if end < tip:
        third = height + (second - height) * (rise(tip) - rise(end)) / (rise(tip) - rise(down))
    else:
        third = to_saturation(end, mpf(0), mpf(0))
    linear = permittivity * mpf(VACUUM_PERMITTIVITY)
    return first + linear * up, second + linear * down, third + linear * end


def transistor_cases() -> Iterable[Sequence[float]]:
    """Overdrives and drain voltages either side of each other, beta over its decades, with and without lambda."""
    overdrives = [-1e6, -1.0, -1e-9, 0.0, 1e-9, 1e-3, 0.25, 1.0, 1.5, 5.0, 1e3, 1e6]
    drains = [0.0, 1e-9, 1e-3, 0.25, 1.0, 5.0, 1e3, 1e6]
    gains = [(1e-12, 0.0), (9.3446e-4, 0.0), (9.3446e-4, 0.1), (1e6, 10.0)]
    return [(over, drain, *gain) for over, drain, gain in itertools.product(overdrives, drains, gains)]


def transistor(overdrive: mpf, drain: mpf, beta: mpf, modulation: mpf) -> Sequence[mpf]:
    """Eq. (9) and (10) region by region with 1 + lambda*Vds, and the derivatives of each region."""
    longer = 1 + modulation * drain
    if overdrive <= 0:
        return mpf(0), mpf(0), mpf(0)
    if drain < overdrive:
        shape = overdrive * drain - drain**2 / 2
        return beta * shape * longer, beta * drain * longer, beta * ((overdrive - drain) * longer + shape * modulation)
    shape = overdrive**2 / 2
    return beta * shape * longer, beta * overdrive * longer, beta * shape * modulation


def membrane_cases() -> Iterable[Sequence[float]]:
    """Pressures, sizes, thicknesses, moduli and Poisson's ratios, from nanometre and pascal to the limits."""
    sizes = [(1e-9, 1e-9), (5e-3, 20e-6), (5e-3, 50e-6), (1e-2, 450e-6), (1.0, 1e-3)]
    stuff = [(169e9, 0.3), (3e9, 0.35), (1e3, 0.5), (2e12, -0.9)]
    return [(p, *size, *what) for p, size, what in itertools.product([0.0, 1e-3, 98.0, 1e5, 1e12], sizes, stuff)]


def membrane(pressure: mpf, span: mpf, thickness: mpf, modulus: mpf, poisson: mpf) -> Sequence[mpf]:
    """Clamped plates: P*r^4/(64*D) for the circle, 0.00126531908748*P*a^4/D for the square."""
    rigidity = modulus * thickness**3 / (12 * (1 - poisson**2))
    load = pressure * span**4 / rigidity
    return load / 64, mpf("0.00126531908748") * load


def source_cases() -> Iterable[Sequence[float]]:
    """Forces to 1e4 N on 1 mm2, temperatures from -60 to 150 degC about 20, fields to 1e12 V/m."""
    coefficients = [(-38e-12, -40e-6, 12.0), (1e-6, -0.1, 1e5)]
    stresses = [0.0, -1.0, -1e6, -1e10, 1e16]
    return [
        (stress, change, field, *some)
        for stress, change, field in itertools.product(stresses, [0.0, -80.0, 130.0, 1e-6], [0.0, -1e7, 1e12])
        for some in coefficients
    ]


def source(stress: mpf, change: mpf, field: mpf, piezo: mpf, pyro: mpf, permittivity: mpf) -> Sequence[mpf]:
    """Charge density without leak, and electric displacement, eq. (1)."""
    return piezo * stress + pyro * change, piezo * stress + permittivity * mpf(VACUUM_PERMITTIVITY) * field


def stack_cases() -> Iterable[Sequence[float]]:
    """Oxides and films of every thickness accepted, charges of both signs, kappa from 0 to 1."""
    oxides = [(3.9, 45e-9), (1.0, 1e-10), (25.0, 1e-3)]
    films = [(12.0, 2.5e-6), (7.5, 1e-10), (1e5, 1e-4)]
    charges = [(0.07, 1.0), (-3.8e-5, 0.010962), (1e6, 1e-12), (1e-12, 0.0)]
    return [(*oxide, *film, *charge) for oxide, film, charge in itertools.product(oxides, films, charges)]


def stack(oxide: mpf, oxide_height: mpf, film: mpf, film_height: mpf, charge: mpf, kappa: mpf) -> Sequence[mpf]:
    """Eq. (8), (6) and (7), and the gain factor of 850 cm2/Vs, 3276 um, 12 um, eq. (9)."""
    of_oxide = oxide * mpf(VACUUM_PERMITTIVITY) / oxide_height
    of_film = film * mpf(VACUUM_PERMITTIVITY) / film_height
    series = 1 / (1 / of_oxide + 1 / of_film)
    gain = mpf(0.085) * series * mpf(3276e-6) / mpf(12e-6)
    return of_oxide, of_film, series, -kappa * charge / of_film, -kappa * charge / of_oxide, gain


def bending_cases() -> Iterable[Sequence[float]]:
    """Chips of two layers from nanometres to centimetres on cylinders from 1 um to 1e6 m."""
    chips = [(20e-6, 169e9, 0.3), (450e-6, 169e9, 0.3), (1e-9, 1e3, 0.5), (1e-2, 2e12, -0.9)]
    films = [(2.5e-6, 3e9, 0.35), (1e-9, 2e12, 0.0), (1e-2, 1e3, 0.5)]
    return [(*chip, *film, radius) for chip, film, radius in itertools.product(chips, films, [1e-6, 1e-2, 1.0, 1e6])]


def bending(
    chip: mpf, chip_modulus: mpf, chip_poisson: mpf, film: mpf, film_modulus: mpf, film_poisson: mpf, radius: mpf
) -> Sequence[mpf]:
    """Neutral axis by the balance of forces, strain at back, top and middle of the film; mask opening, eq. (11)."""
    stiff = chip_modulus / (1 - chip_poisson**2) * chip, film_modulus / (1 - film_poisson**2) * film
    neutral = (stiff[0] * chip / 2 + stiff[1] * (chip + film / 2)) / (stiff[0] + stiff[1])
    heights = 0, chip + film, chip + film / 2
    return neutral, *((height - neutral) / (radius + neutral) for height in heights), film + mpmath.sqrt(2) * chip


TABLES = {
    "source": Table(
        "charge density without leak and electric displacement [C/m2] of stress [Pa], change [K] and field [V/m]",
        ("stress", "change", "field", "piezo", "pyro", "permittivity"),
        ("charge", "displacement"),
        source_cases,
        source,
    ),
    "stack": Table(
        "capacitances [F/m2], threshold shifts [V], gain factor [A/V2] of permittivities, heights [m], charge [C/m2]",
        ("oxide", "oxide_height", "film", "film_height", "charge", "kappa"),
        ("of_oxide", "of_film", "series", "shift_gate", "shift_oxide", "gain_factor"),
        stack_cases,
        stack,
    ),
    "bending": Table(
        "neutral axis [m] and strains [1] of a chip with a film on a cylinder; opening [m] is film + sqrt(2)*chip",
        ("chip", "chip_modulus", "chip_poisson", "film", "film_modulus", "film_poisson", "radius"),
        ("neutral_axis", "back_strain", "top_strain", "film_strain", "opening"),
        bending_cases,
        bending,
    ),
    "transistor": Table(
        "drain current [A], transconductance and output conductance [S] at an overdrive and drain voltage [V]",
        ("overdrive", "drain_voltage", "gain_factor", "channel_length_modulation"),
        ("drain_current", "transconductance", "output_conductance"),
        transistor_cases,
        transistor,
    ),
    "membrane": Table(
        "deflection [m] of clamped membranes, circular (span is the radius) and square (span is the side)",
        ("pressure", "span", "thickness", "young_modulus", "poisson_ratio"),
        ("circular", "square"),
        membrane_cases,
        membrane,
    ),
    "film_branches": Table(
        "branch steepness [V/m] and polarisation [C/m2] on the saturated branches at a field [V/m]",
        ("field", "coercive_field", "remnant", "saturation", "permittivity"),
        ("steepness", "rising", "falling"),
        film_cases,
        film_branches,
    ),
    "film_minor_loops": Table(
        "polarisation [C/m2] of a film never poled, at three fields [V/m] one after the other",
        ("up", "down", "end", "coercive_field", "remnant", "saturation", "permittivity"),
        ("at_up", "at_down", "at_end"),
        minor_loop_cases,
        minor_loop,
    ),
    "charge_step": Table(
        "charge density [C/m2] after one step [s] with the time constant [s]",
        ("charge", "source_start", "source_end", "step", "time_constant"),
        ("first_order_hold", "step_hold"),
        first_order_hold_cases,
        first_order_hold,
    ),
    "charge_leak": Table(
        "frequency response at `variable` [Hz] and step response at `variable` [s]",
        ("variable", "time_constant"),
        ("response_real", "response_imag", "step_response"),
        leak_cases,
        leak,
    ),
}


def write(tables: Mapping[str, Table], script: str) -> int:
    """Write every table beside this script; return the exit code."""
    for name, table in tables.items():
        with (Path(__file__).parent / f"{name}.csv").open("w", newline="", encoding="ascii") as file:
            file.write(f"# {table.title}; inputs exact, outputs to {DIGITS} digits\n")
            file.write(f"# made by test/data/device/{script} with mpmath; do not edit\n")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([*table.inputs, *table.outputs])
            writer.writerows(table.row(case) for case in table.cases())
    return 0


if __name__ == "__main__":
    sys.exit(write(TABLES, "generate.py"))
