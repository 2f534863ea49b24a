# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Non-idealities of the piezoelectric film, its cover and the chip below it, each with a moderate and a hard value.

No published figure of a POSFET array was found: every value is assumed, unless it names a source. docs/simulation.md
has the table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Final

from posfet_sim.device.error_model_key import Key

SHAPES: Final = ("contact_warmth_time", "bending_gradient")
"""Values that only say how another effect acts."""


@dataclass(frozen=True)
class FilmEffects:
    """Effects that an ideal film has not; 0 switches each one off, and it is not computed."""

    relaxation: float
    """Growth of the charge per force, relative to that at once, in each decade of the time a force is held [1].

    For a constant loss tangent tan(delta) the Kramers-Kronig relations give ``2*ln(10)/pi*tan(delta)`` per decade:
    0.02 (PVDF) is 2.9 % per decade.
    """
    creep: float
    """Growth of the charge per force, relative to that at once, by viscoelastic creep within 1 s to 10 s [1]."""
    minor_loops: float
    """Width of the hysteresis loops of charge against small forces, relative to the peak of the loop [1]."""
    preload_nonlinearity: float
    """Growth of the charge per small force, relative to that without preload, per preload of the taxel [1/N]."""
    d33_temperature: float
    """Relative growth of the piezoelectric coefficient per film temperature [1/K]."""
    leak_halving: float
    """Rise of the film temperature that halves the leakage time constant [K]; 0: constant."""
    leak_drift: float
    """Random walk of the logarithm of the leakage time constant [1/sqrt(s)]."""
    contact_warmth: float
    """Steady temperature rise of the film of a firmly touched taxel above that of the chip [K]."""
    contact_warmth_time: float
    """Time constant of that temperature rise [s]: of the object and its cover, from 0.2 s to some seconds."""
    chip_warming: float
    """Steady temperature rise of the chip per total force of the objects on the array [K/N]."""
    bending: float
    """Charge on every taxel by bending of the chip, as a force on the taxel per total force in the middle [1]."""
    bending_gradient: float
    """Change of `bending` from the middle to a corner, for a force at that corner, relative to `bending` [1]."""
    gain_drift: float
    """Standard deviation over the taxels of the relative rate of change of the gain [1/s]."""

    @property
    def any_on(self) -> bool:
        """Whether any effect is on."""
        return any(getattr(self, field.name) for field in fields(self) if field.name not in SHAPES)

    @classmethod
    def ideal(cls) -> FilmEffects:
        """Return a film without any of the effects."""
        return cls(**{key.attribute: key.default for key in FILM_KEYS})

    @classmethod
    def moderate(cls) -> FilmEffects:
        """Return a film with every effect at a moderate size."""
        return cls(
            relaxation=0.02,
            creep=0.04,
            minor_loops=0.015,
            preload_nonlinearity=0.01,
            d33_temperature=0.005,
            leak_halving=15.0,
            leak_drift=0.01 / math.sqrt(60.0),
            contact_warmth=0.03,
            contact_warmth_time=0.5,
            chip_warming=0.05,
            bending=2e-3,
            bending_gradient=0.5,
            gain_drift=0.01 / 3600.0,
        )

    @classmethod
    def hard(cls) -> FilmEffects:
        """Return a film with every effect at the size of a poor specimen."""
        return replace(
            cls.moderate(),
            relaxation=0.03,
            creep=0.08,
            minor_loops=0.03,
            preload_nonlinearity=0.02,
            leak_halving=10.0,
            contact_warmth=0.2,
            chip_warming=0.2,
            bending=8e-3,
        )


FILM_KEYS: Final = (
    Key("film", "relaxation_percent_per_decade", "relaxation", 0.0, 1e-2, -10, 10),
    Key("film", "creep_percent", "creep", 0.0, 1e-2, -30, 30),
    Key("film", "minor_loops_percent", "minor_loops", 0.0, 1e-2, 0, 10),
    Key("film", "preload_percent_per_N", "preload_nonlinearity", 0.0, 1e-2, 0, 20),
    Key("film", "d33_percent_per_K", "d33_temperature", 0.0, 1e-2, -5, 5),
    Key("film", "leak_halving_K", "leak_halving", 0.0, 1.0, 0, 1000),
    Key("film", "leak_drift_percent_per_sqrt_min", "leak_drift", 0.0, 1e-2 / math.sqrt(60.0), 0, 20),
    Key("film", "contact_warmth_K", "contact_warmth", 0.0, 1.0, -5, 5),
    Key("film", "contact_warmth_time_s", "contact_warmth_time", 0.5, 1.0, 0.02, 60),
    Key("film", "chip_warming_K_per_N", "chip_warming", 0.0, 1.0, -5, 5),
    Key("film", "bending_mN_per_N", "bending", 0.0, 1e-3, -100, 100),
    Key("film", "bending_gradient", "bending_gradient", 0.5, 1.0, 0, 1),
    Key("film", "gain_drift_percent_per_h", "gain_drift", 0.0, 1e-2 / 3600.0, 0, 20),
)
"""Keys of the film effects in a file, in the order of docs/simulation.md; the defaults are those of the ideal film."""
