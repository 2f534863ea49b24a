# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Parameters of the paper (Table I, Table II, Sec. V) and those that it does not give, each with unit and source.

The paper: "Towards Bendable Piezoelectric Oxide Semiconductor Field Effect Transistor based Touch Sensor". Values are
in SI units. An `assumed` value is neither from the paper nor measured on this device.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from posfet_model._lib.validation import real_number
from posfet_model.device.constants import VACUUM_PERMITTIVITY
from posfet_model.device.film import Film
from posfet_model.device.transistor import Plane, Stack, capacitance_per_area, gain_factor


@dataclass(frozen=True)
class Quantity:
    """One parameter: name, value in SI units, unit, source, and whether it is assumed."""

    name: str
    value: float
    unit: str
    source: str
    assumed: bool = False


@dataclass(frozen=True)
class TransistorSize:
    """Channel width and length [m], in [1e-9, 1], of one transistor of the amplifier, with their source."""

    name: str
    width: float
    length: float
    source: str = ""
    assumed: bool = False

    def __post_init__(self) -> None:
        real_number("width", self.width, 1e-9, 1)
        real_number("length", self.length, 1e-9, 1)


_TABLE_I: Final = "Table I"
_TEXT: Final = "text below eq. (4), where the values of Pr and Ps are swapped"
_MANUAL: Final = "Measurement Specialties, Piezo Film Sensors Technical Manual"

CHANNEL_WIDTH: Final = Quantity("channel width of the POSFET", 3276e-6, "m", _TABLE_I)
CHANNEL_LENGTH: Final = Quantity("channel length of the POSFET", 12e-6, "m", _TABLE_I)
MOBILITY: Final = Quantity("electron mobility", 850e-4, "m2/(V s)", _TABLE_I)
OXIDE_THICKNESS: Final = Quantity("gate oxide thickness", 45e-9, "m", _TABLE_I)
FILM_THICKNESS: Final = Quantity("film thickness", 2.5e-6, "m", _TABLE_I)
FILM_PERMITTIVITY: Final = Quantity("relative permittivity of the film", 12.0, "1", _TABLE_I)
COERCIVE_FIELD: Final = Quantity("coercive field of the film", 160e5, "V/m", "text: 40 V across 2.5 um")
REMNANT_POLARISATION: Final = Quantity("remnant polarisation", 0.02, "C/m2", _TEXT)
SATURATION_POLARISATION: Final = Quantity("saturation polarisation", 0.05, "C/m2", _TEXT)
OXIDE_PERMITTIVITY: Final = Quantity("relative permittivity of the oxide", 3.9, "1", "thermal SiO2", assumed=True)

AMPLIFIER_GAIN: Final = Quantity("open-loop gain of the amplifier, 42.3 dB", 10 ** (42.3 / 20), "1", "Sec. V")
GAIN_BANDWIDTH: Final = Quantity("gain-bandwidth product of the amplifier", 1.5e6, "Hz", "Sec. V")

