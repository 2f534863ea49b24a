"""POSFET tactile sensing: device physics, reconstruction of force, contacts. Needs NumPy and PyYAML, not ROS.

The modules of the device are attributes of the package, loaded when first used:

>>> import posfet_model
>>> print(f"{posfet_model.taxel.Taxel().volts_per_newton:.3f} V/N")
0.894 V/N
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from posfet_model import (
        adc,
        amplifier,
        as_printed,
        charge,
        constants,
        film,
        follower,
        mechanics,
        noise,
        one_stage,
        paper,
        slew_model,
        spice,
        taxel,
        threshold,
        transistor,
    )

__all__ = [
    "adc",
    "amplifier",
    "as_printed",
    "charge",
    "constants",
    "film",
    "follower",
    "mechanics",
    "noise",
    "one_stage",
    "paper",
    "slew_model",
    "spice",
    "taxel",
    "threshold",
    "transistor",
]


def __getattr__(name: str) -> ModuleType:
    """Load a module of the device; AttributeError for any other name."""
    if name in __all__:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *__all__]
