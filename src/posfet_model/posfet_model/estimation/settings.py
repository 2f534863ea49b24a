# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Settings and constants of the force observer; all values are assumed unless stated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

LONG_STEP: Final = 0.05
"""h/tau above which the time of a force change within a step matters [1]."""

RUNAWAY: Final = 4.0
"""A taxel restarts when its force exceeds this many times the greatest force of the device [1]; a saturated taxel may
exceed the greatest force."""

TRANSIENT_WEIGHT: Final = 0.1
"""Weight of the time that counts toward a known offset while the temperature changes [1]."""

REDUCED_UNCERTAINTY: Final = 0.5
"""Offsets are estimated again once the standard uncertainty of the film temperature falls below this share of its
greatest value [1]."""

PRIOR_WARMING_TIME: Final = 0.5
"""A chip that begins to warm within this time after the start was warming before the start [s]: the sensors report at
10 Hz."""

REJECTED: Final = 3.0
"""Factor on the prior deviation of the residual charge after that prior was rejected [1]."""

MISMATCH_MEMORY: Final = 0.8
"""Least share of the mismatch deviation that carries over from block to block [1]: warming is irregular."""

LEAST_MISMATCH: Final = 1e-3
"""A mismatch deviation below this is dropped [contact threshold]."""

RESTART_DEVIATION: Final = 0.1
"""Standard uncertainty of an offset that was known when its taxel restarted [contact threshold]."""

OFFSET_SPREAD: Final = 2.0
"""Greatest deviation of an untouched taxel's offset from the median offset [contact threshold]; a larger one requires a
longer rest."""

LARGE_UNCERTAINTY: Final = 0.2
"""Standard uncertainty of a force above which a small force is attributed to baseline error, not to a slow press
[contact threshold]."""


@dataclass(frozen=True)
class ObserverSettings:
    """Settings of the force observer. All values are assumed."""

    block: float = 0.02
    """Duration of a block of scans; baseline and offset are corrected at its end [s]."""
    settle_time: float = 0.1
    """Time for which a taxel must be consistent with a constant force before its offset counts as known [s]."""
    initial_deviation: float = 5e-5
    """Standard deviation of the charge left by an earlier force at the start, as a voltage [V]; grows when rejected."""
    flicker: float = 1e-5
    """1/f noise of the amplifier, the cause of offset drift [V/sqrt(Hz)] at 1 Hz."""
    temperature_random_walk: float = 1e-4
    """Random walk of the film temperature that the chip sensors do not report [K/sqrt(s)]."""
    pyroelectric_mismatch: float = 0.1
    """Relative standard deviation of the taxels' pyroelectric signals without calibration [1]."""
    pyroelectric_mismatch_calibrated: float = 0.02
    """The same with calibration [1]."""
    gain_deviation: float = 0.05
    """Relative standard deviation of a taxel's gain after calibration [1]."""
    leakage_common_deviation: float = 0.1
    """Relative standard deviation of the leakage time constants that all taxels have in common, uncalibrated [1]."""
    leakage_common_deviation_calibrated: float = 0.07
    """The same with calibration: the effect of temperature and ageing [1]."""
    leakage_individual_deviation: float = 0.1
    """Relative standard deviation of each taxel's own leakage time constant, uncalibrated [1]."""
    leakage_individual_deviation_calibrated: float = 0.02
    """The same with calibration [1]."""
    gate: float = 5.0
    """Innovation gate of a block mean, in standard deviations [1]."""
    baseline_slew: float = 0.1
    """Slew limit of the baseline where the offset is known, in contact thresholds per second [1/s]: a slower press is
    absorbed as drift."""
    baseline_rise: float = 0.25
    """Slew limit of the baseline where the force is negative, which no press can cause [1/s]."""
    steady_time: float = 0.2
    """A negative force that is steady for this long is a baseline error [s]."""
    resume_time: float = 0.04
    """No force is valid for this long after an interruption [s]."""
    recovery_time: float = 2.0
    """A taxel whose force stays negative for this long without becoming steady restarts [s]."""
    common_mode: bool = True
    """Whether the least-loaded taxels correct the film temperature ahead of the chip sensors."""
    roll_back: bool = True
    """Whether what the baseline absorbed of a touch before its detection is given back."""
