# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibration of each taxel of one sensor, relative to the nominal parameters of its sensor file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Sensor

NOMINAL_GAIN_DEVIATION: Final = 0.06
"""Relative standard deviation of each taxel's own gain, uncalibrated [1], assumed: that of a simulated board, 5 %
and 3 %."""

NOMINAL_COMMON_GAIN_DEVIATION: Final = 0.08
"""Relative standard deviation of the gains that all taxels have in common, uncalibrated [1], assumed: film."""

NOMINAL_LEAK_DEVIATION: Final = 0.1
"""Relative standard deviation of each taxel's own leakage time constant, uncalibrated [1], assumed."""

CALIBRATED_GAIN_DEVIATION: Final = 0.02
"""Relative standard deviation of each taxel's own gain after a calibration that does not state it [1], assumed."""

CALIBRATED_COMMON_GAIN_DEVIATION: Final = 0.015
"""The same of what the gains have in common: ageing and temperature since the calibration [1], assumed."""

CALIBRATED_LEAK_DEVIATION: Final = 0.02
"""Relative standard deviation of each taxel's own leakage time constant after a calibration that does not state it [1],
assumed."""

NOMINAL_LEAK_PER_KELVIN_DEVIATION: Final = 0.03
"""Standard deviation of the increase of leak rates per temperature that was not measured [1/K], assumed: they double
within 15 K on some boards, and hardly change on others."""

NOMINAL_WARMTH_DEVIATION: Final = 0.015
"""Standard deviation of the temperature rise of a touched taxel that was not measured [K], assumed: a thick chip."""

NOMINAL_WARMTH_FORCE: Final = 0.05
"""Force on a taxel at which it has 1 - 1/e of the temperature rise of a strong touch [N], assumed."""

NOMINAL_WARMTH_TIME_CONSTANT: Final = 0.5
"""Time constant of that temperature rise [s], assumed."""

WARMTH_LEAST_DIFFERENCE: Final = 3e-3
"""Standard deviation of the temperature rise from taxel to taxel, and from touch to touch [K], and"""

WARMTH_SPREAD: Final = 0.25
"""in addition to it, as a share of the rise that they have in common [1]; both assumed."""

NOMINAL_BENDING_DEVIATION: Final = (3e-3, 1.5e-3, 1.5e-3, 1.5e-3)
"""Standard deviations of the bending of the chip, uncalibrated, as in `Calibration.bending` [1], assumed."""

CHIP_WARMING_TIMES: Final = (0.1, 1.0, 10.0)
"""Time constants with which an object warms the chip, and the film charges all taxels [s], one per decade."""

POLES: Final = 3
"""Number of relaxation poles: a spread of time constants over three decades is one pole per decade."""

PLAY_HALF_WIDTHS: Final = (0.005, 0.02, 0.08)
"""Half widths r of the play operators that model the film's hysteresis, relative to the maximum force [1], assumed: for
loops of small and of large forces; equally spaced in their logarithm, up to a fifth of a press of the rig."""

COVER_SPREADS: Final = (0.5, 0.75, 1.25, 1.6, 2.4)
"""Spreads of covers, relative to that of the sensor file [1]: the cover of a board is a mixture of these with it."""

UNCALIBRATED_ERROR: Final = 0.1
"""Error of the total force without a calibration [1]: docs/accuracy.md, ablation, 9 % of a press and of a hold, rounded
up."""


