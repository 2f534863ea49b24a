# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Static force from the leaking charge signal: deterministic integration, and a filter of its errors.

Compiled: `posfet_core`, estimation/force_estimator.hpp, which says how; here it is given what description and
calibration say.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_core import scan_path
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.estimation.settings import MAX_RELATIVE_UNCERTAINTY
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import compiled_layout
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms

BLOCK: Final = scan_path.BLOCK
"""Duration of a block [s]."""

LAG: Final = scan_path.LAG
"""Number of blocks that are processed again when a touch begins."""

RESUME_TIME: Final = scan_path.RESUME_TIME
"""No force is valid for this long after an interruption [s]."""


class ForceEstimator(scan_path.ForceEstimator):
    """Force of every taxel with its covariance, from charge densities; arrays row by row, shape [rows * cols].

    `integration` takes each scan; call `start` with the first one, and `close_block` whenever `block_time` has reached
    `BLOCK`. The force at the start is assumed to be zero: a taxel that is loaded then reads zero, a negative
    force once the load is released, and zero soon after.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    priors : ErrorPriors, optional
        How well everything is known; None: the defaults.
    calibration : Calibration, optional
        Properties of each taxel; None: nominal ones from the description.
    max_relative_uncertainty : float, default 0.2
        Standard deviation of the total force over that force, above which the forces are not valid [1]; while the force
        falls, over its greatest value of the last eight blocks.
    """

    def __init__(
        self,
        sensor: Sensor,
        priors: ErrorPriors | None = None,
        calibration: Calibration | None = None,
        max_relative_uncertainty: float = MAX_RELATIVE_UNCERTAINTY,
    ) -> None:
        device = sensor.device
        calibration = calibration or Calibration.nominal(sensor)
        priors = (priors or ErrorPriors()).with_calibration(calibration)
        per_newton, gain, lag = charge_per_newton(sensor), calibration.usable_gain, calibration.thermal_time_constant
        super().__init__(
            layout=compiled_layout(sensor.layout),
            time_constant=calibration.leak_time_constant,
            newton_per_charge=1.0 / (per_newton * gain),
            newton_per_kelvin=device.pyroelectric_coefficient / per_newton * calibration.pyroelectric_gain / gain,
            gain_deviation=np.hypot(calibration.gain_deviation, priors.gain_least),
            common_gain_deviation=calibration.common_gain_deviation,
            leak_deviation=calibration.leak_deviation,
            leak_per_kelvin=calibration.leak_per_kelvin,
            leak_per_kelvin_deviation=calibration.leak_per_kelvin_deviation,
            leak_temperature=math.nan if calibration.temperature is None else calibration.temperature,
            noise=force_noise_rms(sensor),
            threshold=sensor.contact.threshold,
            greatest_force=device.force_max,
            left_charge=priors.left_charge / sensor.volts_per_newton,
            film_lag=max(device.thermal_time_constant if lag is None else lag, 0.0),
            priors=priors,
        )
        self.max_relative_uncertainty = max_relative_uncertainty
