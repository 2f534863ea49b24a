"""What is known of each taxel of one sensor, beyond what its description says of all of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Sensor


@dataclass(frozen=True)
class Residuals:
    """How well a fit foretells what it has not seen: the held-out part of the recording."""

    force_rms: float
    """Root mean square error of a taxel's force [N]."""
    force_rms_before: float
    """The same by the sensor's description alone [N]."""
    samples: int
    """Values it was found on: scans times taxels."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Properties of each taxel, shapes [rows * cols]. Relative ones count from the sensor's description."""

    gain: NDArray[np.float64]
    """Signal per force, relative [1]; NaN: taxel does not answer, and is never used."""
    pyroelectric_gain: NDArray[np.float64]
    """Signal per temperature of the film, relative [1]."""
    leak_time_constant: NDArray[np.float64]
    """[s]"""
    offset: NDArray[np.float64]
    """Output without charge, above that of the description [V]."""
    crosstalk: float
    """Share of a taxel's signal that each of its four neighbours shows [1]."""
    thermal_time_constant: float | None = None
    """Lag of the film's temperature behind the chip's [s]; None: as in the description."""
    date: str = ""
    """When it was recorded, ISO 8601; empty: not recorded but taken from the description."""
    residuals: Residuals | None = field(default=None)

    @classmethod
    def nominal(cls, sensor: Sensor) -> Calibration:
        """Return what the description says."""
        taxels = sensor.layout.taxels
        return cls(
            gain=np.ones(taxels),
            pyroelectric_gain=np.ones(taxels),
            leak_time_constant=np.full(taxels, sensor.device.leak_time_constant),
            offset=np.zeros(taxels),
            crosstalk=0.0,
        )

    @cached_property
    def dead(self) -> NDArray[np.bool_]:
        """Mask of the taxels that did not answer when calibrated."""
        return np.isnan(self.gain)

    @property
    def usable_gain(self) -> NDArray[np.float64]:
        """`gain` with 1 in place of NaN."""
        return np.where(self.dead, 1.0, self.gain)

    def with_gain_error(self, spread: float, rng: np.random.Generator) -> Calibration:
        """Return it with gains that are wrong at random by a relative standard deviation `spread` [1], 0 to 0.3."""
        spread = real_number("spread", spread, 0.0, 0.3)
        return replace(self, gain=self.gain * np.maximum(1.0 + spread * rng.standard_normal(len(self.gain)), 0.1))
