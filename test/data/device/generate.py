"""Write the 40-digit reference tables of the device model: ``python test/data/device/generate.py``.

Each table is computed with mpmath at 80 digits, straight from the equation of the paper as corrected in docs/errata.md,
in textbook form and with no code of posfet_model. The inputs are float64 numbers and enter exactly.
"""

from __future__ import annotations

import csv
import itertools
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mpmath
from mpmath import mpf

DIGITS = 40
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


TABLES = {
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


def main() -> int:
    """Write every table beside this script."""
    for name, table in TABLES.items():
        with (Path(__file__).parent / f"{name}.csv").open("w", newline="", encoding="ascii") as file:
            file.write(f"# {table.title}; inputs exact, outputs to {DIGITS} digits\n")
            file.write("# made by test/data/device/generate.py with mpmath; do not edit\n")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([*table.inputs, *table.outputs])
            writer.writerows(table.row(case) for case in table.cases())
    return 0


if __name__ == "__main__":
    sys.exit(main())
