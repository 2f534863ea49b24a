# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Settings of the reconstruction from the parameters of the model node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from posfet_model.config import ConfigError
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import ContactThresholds, Sensor


def contact_thresholds(sensor: Sensor, parameters: Mapping[str, Any]) -> ContactThresholds:
    """Return the thresholds that parameters give, where they are not 0, and else the sensor.

    Raises ConfigError, one line, if contacts would end above the force at which they begin.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    parameters : mapping
        Values of `posfet_model.parameters.TUNING` by name.
    """
    own = sensor.contact
    threshold = parameters["contact_threshold"] or own.threshold
    release = parameters["release_threshold"] or threshold * (1.0 - own.deadband / own.threshold)
    if release > threshold:
        raise ConfigError(
            f"release_threshold: must be at most contact_threshold, {threshold:g} N, got {release:g} N; "
            "set both at once"
        )
    return ContactThresholds(threshold, threshold - release)


def reconstruction_settings(sensor: Sensor, parameters: Mapping[str, Any]) -> ReconstructionSettings:
    """Return the settings that parameters give; raise ConfigError, one line, if they do not fit each other.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    parameters : mapping
        Values of `posfet_model.parameters.TUNING` by name.
    """
    return ReconstructionSettings(
        max_relative_uncertainty=parameters["max_relative_uncertainty"],
        touch_at_start=parameters["touch_at_start"],
        hum_removal=parameters["hum_removal"],
        contact=contact_thresholds(sensor, parameters),
    )
