# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Taxel-to-taxel variation of one simulated board, drawn once from its seed."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import FULL_SCALE_COUNT
from posfet_model.sensor.signal_chain import charge_per_newton
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.random_streams import Stream, generator

MIN_FACTOR: Final = 0.1
"""Lower limit of gain and area relative to nominal [1]."""


class TaxelStatus(IntEnum):
    """Fault of a taxel; the values are those of TAXEL_* in posfet_msgs/TactileImage."""

    OK = 0
    DEAD = 1
    STUCK = 2


@dataclass(frozen=True, eq=False)
class TaxelParameters:
    """Properties of each taxel; every field has shape [rows * cols]."""

    charge_per_newton: NDArray[np.float64]
    """Charge density per force [C/(m2 N)]; 0 for a dead taxel."""
    charge_per_kelvin: NDArray[np.float64]
    """Charge density per film temperature [C/(m2 K)]; 0 for a dead taxel."""
    leak_time_constant: NDArray[np.float64]
    """Leakage time constant [s]."""
    volts_per_charge: NDArray[np.float64]
    """Output of the follower per charge density at the gate [V m2/C], including gain and its spread."""
    offset: NDArray[np.float64]
    """Output without charge [V]."""
    hum: NDArray[np.float64]
    """Amplitude of the mains hum at the output [V]."""
    noise_factor: NDArray[np.float64]
    """White noise relative to a normal taxel [1]; 0 for a stuck one."""
    status: NDArray[np.uint8]
    """Fault, a TaxelStatus."""
    stuck_counts: NDArray[np.uint16]
    """Code of a stuck taxel, on the 16-bit scale; 0 for the others."""

    def single_precision(self) -> TaxelParameters:
        """Return the same in float32."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        floats = {name: value.astype(np.float32) for name, value in values.items() if value.dtype == np.float64}
        return replace(self, **floats)


def draw_taxel_parameters(sensor: Sensor, error_model: ErrorModel, seed: int) -> TaxelParameters:
    """Draw the taxels of a board.

    Parameters
    ----------
    sensor : Sensor
        Sensor description with the nominal values.
    error_model : ErrorModel
        Spreads and fault probabilities.
    seed : int
        Seed of the board; each property has its own random stream.

    Returns
    -------
    TaxelParameters
        Properties of each taxel, in float64.
    """
    taxels = sensor.layout.taxels
    device, amplifier = sensor.device, sensor.amplifier
    ones = np.ones(taxels)

    def around_one(stream: Stream, spread: float) -> NDArray[np.float64]:
        values = 1 + spread * generator(seed, stream).standard_normal(taxels)
        return np.maximum(values, MIN_FACTOR)

    status, noise_factor, stuck_counts = _faults(error_model, taxels, seed)
    alive = status != TaxelStatus.DEAD
    gain = amplifier.follower_gain if error_model.amplifier_gain else 1.0
    offset = amplifier.offset * error_model.amplifier_offset + error_model.offset_spread * generator(
        seed, Stream.OFFSET
    ).standard_normal(taxels)
    return TaxelParameters(
        charge_per_newton=alive * charge_per_newton(sensor) / around_one(Stream.AREA, error_model.area_spread),
        charge_per_kelvin=alive * (device.pyroelectric_coefficient * error_model.pyroelectric) * ones,
        leak_time_constant=device.leak_time_constant
        * np.exp(error_model.leak_spread * generator(seed, Stream.LEAKAGE).standard_normal(taxels)),
        volts_per_charge=gain / device.film_capacitance * around_one(Stream.GAIN, error_model.gain_spread),
        offset=gain * offset,
        hum=gain * error_model.hum_amplitude * around_one(Stream.HUM, 0.2),
        noise_factor=noise_factor,
        status=status,
        stuck_counts=stuck_counts,
    )


def _faults(
    error_model: ErrorModel, taxels: int, seed: int
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.uint16]]:
    """Return status, noise factor and stuck counts of each taxel."""
    source = generator(seed, Stream.TAXEL_FAULTS)
    chance = source.random((3, taxels))
    codes = source.integers(0, FULL_SCALE_COUNT, taxels, dtype=np.uint16, endpoint=True)
    status = np.zeros(taxels, np.uint8)
    status[chance[0] < error_model.dead_probability] = TaxelStatus.DEAD
    stuck = chance[1] < error_model.stuck_probability
    status[stuck] = TaxelStatus.STUCK
    noise = np.where(chance[2] < error_model.noisy_probability, error_model.noisy_factor, 1.0)
    return status, np.where(stuck, 0.0, noise), np.where(stuck, codes, 0).astype(np.uint16)
