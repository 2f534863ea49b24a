# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Units at the edge of the code: texts such as ``2.5 um`` to SI, and refusal of numbers that are in another unit.

Inside, every number is in SI units. A number outside the plausible range of its quantity is refused by an error that
names the expected unit and, where one explains the number, the unit that it was probably meant in.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.shown import interval
from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import real_values

UNITS: Final[dict[str, dict[str, float]]] = {
    "m": {"um": 1e-6, "nm": 1e-9, "mm": 1e-3, "cm": 1e-2},
    "m2": {"mm2": 1e-6, "um2": 1e-12, "cm2": 1e-4},
    "F": {"pF": 1e-12, "fF": 1e-15, "nF": 1e-9, "uF": 1e-6},
    "ohm": {"Gohm": 1e9, "Mohm": 1e6, "kohm": 1e3, "Tohm": 1e12},
    "V": {"mV": 1e-3, "uV": 1e-6, "kV": 1e3},
    "A": {"uA": 1e-6, "mA": 1e-3, "nA": 1e-9},
    "V/m": {"kV/cm": 1e5, "MV/m": 1e6, "V/um": 1e6, "MV/cm": 1e8, "kV/mm": 1e6},
    "C/m2": {"uC/cm2": 1e-2, "mC/m2": 1e-3, "uC/m2": 1e-6},
    "C/N": {"pC/N": 1e-12, "nC/N": 1e-9},
    "C/(m2 K)": {"uC/(m2 K)": 1e-6, "uC/m2K": 1e-6, "nC/(cm2 K)": 1e-5},
    "m2/(V s)": {"cm2/(V s)": 1e-4, "cm2/Vs": 1e-4},
    "Hz": {"kHz": 1e3, "MHz": 1e6, "GHz": 1e9, "mHz": 1e-3},
    "K": {},
    "N": {"mN": 1e-3, "kN": 1e3},
    "1/V": {"1/mV": 1e3},
    "V2 F": {},
    "V m": {"mV um": 1e-9, "mV m": 1e-3},
    "s": {"us": 1e-6, "ms": 1e-3, "ns": 1e-9},
    "W": {"mW": 1e-3, "uW": 1e-6},
    "dB": {},
    "V/N": {"mV/N": 1e-3},
    "V/s": {"V/us": 1e6, "V/ms": 1e3},
    "1": {"%": 1e-2},
}
"""Units of each SI unit that are understood, the likeliest first, with their size in SI."""

_AS_TYPED: Final = str.maketrans(
    {
        "\N{MICRO SIGN}": "u",
        "\N{GREEK SMALL LETTER MU}": "u",
        "\N{GREEK CAPITAL LETTER OMEGA}": "ohm",
        "\N{OHM SIGN}": "ohm",
        "\N{SUPERSCRIPT TWO}": "2",
        "^": "",
    }
)
"""Characters of units in other spellings."""

_TEXT: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


@dataclass(frozen=True)
class Plausible:
    """Unit and plausible range of a quantity; unchecked."""

    unit: str
    """SI unit, a key of `UNITS`."""
    low: float = -math.inf
    """Smallest plausible value, or magnitude."""
    high: float = math.inf
    """Largest plausible value, or magnitude."""
    signed: bool = False
    """Whether the range is that of the magnitude, and either sign is possible."""

    def array(self, name: str, value: ArrayLike) -> FloatArray:
        """Return the value as an array of real, plausible numbers.

        Parameters
        ----------
        name : str
            Name of the quantity, for the error.
        value : array_like
            Value in SI units.

        Returns
        -------
        ndarray
            The value, float64.

        Raises
        ------
        ValueError
            The value is not real, not finite, or not plausible in its SI unit; one line that names the unit, and the
            unit that the number is plausible in.
        """
        array = real_values(name, value).astype(np.float64, copy=False)
        size = np.abs(array) if self.signed else array
        wrong = ~(np.isfinite(array) & (size >= self.low) & (size <= self.high))
        if wrong.any():
            raise ValueError(f"{name} {self.complaint(float(array[wrong].flat[0] if array.ndim else array))}")
        return array

    def complaint(self, value: float) -> str:
        """Return what is wrong with an implausible number: its range, its unit, and the likely one.

        Parameters
        ----------
        value : float
            The number.
        """
        unit = "" if self.unit == "1" else f" {self.unit}"
        what = "of a magnitude in" if self.signed else "in"
        text = f"must be {what} {interval(self.low, self.high)}{unit}, got {value:g}"
        kelvin = value + 273.15
        if self.unit == "K" and self.low <= kelvin <= self.high:
            return f"{text}; in degC it is {kelvin:g} K"
        size = abs(value) if self.signed else value
        for other, factor in UNITS[self.unit].items():
            if self.low <= size * factor <= self.high:
                return f"{text}; meant in {other}? {value:g} {other} is {value * factor:g}{unit}"
        return text

    def parse(self, text: str) -> float:
        """Return the SI value of a number with a unit, such as ``160 kV/cm``; a number alone is in the SI unit.

        Parameters
        ----------
        text : str
            The text.

        Returns
        -------
        float
            The value in `unit`, not checked to be plausible.

        Raises
        ------
        ValueError
            The text is not a number, or its unit is not one of this quantity; the message continues "NAME ...".

        Examples
        --------
        >>> Plausible("V/m").parse("160 kV/cm")
        16000000.0
        >>> Plausible("m").parse("2.5um")
        2.5e-06
        """
        known = {self.unit: 1.0, **UNITS[self.unit]}
        match = _TEXT.fullmatch(text)
        unit = match[2].translate(_AS_TYPED) if match else ""
        if match is None or (unit and unit not in known):
            units = ", ".join(known) if self.unit != "1" else "%"
            raise ValueError(f"must be a number, alone or with a unit of {units}, got '{text:.40}'")
        # Division by a power of ten rounds as the number itself does: 2.5 um is 2.5e-6.
        number, factor = float(match[1]), known[unit or self.unit]
        return number * factor if factor >= 1 else number / round(1 / factor)
