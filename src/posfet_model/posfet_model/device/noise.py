"""Noise of the read-out: bias resistor, amplifier, 1/f and quantisation, and the smallest force that stands out.

Spectra are one-sided densities [V2/Hz]. Sources are independent, so densities and mean squares add.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import common_dtype, instance, real_array, real_number, whole_number
from posfet_model.device.constants import BOLTZMANN

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
    ohms, kelvin = common_dtype(
        resistance=real_array("resistance", resistance, 0, 1e18),
        temperature=real_array("temperature", temperature, *TEMPERATURE_RANGE),
    )
    return 4 * BOLTZMANN * kelvin * ohms


def pair_density(
    input_transconductance: ArrayLike, load_transconductance: ArrayLike, temperature: ArrayLike
) -> FloatArray:
    """Return the thermal density [V2/Hz] at the input of a differential pair with a current-mirror load.

    ``2*(4*k*T*(2/3)/gm1)*(1 + gm3/gm1)``: two input and two load transistors; the tail current is common to both sides.

    Parameters
    ----------
    input_transconductance, load_transconductance : array_like
        gm1, gm3 [S], in [1e-12, 1e3] and [0, 1e3].
    temperature : array_like
        T [K], in [1, 1000].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    gm1, gm3, kelvin = common_dtype(
        input_transconductance=real_array("input_transconductance", input_transconductance, 1e-12, 1e3),
        load_transconductance=real_array("load_transconductance", load_transconductance, 0, 1e3),
        temperature=real_array("temperature", temperature, *TEMPERATURE_RANGE),
    )
    return 8 * BOLTZMANN * CHANNEL_FACTOR * kelvin / gm1 * (1 + gm3 / gm1)


def flicker_density(coefficient: ArrayLike, frequency: ArrayLike) -> FloatArray:
    """Return the density ``K/f`` [V2/Hz] of 1/f noise; K [V2] in [0, 1e6], f [Hz] in [1e-12, 1e15]."""
    volts2, hertz = common_dtype(
        coefficient=real_array("coefficient", coefficient, 0, DENSITY_LIMIT),
        frequency=real_array("frequency", frequency, *FREQUENCY_RANGE),
    )
    return volts2 / hertz


def white_rms(density: float, low: float, high: float) -> float:
    """Return the rms [V] of white noise between two frequencies: ``sqrt(S*(high - low))``.

    density S [V2/Hz] in [0, 1e6]; 0 <= low < high <= 1e15 Hz. Raises ValueError otherwise. For a low-pass of one pole
    at f1 take high = f1*pi/2.
    """
    level = real_number("density", density, 0, DENSITY_LIMIT)
    low = real_number("low", low, 0, FREQUENCY_RANGE[1])
    high = real_number("high", high, math.nextafter(low, math.inf), FREQUENCY_RANGE[1])
    return math.sqrt(level * (high - low))