THRESHOLD_VOLTAGE: Final = Quantity(
    "threshold voltage before poling", 0.7, "V", "typical of such a process", assumed=True
)
POLING_SHIFT: Final = Quantity(
    "threshold shift by poling", -1.0, "V", "kappa = 0.010962 on the oxide, 0.00060714 at the gate", assumed=True
)
UNCOMPENSATED_FRACTION: Final = Quantity(
    "uncompensated fraction kappa of the polarisation",
    -POLING_SHIFT.value
    * (FILM_PERMITTIVITY.value * VACUUM_PERMITTIVITY / FILM_THICKNESS.value)
    / (SATURATION_POLARISATION.value + REMNANT_POLARISATION.value),
    "1",
    "the poling shift above, of Ps + Pr at the gate",
    assumed=True,
)
PIEZOELECTRIC_COEFFICIENT: Final = Quantity("d33 of the saturated copolymer", -38e-12, "C/N", _MANUAL)
PYROELECTRIC_COEFFICIENT: Final = Quantity(
    "pyroelectric coefficient",
    -40e-6,
    "C/(m2 K)",
    f"{_MANUAL} (magnitude); sign by the convention of d33: heating reads as a pull",
)
FORCE_AREA: Final = Quantity("area on which the force on a taxel acts", 1e-6, "m2", "1 mm2 taxel", assumed=True)
BIAS_RESISTANCE: Final = Quantity("bias resistor at the gate", 10e9, "ohm", "typical of such films", assumed=True)
LEAK_TIME_CONSTANT: Final = Quantity(
    "leakage time constant",
    0.27,
    "s",
    "10 Gohm with 26.6 pF, a taxel of 1 mm2 at the piezo film manual's permittivity of 7.5; 0.43 s with Table I's 12",
    assumed=True,
)
FLICKER_CONSTANT: Final = Quantity(
    "1/f noise constant of the process, K*W*L*Cox",
    1e-24,
    "V2 F",
    "order of magnitude of n-channel transistors (Razavi gives 1e-25 for good processes)",
    assumed=True,
)
TEMPERATURE: Final = Quantity("temperature of the chip", 300.0, "K", "room temperature", assumed=True)
SILICON_MODULUS: Final = Quantity(
    "Young's modulus of the chip", 169e9, "Pa", "<110> in (100) silicon, doi:10.1109/JMEMS.2009.2039697", assumed=True
)
SILICON_POISSON_RATIO: Final = Quantity(
    "Poisson's ratio of the chip", 0.3, "1", "the value for which eq. (13) is printed", assumed=True
)
FILM_MODULUS: Final = Quantity("Young's modulus of the film", 3e9, "Pa", _MANUAL, assumed=True)
FILM_POISSON_RATIO: Final = Quantity("Poisson's ratio of the film", 0.35, "1", "typical of polymers", assumed=True)
WAFER_THICKNESS: Final = Quantity("wafer thickness at the back-side etch", 450e-6, "m", "text below eq. (11)")

_TABLE_II: Final = "Table II"
AMPLIFIER_SIZES: Final = (
    TransistorSize("M1", 3276e-6, 12e-6, _TABLE_II),
    TransistorSize("M2", 3276e-6, 12e-6, _TABLE_II),
    TransistorSize("M3", 160e-6, 12e-6, _TABLE_II),
    TransistorSize("M4", 160e-6, 12e-6, _TABLE_II),
    TransistorSize("M5", 80e-6, 12e-6, _TABLE_II),
    TransistorSize("M6", 80e-6, 12e-6, _TABLE_II),
    TransistorSize("M7", 240e-6, 12e-6, _TABLE_II),
    TransistorSize(
        "M8", 60e-6, 12e-6, "width missing in Table II; W5*W7/(2*W3) gives zero systematic offset", assumed=True
    ),
)

FILM: Final = Film(
    coercive_field=COERCIVE_FIELD.value,
    remnant_polarisation=REMNANT_POLARISATION.value,
    saturation_polarisation=SATURATION_POLARISATION.value,
    relative_permittivity=FILM_PERMITTIVITY.value,
)
"""The paper's film, with Pr and Ps corrected."""

STACK: Final = Stack(
    oxide=float(capacitance_per_area(OXIDE_PERMITTIVITY.value, OXIDE_THICKNESS.value)),
    film=float(capacitance_per_area(FILM_PERMITTIVITY.value, FILM_THICKNESS.value)),
)
"""The paper's oxide and film, eq. (8)."""


def channel_gain_factor(plane: Plane) -> float:
    """Return beta [A/V2] of the paper's POSFET for a gate voltage counted on a plane, eq. (9).

    Parameters
    ----------
    plane : Plane
        Plane on which the gate voltage is counted.

    Returns
    -------
    float
        beta [A/V2].

    Raises
    ------
    ValueError
        `plane` is not a `Plane`.

    Examples
    --------
    >>> print(f"{channel_gain_factor(Plane.GATE):.4e} {channel_gain_factor(Plane.OXIDE):.4e}")
    9.3446e-04 1.7807e-02
    """
    return float(gain_factor(MOBILITY.value, STACK.drive(plane), CHANNEL_WIDTH.value, CHANNEL_LENGTH.value))


def quantities() -> tuple[Quantity, ...]:
    """Return all parameters of this module, in order of definition."""
    return tuple(value for value in globals().values() if isinstance(value, Quantity))
