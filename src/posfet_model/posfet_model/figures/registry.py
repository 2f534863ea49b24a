"""All figures by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from matplotlib.figure import Figure

from posfet_model.figures import amplifier, charge, errata, film, mechanics, stability, transistor

FIGURES: Final[dict[str, Callable[[], Figure]]] = {
    **film.FIGURES,
    **transistor.FIGURES,
    **charge.FIGURES,
    **amplifier.FIGURES,
    **mechanics.FIGURES,
    **errata.FIGURES,
    **stability.FIGURES,
}
"""Name of each file and the function that draws it."""