def bias_resistor_rms(resistance: float, capacitance: float, temperature: float, low: float, high: float) -> float:
    """Return the rms [V] between two frequencies that a resistor makes on the capacitance it charges.

    ``sqrt(k*T/C*2/pi*(arctan(2*pi*high*R*C) - arctan(2*pi*low*R*C)))``: Nyquist's density 4*k*T*R through the low pass
    of R and C, ``S(f) = 4*k*T*R/(1 + (2*pi*f*R*C)^2)``, integrated.

    Parameters
    ----------
    resistance : float
        R [ohm], in [1, 1e18].
    capacitance : float
        C [F] of the gate, in [1e-18, 1].
    temperature : float
        T [K], in [1, 1000].
    low, high : float
        Ends of the band [Hz], 0 <= low < high <= 1e15.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range.

    Notes
    -----
    Over all frequencies it is sqrt(k*T/C), whatever R (B. Razavi, *Design of Analog CMOS Integrated Circuits*, chapter
    on noise). R sets where it lies: a larger one moves it below the band, and the mean square in a band far above the
    corner falls as 1/R.

    Examples
    --------
    10 Gohm on 26.6 pF, in a band that holds nearly all of it:

    >>> print(f"{bias_resistor_rms(10e9, 26.6e-12, 300.0, 0.1, 1000.0) * 1e6:.1f} uV")
    11.8 uV
    """
    ohms = real_number("resistance", resistance, 1, 1e18)
    farad = real_number("capacitance", capacitance, 1e-18, 1)
    kelvin = real_number("temperature", temperature, *TEMPERATURE_RANGE)
    low = real_number("low", low, 0, FREQUENCY_RANGE[1])
    high = real_number("high", high, math.nextafter(low, math.inf), FREQUENCY_RANGE[1])
    turn = 2 * math.pi * ohms * farad
    # The difference of the arctangents, without cancellation.
    angle = math.atan2(turn * (high - low), 1 + turn * low * turn * high)
    return math.sqrt(BOLTZMANN * kelvin / farad * 2 / math.pi * angle)


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
    coefficient : float
        K [V2], in [0, 1e6].
    rate : float
        sampling rate [Hz], in [1e-9, 1e12].
    samples : int
        length of the record, in [2, 2**26].
    generator : np.random.Generator
        source of random numbers; a seeded one gives the same record again.

    Raises
    ------
    ValueError
        An argument is out of range, or the generator is none.

    Notes
    -----
    Made in the frequency domain: at each frequency m*rate/samples, 0 < m <= samples/2, the expected periodogram is
    exactly K/f (spectrum error 0, each single one scattered by 100 % as for any noise). There is no power below
    rate/samples, so the mean is 0, and the record runs back into its beginning: make it longer than what is used.
    """
    volts2 = real_number("coefficient", coefficient, 0, DENSITY_LIMIT)
    rate = real_number("rate", rate, 1e-9, 1e12)
    samples = whole_number("samples", samples, 2, 2**26)
    generator = instance("generator", generator, np.random.Generator)
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
    piezoelectric_coefficient : array_like
        d33 [C/N], within +-1e-6.
    area : array_like
        A [m2] that the force acts on, in [1e-18, 1e4].
    capacitance : array_like
        C [F/m2] of the plane that the voltage is counted at (`Stack.charge_divisor`), in [1e-12, 1e3].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    d33, square_metres, farad_per_m2 = common_dtype(
        piezoelectric_coefficient=real_array("piezoelectric_coefficient", piezoelectric_coefficient, -1e-6, 1e-6),
        area=real_array("area", area, 1e-18, 1e4),
        capacitance=real_array("capacitance", capacitance, 1e-12, 1e3),
    )
    return np.abs(d33) / (square_metres * farad_per_m2)


@dataclass(frozen=True)
class NoiseBudget:
    """Noise at the gate in a band, by source."""

    bias: float
    """Of the bias resistor [V rms]."""
    thermal: float
    """Of the amplifier's input pair [V rms]."""
    flicker: float
    """[V rms]"""
    quantisation: float
    """[V rms]"""
    volts_per_newton: float
    """Gate shift per force [V/N]."""

    @property
    def total(self) -> float:
        """All sources together [V rms]."""
        return math.hypot(self.bias, self.thermal, self.flicker, self.quantisation)

    def minimum_force(self, sigmas: float = 3.0) -> float:
        """Return the force [N] whose gate shift is `sigmas` times the total rms; inf when force gives no voltage.

        sigmas is in (0, 100]. A change of force within the band is meant: a held force leaks away.
        """
        factor = real_number("sigmas", sigmas, 1e-3, 100)
        return factor * self.total / self.volts_per_newton if self.volts_per_newton else math.inf


def noise_budget(
    bias_rms: float,
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
    bias_rms : float
        noise of the bias resistor in the band [V], in [0, 1e6] (`bias_resistor_rms`).
    thermal_density : float
        Of the amplifier, at the gate [V2/Hz], in [0, 1e6].
    flicker_coefficient : float
        K at the gate [V2], in [0, 1e6].
    lsb : float
        Step of the converter behind the follower [V], in [0, 1e6]; its whole noise is counted into the band.
    volts_per_newton : float
        gate shift per force [V/N], in [0, 1e12].
    low, high : float
        Ends of the band [Hz], 1e-12 <= low < high <= 1e15.
    gain : float, default 1.0
        Of the follower [V/V], in [1e-3, 1e3].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range.
    """
    return NoiseBudget(
        bias=real_number("bias_rms", bias_rms, 0, 1e6),
        thermal=white_rms(real_number("thermal_density", thermal_density, 0, DENSITY_LIMIT), low, high),
        flicker=flicker_rms(real_number("flicker_coefficient", flicker_coefficient, 0, DENSITY_LIMIT), low, high),
        quantisation=quantisation_rms(lsb) / real_number("gain", gain, 1e-3, 1e3),
        volts_per_newton=real_number("volts_per_newton", volts_per_newton, 0, 1e12),
    )
