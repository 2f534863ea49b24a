# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Signal chain of the array, forward and inverse: force and temperature to ADC counts, and counts back to charge.

    force F [N] -> stress T3 = -F/A [Pa] -> charge density sigma [C/m2], leaking -> gate shift sigma/Cpvdf [V]
    -> follower A0/(1 + A0)*(shift + offset), limited by its rails [V] -> noise -> ADC -> counts

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
from posfet_model.sensor.description import COARSEST_BITS, Sensor
from posfet_model.sensor.scan import FULL_SCALE_COUNT

SCALE_BITS: Final = 16
"""Bits of the scale of counts, whatever the resolution of the ADC."""


@dataclass(frozen=True, eq=False)
class LeakageStep:
    """The coefficients of one time step of the leaking charge, a linear equation.

    Forward ``sigma1 = decay*sigma0 + mean*(q1 - q0)``; inverse ``q1 - q0 = (sigma1 - sigma0)/mean + ratio*sigma0``,
    equivalent because ``1 - decay = ratio*mean``.
    """

    ratio: float
    """h/tau [1]."""
    decay: float
    """exp(-h/tau) [1]."""
    mean: float
    """(1 - exp(-h/tau))/(h/tau) [1]."""


@lru_cache(maxsize=4096)
def leakage_step(step: float, time_constant: float) -> LeakageStep:
    """Return the coefficients of one step with a first-order hold.

    They are the responses of `charge.propagate_first_order_hold` and its inverse to unit inputs. They are cached,
    because a board repeats few different steps.

    Parameters
    ----------
    step : float
        h [s], in [1e-12, 1e9].
    time_constant : float
        Leakage time constant tau [s], in [1e-12, 1e15].

    Returns
    -------
    LeakageStep
        Forward and inverse coefficients.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range.
    """
    return LeakageStep(
        ratio=float(invert_first_order_hold(1.0, 1.0, step, time_constant)),
        decay=float(propagate_first_order_hold(1.0, 0.0, 0.0, step, time_constant)),
        mean=float(propagate_first_order_hold(0.0, 0.0, 1.0, step, time_constant)),
    )


def charge_per_newton(sensor: Sensor) -> float:
    """Return the charge density per force on a taxel, before leakage: ``-d33/A``.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.

    Returns
    -------
    float
        Charge density per force [C/(m2 N)].
    """
    return -sensor.device.piezoelectric_coefficient / sensor.layout.taxel_area


def volts_per_count(sensor: Sensor) -> float:
    """Return the voltage of one count of the 16-bit scale.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.

    Returns
    -------
    float
        Voltage of one count [V].
    """
    return adc.lsb(SCALE_BITS, sensor.adc.low, sensor.adc.high)


def volts_per_code(sensor: Sensor) -> float:
    """Return the step between two codes as they are sent.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.

    Returns
    -------
    float
        Step [V].
    """
    bits = sensor.adc.bits if sensor.can.fd else min(sensor.adc.bits, COARSEST_BITS)
    return adc.lsb(bits, sensor.adc.low, sensor.adc.high)


def force_noise_rms(sensor: Sensor) -> float:
    """Return the standard deviation of one reading of a taxel: input noise and quantisation noise lsb^2/12.

    Quantisation noise is assumed independent from scan to scan. It is not where a step is much larger than the noise,
    but then the quantisation error at rest is the same before and after a touch, and cancels, or the signal switches
    between two codes, with up to three times this variance: the reconstruction measures that.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.

    Returns
    -------
    float
        Standard deviation of the force [N].
    """
    return math.sqrt(sensor.adc.noise**2 + volts_per_code(sensor) ** 2 / 12) / sensor.volts_per_newton


