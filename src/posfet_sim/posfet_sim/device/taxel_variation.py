"""How the taxels of one simulated board differ: drawn once from its seed."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import FULL_SCALE_COUNT
from posfet_model.sensor.signal_chain import charge_per_newton
from posfet_sim.device.imperfections import Imperfections
from posfet_sim.device.random_streams import Stream, generator

SMALLEST: Final = 0.1
"""No gain or area is drawn below this share of its nominal value."""


class TaxelStatus(IntEnum):
    """What is wrong with a taxel; the values are those of TAXEL_* in posfet_msgs/TactileImage."""

    OK = 0
    DEAD = 1
    STUCK = 2


@dataclass(frozen=True, eq=False)
class TaxelSpread:
    """Properties of each taxel, every field of shape [rows * cols]."""

    charge_per_newton: NDArray[np.float64]
    """Charge density per force [C/(m2 N)]; 0 for a dead taxel."""
    charge_per_kelvin: NDArray[np.float64]
    """Charge density per film temperature [C/(m2 K)]; 0 for a dead taxel."""
    leak_time_constant: NDArray[np.float64]
    """[s]"""
    volts_per_charge: NDArray[np.float64]
    """Output of the follower per charge density at the gate [V m2/C], gain and its spread included."""
    offset: NDArray[np.float64]
    """Output at no charge [V]."""
    hum: NDArray[np.float64]
    """Amplitude of the mains hum at the output [V]."""
    noise_factor: NDArray[np.float64]
    """White noise over that of a usual taxel [1]; 0 for a stuck one."""
    status: NDArray[np.uint8]
    """TaxelStatus."""
    stuck_counts: NDArray[np.uint16]
    """What a stuck taxel shows, on the 16-bit scale; 0 for the others."""

    def narrow(self) -> TaxelSpread:
        """Return the same in float32."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        floats = {name: value.astype(np.float32) for name, value in values.items() if value.dtype == np.float64}
        return replace(self, **floats)


def draw_spread(sensor: Sensor, imperfections: Imperfections, seed: int) -> TaxelSpread:
    """Return the taxels of the board with this seed; each property has random numbers of its own."""
    taxels = sensor.layout.taxels
    device, amplifier = sensor.device, sensor.amplifier
    ones = np.ones(taxels)

    def around_one(stream: Stream, spread: float) -> NDArray[np.float64]:
        values = 1 + spread * generator(seed, stream).standard_normal(taxels)
        return np.maximum(values, SMALLEST)

    status, noise_factor, stuck_counts = _faults(imperfections, taxels, seed)
    alive = status != TaxelStatus.DEAD
    gain = amplifier.follower_gain if imperfections.amplifier_gain else 1.0
    offset = amplifier.offset * imperfections.amplifier_offset + imperfections.offset_spread * generator(
        seed, Stream.OFFSET
    ).standard_normal(taxels)
    return TaxelSpread(
        charge_per_newton=alive * charge_per_newton(sensor) / around_one(Stream.AREA, imperfections.area_spread),
        charge_per_kelvin=alive * (device.pyroelectric_coefficient * imperfections.pyroelectric) * ones,
        leak_time_constant=device.leak_time_constant
        * np.exp(imperfections.leak_spread * generator(seed, Stream.LEAK).standard_normal(taxels)),
        volts_per_charge=gain / device.film_capacitance * around_one(Stream.GAIN, imperfections.gain_spread),
        offset=gain * offset,
        hum=gain * imperfections.hum_amplitude * around_one(Stream.HUM, 0.2),
        noise_factor=noise_factor,
        status=status,
        stuck_counts=stuck_counts,
    )


def _faults(
    imperfections: Imperfections, taxels: int, seed: int
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.uint16]]:
    """Return status, noise factor and stuck counts of each taxel."""
    source = generator(seed, Stream.FAULTS)
    chance = source.random((3, taxels))
    codes = source.integers(0, FULL_SCALE_COUNT, taxels, dtype=np.uint16, endpoint=True)
    status = np.zeros(taxels, np.uint8)
    status[chance[0] < imperfections.dead_share] = TaxelStatus.DEAD
    stuck = chance[1] < imperfections.stuck_share
    status[stuck] = TaxelStatus.STUCK
    noise = np.where(chance[2] < imperfections.noisy_share, imperfections.noisy_factor, 1.0)
    return status, np.where(stuck, 0.0, noise), np.where(stuck, codes, 0).astype(np.uint16)