def _none() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Prediction error of a fit on the hold-out set, the part of the recording that was not fitted."""

    force_rms: float
    """Root mean square error of a taxel's force [N]."""
    force_rms_before: float
    """The same uncalibrated, with the nominal parameters of the sensor file [N]."""
    samples: int
    """Number of values: scans times taxels."""
    time: Array = field(default_factory=_none)
    """Start of each stretch of the hold-out set [s]; not in the file."""
    force_rms_over_time: Array = field(default_factory=_none)
    """`force_rms` of each stretch [N]; not in the file."""
    force_rms_before_over_time: Array = field(default_factory=_none)
    """`force_rms_before` of each stretch [N]; not in the file."""


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
    gain_deviation: Array
    """Relative standard deviation of each taxel's own gain [1]."""
    leak_deviation: Array
    """Relative standard deviation of each taxel's own leakage time constant [1]."""
    crosstalk: float
    """Share of a taxel's signal that each of its four neighbours picks up [1]."""
    common_gain_deviation: float = CALIBRATED_COMMON_GAIN_DEVIATION
    """Relative standard deviation of the gains that all taxels have in common [1]: by ageing and temperature, and, on a
    film with hysteresis, that of the gains of other forces than typical ones."""
    leak_per_kelvin: float = 0.0
    """Increase of the leak rates per temperature above `temperature`, of their logarithm [1/K]."""
    leak_per_kelvin_deviation: float = NOMINAL_LEAK_PER_KELVIN_DEVIATION
    """Standard deviation of `leak_per_kelvin` [1/K]."""
    thermal_time_constant: float | None = None
    """Lag of the film's temperature behind the chip's [s]; None: as in the sensor file."""
    date: str = ""
    """Date of the recording, ISO 8601; empty: uncalibrated."""
    residuals: Residuals | None = field(default=None)
    """Prediction error on the hold-out set; None: uncalibrated."""
    relaxation_time_constants: Array = field(default_factory=_none)
    """Time constants of dielectric relaxation and viscoelastic creep, common to all taxels [s], shape [poles]."""
    relaxation_sizes: Array = field(default_factory=_none)
    """Share of a force's charge that comes in slowly with each pole, relative to that which comes at once [1], shape
    [poles]; common to all taxels."""
    relaxation_deviations: Array = field(default_factory=_none)
    """Standard deviations of `relaxation_sizes` [1], shape [poles]."""
    hysteresis_half_widths: Array = field(default_factory=_none)
    """Half widths r of the play operators P of the film's hysteresis [N], shape [operators]; empty: not in the file."""
    hysteresis_weights: Array = field(default_factory=_none)
    """Their weights w: a force F makes a charge of gain*(F + sum(w*(F - P)) - hysteresis_slope*F) [1], common to all
    taxels, shape [operators]."""
    hysteresis_slope: float = 0.0
    """Slope of that sum between the ends of a loop of a typical force, which is in the gains [1]."""
    warmth: float = 0.0
    """Level of the temperature rise of a taxel's film that a touch of room temperature causes [K]; 0: not observed."""
    warmth_deviation: float = NOMINAL_WARMTH_DEVIATION
    """Standard deviation of `warmth` [K]."""
    warmth_time_constant: float = NOMINAL_WARMTH_TIME_CONSTANT
    """Time constant with which the film warms and cools [s]."""
    warmth_force: float = NOMINAL_WARMTH_FORCE
    """Force F_w on a taxel that causes 1 - 1/e of it [N]: the thermal contact of a force F is 1 - exp(-(F/F_w)^p)."""
    warmth_steepness: float = 1.0
    """Steepness p of that [1]: 1 saturates gradually, a large one is a contact that is whole from F_w on."""
    bending: Array = field(default_factory=_none)
    """Charge that bending of the chip makes on every taxel, as a force per total force; the same that its gradients in
    x and y make at the edges of the array; and, per moment of the forces about the middle relative to half a side, as
    the chip bends around the place that is pressed [1], shape [4]; empty: not in the file."""
    bending_deviation: Array = field(default_factory=_none)
    """Standard deviations of `bending` [1], as wide as without a calibration where the recording does not show it."""
    bending_profile: Array = field(default_factory=_none)
    """Part of each taxel in the first of `bending`, relative to their mean [1], shape [taxels]; empty: all the same."""
    cover_spreads: Array = field(default_factory=_none)
    """Standard deviations of the Gaussians as whose mixture the cover spreads a load [m], shape [parts], the first one
    that of the sensor file; empty: not in the file."""
    cover_shares: Array = field(default_factory=_none)
    """Share that each has in the cover [1], shape [parts]."""
    chip_warming_time_constants: Array = field(default_factory=_none)
    """Time constants with which an object warms the chip [s], shape [poles]; empty: not in the file."""
    chip_warming: Array = field(default_factory=_none)
    """By how much it does with each, per total force [K/N], shape [poles]."""
    temperature_sensor_lag: float = 0.0
    """Lag of the chip's temperature sensors behind the chip [s]. The film lags behind the sensors by
    `thermal_time_constant` minus this, which may be below 0."""
    temperature_sensor_dead_time: float = 0.0
    """Part of that lag that is a dead time [s]; the rest is of first order."""
    temperature_reading_deviation: float = 0.0
    """Standard deviation of a reading of these sensors, their mean: noise and rounding [K]; 0: not in the file."""
    temperature: float | None = None
    """Mean chip temperature of the calibration while a force was applied [degC]; None: unknown."""

    @classmethod
    def nominal(cls, sensor: Sensor) -> Calibration:
        """Return the nominal parameters of an uncalibrated sensor."""
        taxels = sensor.layout.taxels
        return cls(
            gain=np.ones(taxels),
            pyroelectric_gain=np.ones(taxels),
            leak_time_constant=np.full(taxels, sensor.device.leak_time_constant),
            offset=np.zeros(taxels),
            gain_deviation=np.full(taxels, NOMINAL_GAIN_DEVIATION),
            leak_deviation=np.full(taxels, NOMINAL_LEAK_DEVIATION),
            crosstalk=0.0,
            common_gain_deviation=NOMINAL_COMMON_GAIN_DEVIATION,
        )

    @property
    def calibrated(self) -> bool:
        """Whether the parameters were fitted to a recording."""
        return self.residuals is not None

    @property
    def warmth_observed(self) -> bool:
        """Whether the temperature rise of a touched taxel was observable in the recording."""
        return self.warmth != 0.0

    @property
    def summary(self) -> str:
        """Date of the calibration, or what its absence costs, in one line."""
        if self.calibrated:
            return f"of {self.date or 'unknown date'}"
        return f"uncalibrated: forces may be off by {UNCALIBRATED_ERROR:.0%}"

    @cached_property
    def dead(self) -> Mask:
        """Mask of the taxels that did not respond during calibration."""
        return np.isnan(self.gain)

    @property
    def usual_leak_time_constant(self) -> float:
        """Median leakage time constant of the taxels that respond [s]; of all where none does."""
        alive = ~self.dead
        return float(np.median(self.leak_time_constant[alive if alive.any() else slice(None)]))

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