class ForwardSignalChain:
    """Forward model of the array: forces [N] and film temperature [degC] in, ADC counts out.

    It starts without force and without charge; the first temperature is the reference of the pyroelectric charge.
    Between two calls of `advance` force and temperature are linear in time (first-order hold), and the charge is exact
    for steps of any length. Not simulated: dynamics of the follower, crosstalk, mismatch, 1/f noise, hysteresis.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.
    rng : numpy.random.Generator, optional
        Source of the noise; without it there is none.
    """

    def __init__(self, sensor: Sensor, rng: np.random.Generator | None = None) -> None:
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
        """Advance by one step.

        Parameters
        ----------
        force : ndarray
            Force on each taxel at the end of the step [N], shape [rows * cols].
        film_temperature : float
            Temperature of the film at the end of the step [degC].
        step : float
            h [s], in [1e-12, 1e9].

        Raises
        ------
        ValueError
            The force has another shape, a force or the temperature is not finite, or the step is out of range.
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
        """Return the output of the followers without noise.

        Parameters
        ----------
        out : ndarray, optional
            Array for the result, float64, shape [rows * cols].

        Returns
        -------
        ndarray
            Output voltage [V], shape [rows * cols].
        """
        amplifier = self._sensor.amplifier
        volts = np.divide(self._charge, self._sensor.device.film_capacitance, out=out)
        volts += amplifier.offset
        volts *= amplifier.follower_gain
        np.minimum(volts, amplifier.rail_high, out=volts)
        np.maximum(volts, amplifier.rail_low, out=volts)
        return volts

    def counts(self, out: NDArray[np.uint16] | None = None) -> NDArray[np.uint16]:
        """Return one conversion on the 16-bit scale; each call draws new noise.

        Codes are those of `adc.volts_to_counts`. The code of an ADC of fewer bits is repeated into the low bits, so
        that its highest code becomes 65535.

        Parameters
        ----------
        out : ndarray, optional
            Array for the result, uint16, shape [rows * cols].

        Returns
        -------
        ndarray
            Counts, uint16, shape [rows * cols].
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


class InverseSignalChain:
    """Counts back to charge by lookup tables of all 65536 counts; the inverse of `ForwardSignalChain.counts`.

    The nominal offset of the amplifier is subtracted; the estimator finds the remaining offset online.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.

    Raises
    ------
    ValueError
        The noise leaves no usable range between the ends of ADC and amplifier.
    """

    def __init__(self, sensor: Sensor) -> None:
        amplifier, converter = sensor.amplifier, sensor.adc
        volts = adc.counts_to_volts(np.arange(FULL_SCALE_COUNT + 1), SCALE_BITS, converter.low, converter.high)
        capacitance = sensor.device.film_capacitance
        self._charge = (volts / amplifier.follower_gain - amplifier.offset) * capacitance
        margin = sensor.saturation_margin
        self._saturated = (volts <= max(amplifier.rail_low, converter.low) + margin) | (
            volts >= min(amplifier.rail_high, converter.high) - margin
        )
        usable = self._charge[~self._saturated]
        if not usable.size:
            raise ValueError("adc.noise must leave a usable range between the ends of ADC and amplifier")
        self.charge_range = float(usable[0]), float(usable[-1])
        """Charge densities [C/m2] between which nothing is clipped."""

    def charge(self, counts: NDArray[np.uint16], out: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the charge density of each count.

        Parameters
        ----------
        counts : ndarray
            Counts, uint16, any shape.
        out : ndarray
            Array for the result, float64, of the same shape.

        Returns
        -------
        ndarray
            Charge density sigma [C/m2].
        """
        return self._charge.take(counts, out=out, mode="clip")

    @property
    def saturated_counts(self) -> tuple[int, int]:
        """Greatest saturated count at the low end, -1 for none, and least one at the high end, 65536 for none."""
        usable = np.flatnonzero(~self._saturated)
        return int(usable[0]) - 1, int(usable[-1]) + 1

    def saturated(self, counts: NDArray[np.uint16], out: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return where the voltage is so close to an end of the range that it may have been clipped.

        Parameters
        ----------
        counts : ndarray
            Counts, uint16, any shape.
        out : ndarray
            Array for the result, bool, of the same shape.

        Returns
        -------
        ndarray
            Mask of the saturated counts.
        """
        return self._saturated.take(counts, out=out, mode="clip")
