"""Signal chain of the array, both ways: force and temperature to ADC counts, and counts back to charge.

    force F [N] -> stress T3 = -F/A [Pa] -> charge density sigma [C/m2], leaking -> gate shift sigma/Cpvdf [V]
    -> follower A0/(1 + A0)*(shift + offset), held between its rails [V] -> noise -> ADC -> counts

The gate shift refers to the gate of the whole stack, where interface charge counts as sigma/Cpvdf. The follower is
static: its time constant (105 ns) is four orders of magnitude below the interval between scans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import FloatArray
from posfet_model.device import adc
from posfet_model.device.charge import invert_first_order_hold, propagate_first_order_hold
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import FULL_SCALE_COUNT

SCALE_BITS: Final = 16
"""Bits of the scale of counts, whatever the resolution of the converter."""

COARSEST_BITS: Final = 12
"""Bits of a count that came over classic CAN: the coarsest step a count can have."""

SATURATION_SIGMAS: Final = 4.0
"""Standard deviations of noise by which a voltage has to stay clear of the end of the range."""


@dataclass(frozen=True)
class LeakageStep:
    """The coefficients of one time step of the leaking charge; the equation is linear, so they are all there is.

    Forward ``sigma1 = decay*sigma0 + mean*(q1 - q0)``, backward ``q1 - q0 = (sigma1 - sigma0)/mean + ratio*sigma0``,
    which is the same because ``1 - decay = ratio*mean``.
    """

    ratio: float
    """h/tau [1]."""
    decay: float
    """exp(-h/tau) [1]."""
    mean: float
    """(1 - exp(-h/tau))/(h/tau) [1]."""


@lru_cache(maxsize=4096)
def leakage_step(step: float, time_constant: float) -> LeakageStep:
    """Return the coefficients of a step [s] for a time constant [s] of the leak, first-order hold.

    They are the answers of `charge.propagate_first_order_hold` and its inverse to unit inputs, kept because a board
    repeats few different steps. Raises ValueError for what those refuse.
    """
    return LeakageStep(
        ratio=float(invert_first_order_hold(1.0, 1.0, step, time_constant)),
        decay=float(propagate_first_order_hold(1.0, 0.0, 0.0, step, time_constant)),
        mean=float(propagate_first_order_hold(0.0, 0.0, 1.0, step, time_constant)),
    )


def charge_per_newton(sensor: Sensor) -> float:
    """Return the charge density that a force on a taxel gives, before any of it leaks: ``-d33/A`` [C/(m2 N)]."""
    return -sensor.device.piezoelectric_coefficient / sensor.layout.taxel_area


def volts_per_count(sensor: Sensor) -> float:
    """Return the voltage of one count of the 16-bit scale [V]."""
    return adc.lsb(SCALE_BITS, sensor.adc.low, sensor.adc.high)


def force_noise_rms(sensor: Sensor) -> float:
    """Return the standard deviation of one reading of a taxel [N]: noise of the input, and of quantisation lsb^2/12.

    Quantisation is taken as noise independent from scan to scan. Where a step is much larger than the noise it is not,
    but then its error at rest, before and after a touch, is the same and cancels.
    """
    bits = sensor.adc.bits if sensor.can.fd else min(sensor.adc.bits, COARSEST_BITS)
    step = adc.lsb(bits, sensor.adc.low, sensor.adc.high)
    return math.sqrt(sensor.adc.noise**2 + step**2 / 12) / sensor.volts_per_newton


class ForwardSignalChain:
    """The array as a device: forces [N] and film temperature [degC] in, ADC counts out.

    It starts without force, all charge leaked; the first temperature given is the one at which there is no pyroelectric
    charge. Between two calls of `advance` force and temperature move in a straight line, and the charge is exact for
    that, whatever the step. Not simulated: dynamics of the follower, crosstalk, mismatch, 1/f noise, hysteresis.
    """

    def __init__(self, sensor: Sensor, rng: np.random.Generator | None = None) -> None:
        """Make the array of `sensor`; without `rng` there is no noise."""
        taxels = sensor.layout.taxels
        self._sensor = sensor
        self._rng = rng
        self._charge_per_newton = charge_per_newton(sensor)
        self._step_volts = adc.lsb(sensor.adc.bits, sensor.adc.low, sensor.adc.high)
        self._reference_temperature = math.nan
        self._charge = np.zeros(taxels)
        self._source = np.zeros(taxels)
        self._next_source = np.zeros(taxels)
        self._volts = np.zeros(taxels)
        self._noise = np.zeros(taxels)
        self._codes = np.zeros(taxels, np.uint16)

    @property
    def charge(self) -> NDArray[np.float64]:
        """Charge density sigma [C/m2] left at each gate, shape [rows * cols]; overwritten by the next `advance`."""
        return self._charge

    def advance(self, force: FloatArray, film_temperature: float, step: float) -> None:
        """Move on by `step` [s] to the time at which `force` [N], shape [rows * cols], and the temperature [degC] hold.

        Raises ValueError when a force or the temperature is not finite, for another shape, or a step outside
        [1e-12, 1e9] s.
        """
        if force.shape != self._charge.shape:
            raise ValueError(f"force must have shape {self._charge.shape}, got {force.shape}")
        if math.isnan(self._reference_temperature):
            self._reference_temperature = film_temperature
        pyroelectric = self._sensor.device.pyroelectric_coefficient
        np.multiply(force, self._charge_per_newton, out=self._next_source)
        self._next_source += pyroelectric * (film_temperature - self._reference_temperature)
        if not math.isfinite(self._next_source.sum()):
            raise ValueError("force and film_temperature must be finite")
        leak = leakage_step(step, self._sensor.device.leak_time_constant)
        np.subtract(self._next_source, self._source, out=self._source)
        self._source *= leak.mean
        self._charge *= leak.decay
        self._charge += self._source
        self._source, self._next_source = self._next_source, self._source

    def volts(self, out: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Return the output of the followers [V], shape [rows * cols], noise not included."""
        amplifier = self._sensor.amplifier
        volts = np.divide(self._charge, self._sensor.device.film_capacitance, out=out)
        volts += amplifier.offset
        volts *= amplifier.follower_gain
        np.minimum(volts, amplifier.rail_high, out=volts)
        np.maximum(volts, amplifier.rail_low, out=volts)
        return volts

    def counts(self, out: NDArray[np.uint16] | None = None) -> NDArray[np.uint16]:
        """Return one conversion, shape [rows * cols], on the 16-bit scale; each call draws new noise.

        Codes are those of `adc.volts_to_counts`. A converter of fewer bits has its code repeated into the low bits, so
        that its last code is 65535.
        """
        converter = self._sensor.adc
        codes = self.volts(self._volts)
        if self._rng is not None and converter.noise > 0:
            self._rng.standard_normal(out=self._noise)
            self._noise *= converter.noise
            codes += self._noise
        codes -= converter.low
        codes /= self._step_volts
        np.rint(codes, out=codes)
        np.maximum(codes, 0, out=codes)
        np.minimum(codes, (1 << converter.bits) - 1, out=codes)
        result = self._codes.copy() if out is None else out
        np.copyto(result, codes, casting="unsafe")
        if converter.bits < SCALE_BITS:
            np.right_shift(result, 2 * converter.bits - SCALE_BITS, out=self._codes)
            np.left_shift(result, SCALE_BITS - converter.bits, out=result)
            np.bitwise_or(result, self._codes, out=result)
        return result


