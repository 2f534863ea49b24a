"""Noise of the read-out: thermal, 1/f and quantisation noise, and the smallest force that stands out of them.

Spectra are one-sided densities [V2/Hz]. Sources are independent, so densities and mean squares add.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model.checks import FloatArray, real_array, real_number, whole_number
from posfet_model.constants import BOLTZMANN

CHANNEL_FACTOR: Final = 2 / 3
"""Thermal noise of a long channel in saturation, in units of 4*k*T*gm (van der Ziel)."""

TEMPERATURE_RANGE: Final = (1.0, 1000.0)
"""Accepted temperatures [K]."""

FREQUENCY_RANGE: Final = (1e-12, 1e15)
"""Accepted frequencies [Hz]."""

DENSITY_LIMIT: Final = 1e6
"""Largest accepted density [V2/Hz] or flicker coefficient [V2]."""


def resistor_density(resistance: ArrayLike, temperature: ArrayLike) -> FloatArray:
    """Return the density ``4*k*T*R`` [V2/Hz] of a resistor's open-circuit voltage (Nyquist 1928).

    resistance [ohm] in [0, 1e18]; temperature [K] in [1, 1000]; shapes broadcast. Raises ValueError otherwise.

    >>> print(f"{resistor_density(1e3, 300.0):.4g}")
    1.657e-17
    """
    ohms = real_array("resistance", resistance, 0, 1e18)
    return 4 * BOLTZMANN * real_array("temperature", temperature, *TEMPERATURE_RANGE) * ohms


def pair_density(
    input_transconductance: ArrayLike, load_transconductance: ArrayLike, temperature: ArrayLike
) -> FloatArray:
    """Return the thermal density [V2/Hz] at the input of a differential pair with a current-mirror load.

    ``2*(4*k*T*(2/3)/gm1)*(1 + gm3/gm1)``: two input and two load transistors; the tail current is common to both sides.

    Parameters
    ----------
    input_transconductance, load_transconductance : gm1, gm3 [S], in [1e-12, 1e3] and [0, 1e3].
    temperature : T [K], in [1, 1000].

    Raises
    ------
    ValueError : an argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    gm1 = real_array("input_transconductance", input_transconductance, 1e-12, 1e3)
    gm3 = real_array("load_transconductance", load_transconductance, 0, 1e3)
    kelvin = real_array("temperature", temperature, *TEMPERATURE_RANGE)
    return 8 * BOLTZMANN * CHANNEL_FACTOR * kelvin / gm1 * (1 + gm3 / gm1)


def flicker_density(coefficient: ArrayLike, frequency: ArrayLike) -> FloatArray:
    """Return the density ``K/f`` [V2/Hz] of 1/f noise; K [V2] in [0, 1e6], f [Hz] in [1e-12, 1e15]."""
    volts2 = real_array("coefficient", coefficient, 0, DENSITY_LIMIT)
    return volts2 / real_array("frequency", frequency, *FREQUENCY_RANGE)


def white_rms(density: float, low: float, high: float) -> float:
    """Return the rms [V] of white noise between two frequencies: ``sqrt(S*(high - low))``.

    density S [V2/Hz] in [0, 1e6]; 0 <= low < high <= 1e15 Hz. Raises ValueError otherwise. For a low-pass of one pole
    at f1 take high = f1*pi/2.
    """
    level = real_number("density", density, 0, DENSITY_LIMIT)
    low = real_number("low", low, 0, FREQUENCY_RANGE[1])
    high = real_number("high", high, math.nextafter(low, math.inf), FREQUENCY_RANGE[1])
    return math.sqrt(level * (high - low))


def flicker_rms(coefficient: float, low: float, high: float) -> float:
    """Return the rms [V] of 1/f noise between two frequencies: ``sqrt(K*ln(high/low))``.

    coefficient K [V2] in [0, 1e6]; 1e-12 <= low < high <= 1e15 Hz: 1/f noise from 0 Hz has no finite power. A record of
    t seconds sees about low = 1/t. Raises ValueError otherwise.
    """
    volts2 = real_number("coefficient", coefficient, 0, DENSITY_LIMIT)
    low = real_number("low", low, *FREQUENCY_RANGE)
    high = real_number("high", high, math.nextafter(low, math.inf), FREQUENCY_RANGE[1])
    return math.sqrt(volts2 * math.log1p((high - low) / low))


def quantisation_rms(lsb: float) -> float:
    """Return the rms [V] of the rounding to steps of `lsb` [V], in [0, 1e6]: ``lsb/sqrt(12)``.

    Holds when the signal and its noise move over half a step or more, so that the error is spread evenly.
    """
    return real_number("lsb", lsb, 0, 1e6) / math.sqrt(12)


