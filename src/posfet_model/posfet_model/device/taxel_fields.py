# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The numbers that describe a taxel, with their defaults, units, sources and plausible ranges."""

from __future__ import annotations

import dataclasses
import enum
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import instance
from posfet_model.device import paper
from posfet_model.device.paper import Quantity
from posfet_model.device.physical_units import Plausible

Values: TypeAlias = "float | FloatArray"
"""A number, or an array of numbers that broadcasts with all others of a design."""

_THRESHOLD: Final = Quantity(
    "threshold of the transistors on the oxide alone, and of M1 and M2 below the paper's film poled to saturation",
    paper.THRESHOLD_VOLTAGE.value,
    "V",
    paper.THRESHOLD_VOLTAGE.source,
    paper.THRESHOLD_VOLTAGE.assumed,
)

POLING_VOLTAGE: Final = Plausible("V", 0, 1e5, signed=True)
"""Plausible voltages across the film while it is poled."""


class FilmGeometry(enum.Enum):
    """Where the film is."""

    EXTENDED = "extended"
    """On an electrode of its own area, loaded by the gate."""
    AS_IN_PAPER = "as in paper"
    """As the paper calculates: the current as if the film covered W*L only (coupling Cpvdf/(Cpvdf + Cox), 0.0525), but
    charge and leakage with the film's own area and without the gate's load. Both cannot be true of one device."""


def quantity(of: Quantity, low: float, high: float, *, signed: bool = False) -> Any:
    """Return a dataclass field with its default from a quantity, and a plausible range; unchecked.

    Parameters
    ----------
    of : Quantity
        Name, default value, unit and source.
    low, high : float
        Plausible range in SI units; of the magnitude with `signed`.
    signed : bool, default False
        Whether either sign is possible.
    """
    return field(default=of.value, metadata={"quantity": of, "plausible": Plausible(of.unit, low, high, signed)})


@dataclass(frozen=True, kw_only=True, eq=False)
class TaxelFields:
    """Film, gate and bias resistor of one taxel, or of many: any field may be an array.

    The defaults are the paper's film and transistor with the coefficients of the piezo film manual.

    Raises
    ------
    ValueError
        A value is not a real number, not plausible in its SI unit, or the shapes of arrays do not broadcast.
    """

    film_area: Values = quantity(paper.FORCE_AREA, 1e-12, 1e-2)
    """Area A of the film and its electrode, on which the force acts [m2]."""
    film_thickness: Values = quantity(paper.FILM_THICKNESS, 1e-8, 1e-3)
    """Thickness t of the film [m]."""
    film_permittivity: Values = quantity(paper.FILM_PERMITTIVITY, 1, 1e4)
    """Relative permittivity of the film [1]."""
    piezoelectric_coefficient: Values = quantity(paper.PIEZOELECTRIC_COEFFICIENT, 1e-14, 1e-8, signed=True)
    """d33 of the film saturated in the positive direction [C/N]."""
    pyroelectric_coefficient: Values = quantity(paper.PYROELECTRIC_COEFFICIENT, 0, 5e-3, signed=True)
    """p of the film saturated in the positive direction [C/(m2 K)], of the sign of d33."""
    coercive_field: Values = quantity(paper.COERCIVE_FIELD, 1e5, 1e10)
    """Ec of the film [V/m]."""
    remnant_polarisation: Values = quantity(paper.REMNANT_POLARISATION, 1e-5, 1.5)
    """Pr of the film [C/m2], below Ps."""
    saturation_polarisation: Values = quantity(paper.SATURATION_POLARISATION, 1e-5, 1.5)
    """Ps of the film [C/m2]."""
    poling_voltages: tuple[Values, ...] | None = None
    """Voltages across the film in the order in which they were applied to the virgin film [V], back to 0 at the end;
    None: saturated in the positive direction."""
    uncompensated_fraction: Values = quantity(paper.UNCOMPENSATED_FRACTION, 0, 1)
    """Share kappa of the polarisation that is not compensated by trapped charge and moves the threshold [1]."""
    gate_width: Values = quantity(paper.CHANNEL_WIDTH, 1e-8, 0.1)
    """Width W of the channel [m]."""
    gate_length: Values = quantity(paper.CHANNEL_LENGTH, 1e-8, 1e-2)
    """Length L of the channel [m]."""
    oxide_thickness: Values = quantity(paper.OXIDE_THICKNESS, 5e-10, 1e-5)
    """Thickness of the gate oxide [m]."""
    oxide_permittivity: Values = quantity(paper.OXIDE_PERMITTIVITY, 1, 1e3)
    """Relative permittivity of the oxide [1]."""
    electron_mobility: Values = quantity(paper.MOBILITY, 1e-5, 1)
    """Mobility of the electrons [m2/(V s)]."""
    threshold_voltage: Values = quantity(_THRESHOLD, 0, 10)
    """Threshold voltage [V] of the transistor below the paper's film, poled to saturation, and of those on the oxide
    alone. Another film, thickness or poling moves it (`threshold`)."""
    bias_resistance: Values = quantity(paper.BIAS_RESISTANCE, 1e3, 1e17)
    """Resistance R from the node to ground [ohm]: the bias resistor and all other leakage in parallel."""
    film_geometry: FilmGeometry = FilmGeometry.EXTENDED
    """Where the film is; the paper's own way of calculating is one choice."""

    def __post_init__(self) -> None:
        for name, plausible in plausible_fields(self).items():
            object.__setattr__(self, name, plausible.array(name, getattr(self, name))[()])
        if self.poling_voltages is not None:
            volts = instance("poling_voltages", self.poling_voltages, tuple)
            checked = tuple(POLING_VOLTAGE.array("poling_voltages", volt)[()] for volt in volts)
            object.__setattr__(self, "poling_voltages", checked)
        instance("film_geometry", self.film_geometry, FilmGeometry)
        _ = self.shape
        if np.any(np.greater_equal(self.remnant_polarisation, self.saturation_polarisation)):
            raise ValueError("remnant_polarisation must be below saturation_polarisation (the paper's text swaps them)")

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Shape to which all fields broadcast; () for a single taxel."""
        shapes = {name: np.shape(getattr(self, name)) for name in plausible_fields(self)}
        shapes |= {f"poling_voltages[{i}]": np.shape(volt) for i, volt in enumerate(self.poling_voltages or ())}
        try:
            return np.broadcast_shapes(*shapes.values())
        except ValueError:
            listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items() if shape)
            raise ValueError(f"shapes must broadcast together, got {listed}") from None


def plausible_fields(of: Any) -> dict[str, Plausible]:
    """Return the numeric fields of a design, or of its class, with their units and plausible ranges; unchecked.

    Parameters
    ----------
    of : Taxel or type
        The design or its class.
    """
    return {item.name: item.metadata["plausible"] for item in dataclasses.fields(of) if "plausible" in item.metadata}
