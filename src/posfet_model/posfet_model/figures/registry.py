"""All figures by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from matplotlib.figure import Figure

from posfet_model.figures import (
    amplifier,
    charge,
    design,
    errata,
    film,
    layout,
    mechanics,
    schematic,
    stability,
    structure,
    transistor,
)

FIGURES: Final[dict[str, Callable[[], Figure]]] = {
    **structure.FIGURES,
    **film.FIGURES,
    **transistor.FIGURES,
    **layout.FIGURES,
    **schematic.FIGURES,
    **charge.FIGURES,
    **amplifier.FIGURES,
    **mechanics.FIGURES,
    **design.FIGURES,
    **errata.FIGURES,
    **stability.FIGURES,
}
"""Name of each file and the function that draws it."""