def flicker_sequence(
    coefficient: float, rate: float, samples: int, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return a record of Gaussian 1/f noise [V], shape [samples], with the density K/f.

    Parameters
    ----------
    coefficient : K [V2], in [0, 1e6].
    rate : sampling rate [Hz], in [1e-9, 1e12].
    samples : length of the record, in [2, 2**26].
    generator : source of random numbers; a seeded one gives the same record again.

    Raises
    ------
    ValueError : an argument is out of range.

    Notes
    -----
    Made in the frequency domain: at each frequency m*rate/samples, 0 < m <= samples/2, the expected periodogram is
    exactly K/f (spectrum error 0, each single one scattered by 100 % as for any noise). There is no power below
    rate/samples, so the mean is 0, and the record runs back into its beginning: make it longer than what is used.
    """
    volts2 = real_number("coefficient", coefficient, 0, DENSITY_LIMIT)
    rate = real_number("rate", rate, 1e-9, 1e12)
    samples = whole_number("samples", samples, 2, 2**26)
    order = np.arange(1, samples // 2 + 1)
    # Mean square of each complex amplitude: density*rate*samples/2, halved once more for real and imaginary part. The
    # bin at rate/2, there for an even number of samples, is real and stands for half a bin's width.
    scale = np.sqrt(volts2 / (order * rate / samples) * rate * samples / 4)
    spectrum = np.zeros(samples // 2 + 1, np.complex128)
    spectrum[1:] = scale * (generator.standard_normal(order.size) + 1j * generator.standard_normal(order.size))
    if samples % 2 == 0:
        spectrum[-1] = spectrum[-1].real * math.sqrt(2)
    return np.fft.irfft(spectrum, samples)


def volts_per_newton(piezoelectric_coefficient: ArrayLike, area: ArrayLike, capacitance: ArrayLike) -> FloatArray:
    """Return the gate shift per force [V/N]: ``|d33|/(A*C)``.

    Parameters
    ----------
    piezoelectric_coefficient : d33 [C/N], within +-1e-6.
    area : A [m2] that the force acts on, in [1e-18, 1e4].
    capacitance : C [F/m2] of the plane that the voltage is counted at (`Stack.charge_divisor`), in [1e-12, 1e3].

    Raises
    ------
    ValueError : an argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    d33 = np.abs(real_array("piezoelectric_coefficient", piezoelectric_coefficient, -1e-6, 1e-6))
    square_metres = real_array("area", area, 1e-18, 1e4)
    return d33 / (square_metres * real_array("capacitance", capacitance, 1e-12, 1e3))


@dataclass(frozen=True)
class NoiseBudget:
    """Noise at the gate in a band, by source."""

    thermal: float
    """[V rms]"""
    flicker: float
    """[V rms]"""
    quantisation: float
    """[V rms]"""
    volts_per_newton: float
    """Gate shift per force [V/N]."""

    @property
    def total(self) -> float:
        """All sources together [V rms]."""
        return math.hypot(self.thermal, self.flicker, self.quantisation)

    def minimum_force(self, sigmas: float = 3.0) -> float:
        """Return the force [N] whose gate shift is `sigmas` times the total rms; inf when force gives no voltage.

        sigmas is in (0, 100]. A change of force within the band is meant: a held force leaks away.
        """
        factor = real_number("sigmas", sigmas, 1e-3, 100)
        return factor * self.total / self.volts_per_newton if self.volts_per_newton else math.inf


def noise_budget(
    thermal_density: float,
    flicker_coefficient: float,
    lsb: float,
    volts_per_newton: float,
    low: float,
    high: float,
    gain: float = 1.0,
) -> NoiseBudget:
    """Return the noise referred to the gate in the band low..high [Hz].

    Parameters
    ----------
    thermal_density : at the gate [V2/Hz], in [0, 1e6].
    flicker_coefficient : K at the gate [V2], in [0, 1e6].
    lsb : step of the converter behind the follower [V], in [0, 1e6]; its whole noise is counted into the band.
    volts_per_newton : gate shift per force [V/N], in [0, 1e12].
    low, high : ends of the band [Hz], 1e-12 <= low < high <= 1e15.
    gain : of the follower [V/V], in [1e-3, 1e3].

    Raises
    ------
    ValueError : an argument is not real, not finite or out of range.
    """
    return NoiseBudget(
        thermal=white_rms(thermal_density, low, high),
        flicker=flicker_rms(flicker_coefficient, low, high),
        quantisation=quantisation_rms(lsb) / real_number("gain", gain, 1e-3, 1e3),
        volts_per_newton=real_number("volts_per_newton", volts_per_newton, 0, 1e12),
    )
