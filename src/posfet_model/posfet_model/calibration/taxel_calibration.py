"""Calibration of each taxel of one sensor, relative to the nominal parameters of its sensor file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Sensor


@dataclass(frozen=True)
class Residuals:
    """Prediction error of a fit on the hold-out set, the part of the recording that was not fitted."""

    force_rms: float
    """Root mean square error of a taxel's force [N]."""
    force_rms_before: float
    """The same uncalibrated, with the nominal parameters of the sensor file [N]."""
    samples: int
    """Number of values: scans times taxels."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Parameters of each taxel, shapes [rows * cols]. Gains are relative to the sensor file."""

    gain: Array
    """Sensitivity, signal per force, relative to nominal [1]; NaN: the taxel is dead, and is never used."""
    pyroelectric_gain: Array
    """Signal per film temperature, relative to nominal [1]."""
    leak_time_constant: Array
    """Time constant tau of the charge leakage [s]."""
    offset: Array
    """Output without charge, relative to the nominal offset [V]."""
    crosstalk: float
    """Share of a taxel's signal that each of its four neighbours picks up [1]."""
    thermal_time_constant: float | None = None
    """Lag of the film's temperature behind the chip's [s]; None: as in the sensor file."""
    date: str = ""
    """Date of the recording, ISO 8601; empty: uncalibrated."""
    residuals: Residuals | None = field(default=None)
    """Prediction error on the hold-out set; None: uncalibrated."""

    @classmethod
    def nominal(cls, sensor: Sensor) -> Calibration:
        """Return the nominal parameters of an uncalibrated sensor."""
        taxels = sensor.layout.taxels
        return cls(
            gain=np.ones(taxels),
            pyroelectric_gain=np.ones(taxels),
            leak_time_constant=np.full(taxels, sensor.device.leak_time_constant),
            offset=np.zeros(taxels),
            crosstalk=0.0,
        )

    @cached_property
    def dead(self) -> Mask:
        """Mask of the taxels that did not respond during calibration."""
        return np.isnan(self.gain)

    @property
    def usable_gain(self) -> Array:
        """`gain` with NaN replaced by 1."""
        return np.where(self.dead, 1.0, self.gain)

    def with_gain_error(self, spread: float, rng: np.random.Generator) -> Calibration:
        """Return a copy with random gain errors, to simulate an imperfect calibration.

        Parameters
        ----------
        spread : float
            Relative standard deviation of the gains [1], in [0, 0.3].
        rng : numpy.random.Generator
            Source of the random errors.

        Returns
        -------
        Calibration
            A calibration with other gains.
        """
        spread = real_number("spread", spread, 0.0, 0.3)
        return replace(self, gain=self.gain * np.maximum(1.0 + spread * rng.standard_normal(len(self.gain)), 0.1))
