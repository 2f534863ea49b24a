# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Settings of the reconstruction, and switches for its components."""

from __future__ import annotations

from dataclasses import dataclass

from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.estimation.settings import MAX_RELATIVE_UNCERTAINTY
from posfet_model.sensor.description import ContactThresholds


@dataclass(frozen=True)
class ReconstructionSettings:
    """Settings of a reconstructor; a component is switched off to learn what it contributes."""

    priors: ErrorPriors | None = None
    """Standard deviations of the force errors; None: the defaults."""
    max_relative_uncertainty: float = MAX_RELATIVE_UNCERTAINTY
    """Standard deviation of the total force over that force above which the forces are not valid [1]."""
    touch_at_start: bool = False
    """Whether something may touch the array at the start: forces are not valid until a release or a forced tare shows
    what no force is."""
    contact: ContactThresholds | None = None
    """Thresholds of contacts; None: those of the sensor."""
    hum_removal: bool = True
    """Whether mains hum is estimated and subtracted."""
    fault_detection: bool = True
    """Whether taxels are tested for faults; without, those that are faulty stay excluded, and the noise of all others
    is still measured."""