READING: Final = np.dtype([("charge", np.float64), ("saturated", np.bool_)], align=True)
"""What a count tells: charge density sigma [C/m2], and whether it may have been clipped."""


class InverseSignalChain:
    """Counts back to charge, by tables of all 65536 counts; the inverse of `ForwardSignalChain.counts`.

    The nominal offset of the amplifier is taken off; what is left of it is for the observer to find.
    """

    def __init__(self, sensor: Sensor) -> None:
        amplifier, converter = sensor.amplifier, sensor.adc
        volts = adc.counts_to_volts(np.arange(FULL_SCALE_COUNT + 1), SCALE_BITS, converter.low, converter.high)
        capacitance = sensor.device.film_capacitance
        self._charge = (volts / amplifier.follower_gain - amplifier.offset) * capacitance
        coarsest = adc.lsb(min(COARSEST_BITS, converter.bits), converter.low, converter.high)
        margin = SATURATION_SIGMAS * converter.noise + coarsest
        self._saturated = (volts <= max(amplifier.rail_low, converter.low) + margin) | (
            volts >= min(amplifier.rail_high, converter.high) - margin
        )
        usable = self._charge[~self._saturated]
        if not usable.size:
            raise ValueError("adc.noise must leave a usable range between the ends of ADC and amplifier")
        self.charge_range = float(usable[0]), float(usable[-1])
        """Charge densities [C/m2] between which nothing is clipped."""
        self._readings = np.zeros(len(volts), READING)
        self._readings["charge"], self._readings["saturated"] = self._charge, self._saturated

    def charge(self, counts: NDArray[np.uint16], out: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the charge density sigma [C/m2] behind each count, in `out` and of its shape."""
        return self._charge.take(counts, out=out, mode="clip")

    def read(self, counts: NDArray[np.uint16], out: NDArray[np.void]) -> NDArray[np.void]:
        """Return both in `out`, of type `READING`: one look at the table costs as much as the other."""
        return self._readings.take(counts, out=out, mode="clip")

    def saturated(self, counts: NDArray[np.uint16], out: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return, in `out`, where the voltage is so near an end of the range that it may have been clipped."""
        return self._saturated.take(counts, out=out, mode="clip")
