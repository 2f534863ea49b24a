# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

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
