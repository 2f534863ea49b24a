# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Effects of a real readout board that an ideal one does not have, as a group of the sensor error model.

Each is off by default, computed only where it is on, and drawn from the seed of the board. `moderate` is the board to
work well on, with all effects at once; `hard` the one on which errors may grow but must be reported. Mains amplitude,
sampling jitter and lost scans belong to the group, too, but are fields of `ErrorModel` itself, which sets them with
`ErrorModel.with_realism`. Every magnitude is assumed: no measurement of a POSFET array with its readout board was
found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_sim.device.error_model_key import Key
from posfet_sim.device.random_streams import Stream, generator


class Draw(IntEnum):
    """Page of `Stream.BOARD` by what is drawn once for a board."""

    TAXELS = 0
    TEMPERATURE_SENSORS = 1
    MISSING_CODES = 2
    MAINS = 3
    STUCK_BIT = 4


@dataclass(frozen=True)
class BoardEffects:
    """Non-idealities of the readout board; 0 switches each one off."""

    sensor_lag: float = 0.0
    """Time constant with which both temperature sensors follow the chip temperature (first order) [s]."""
    sensor_offset: float = 0.0
    """Standard deviation of the constant error of each temperature sensor [K]."""
    third_harmonic: float = 0.0
    """Third harmonic of the mains hum relative to its amplitude [1]."""
    fifth_harmonic: float = 0.0
    """Fifth harmonic of the mains hum relative to its amplitude [1]."""
    frequency_wander: float = 0.0
    """Maximum deviation of the mains frequency, over tens of seconds [Hz]."""
    burst_rate: float = 0.0
    """Mean rate of electromagnetic bursts, each of which disturbs all taxels in a single scan [1/s]."""
    burst_amplitude: float = 0.0
    """Amplitude of a burst at the output of the followers [V]; each taxel samples its ringing at a random phase."""
    telegraph_amplitude: float = 0.0
    """Height of the steps of random telegraph noise at the output of one follower [V]."""
    telegraph_dwell: float = 0.0
    """Mean time between two of its steps, exponentially distributed [s]; 0: no telegraph noise."""
    stuck_bit: int = 0
    """Bit of the ADC codes of one taxel that never changes: bit n has the weight 2^n; 0: none (a stuck least
    significant bit is less than the noise)."""
    missing_codes: float = 0.0
    """Fraction of the codes of the ADC that are missing: the next lower code is read in place of each [1]."""
    taxel_skew: float = 0.0
    """Time from the sampling of the first taxel of a scan to its end [s], at most the scan interval.

    Taxel i of n is sampled i/n of it after the first. Scan, ground truth and temperatures are those at the end.
    """

    @classmethod
    def ideal(cls) -> BoardEffects:
        """Return no effect."""
        return cls()

    @classmethod
    def moderate(cls) -> BoardEffects:
        """Return all effects at moderate size; every value is assumed."""
        return cls(**{level.attribute: level.moderate for level in LEVELS})

    @classmethod
    def hard(cls) -> BoardEffects:
        """Return all effects at the largest size expected; every value is assumed."""
        return cls(**{level.attribute: level.hard for level in LEVELS})

    def without_noise(self) -> BoardEffects:
        """Return the same without anything random from scan to scan."""
        return replace(self, burst_rate=0.0, telegraph_amplitude=0.0)


class Level(NamedTuple):
    """Moderate and hard value of one effect, in SI."""

    attribute: str
    """Field of `BoardEffects`."""
    moderate: Any
    """Moderate value."""
    hard: Any
    """Hard value."""


LEVELS: Final = (
    Level("sensor_lag", 0.1, 1.0),
    Level("sensor_offset", 0.3, 0.3),
    Level("third_harmonic", 0.2, 0.2),
    Level("fifth_harmonic", 0.1, 0.1),
    Level("frequency_wander", 0.1, 0.2),
    Level("burst_rate", 0.1, 0.1),
    Level("burst_amplitude", 20e-3, 50e-3),
    Level("telegraph_amplitude", 1e-3, 3e-3),
    Level("telegraph_dwell", 1.0, 1.0),
    Level("stuck_bit", 1, 7),
    Level("missing_codes", 0.01, 0.03),
    Level("taxel_skew", 0.5e-3, 0.5e-3),
)
"""Moderate and hard value of every effect."""

BOARD_KEYS: Final = (
    Key("temperature_sensors", "lag_s", "sensor_lag", 0.0, 1.0, 0, 100),
    Key("temperature_sensors", "offset_K", "sensor_offset", 0.0, 1.0, 0, 10),
    Key("mains", "third_harmonic_percent", "third_harmonic", 0.0, 1e-2, 0, 100),
    Key("mains", "fifth_harmonic_percent", "fifth_harmonic", 0.0, 1e-2, 0, 100),
    Key("mains", "frequency_wander_Hz", "frequency_wander", 0.0, 1.0, 0, 5),
    Key("interference", "bursts_per_second", "burst_rate", 0.0, 1.0, 0, 100),
    Key("interference", "burst_mV", "burst_amplitude", 0.0, 1e-3, 0, 1000),
    Key("interference", "telegraph_mV", "telegraph_amplitude", 0.0, 1e-3, 0, 1000),
    Key("interference", "telegraph_dwell_s", "telegraph_dwell", 0.0, 1.0, 0, 1000),
    Key("adc", "stuck_bit", "stuck_bit", 0, 1.0, 0, 15),
    Key("adc", "missing_codes_percent", "missing_codes", 0.0, 1e-2, 0, 50),
    Key("clock", "taxel_skew_ms", "taxel_skew", 0.0, 1e-3, 0, 10),
)
"""Keys of the effects in an error model file, in the order of docs/simulation.md."""


class AffectedTaxels(NamedTuple):
    """Taxels that single-taxel effects of a board act on."""

    telegraph: int
    """Index of the taxel with telegraph noise."""
    stuck_bit: int
    """Index of the taxel with the stuck bit; another one, if there is one."""


def affected_taxels(status: NDArray[np.uint8], seed: int) -> AffectedTaxels:
    """Draw the taxels that single-taxel effects act on.

    Parameters
    ----------
    status : numpy.ndarray
        Fault of each taxel, shape [taxels]; taxels without a fault (0) are preferred.
    seed : int
        Seed of the board.

    Returns
    -------
    AffectedTaxels
        Indices of the taxels.
    """
    order = generator(seed, Stream.BOARD, Draw.TAXELS).permutation(status.size)
    order = order[np.argsort(status[order] != 0, kind="stable")]
    return AffectedTaxels(int(order[0]), int(order[min(1, status.size - 1)]))
