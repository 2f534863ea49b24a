"""Noise of the readout: bias resistor, amplifier, 1/f and quantisation, and the smallest detectable force.

Spectra are one-sided power spectral densities [V2/Hz]. The sources are independent, so densities and mean squares add.
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
    """Return the noise density ``4*k*T*R`` [V2/Hz] of a resistor's open-circuit voltage (Nyquist 1928).

    Parameters
    ----------
    resistance : array_like
        R [ohm], in [0, 1e18].
    temperature : array_like
        T [K], in [1, 1000].

    Returns
    -------
    ndarray
        Density [V2/Hz], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Examples
    --------
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
    """Return the input-referred thermal noise density [V2/Hz] of a differential pair with a current-mirror load.

    ``2*(4*k*T*(2/3)/gm1)*(1 + gm3/gm1)``: two input and two load transistors; noise of the tail current is common mode.

    Parameters
    ----------
    input_transconductance, load_transconductance : array_like
        gm1, gm3 [S], in [1e-12, 1e3] and [0, 1e3].
    temperature : array_like
        T [K], in [1, 1000].

    Returns
    -------
    ndarray
        Density [V2/Hz], of the broadcast shape.

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
    """Return the density ``K/f`` [V2/Hz] of 1/f noise.

    Parameters
    ----------
    coefficient : array_like
        K [V2], in [0, 1e6].
    frequency : array_like
        f [Hz], in [1e-12, 1e15].

    Returns
    -------
    ndarray
        Density [V2/Hz], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    volts2, hertz = common_dtype(
        coefficient=real_array("coefficient", coefficient, 0, DENSITY_LIMIT),
        frequency=real_array("frequency", frequency, *FREQUENCY_RANGE),
    )
    return volts2 / hertz


def white_rms(density: float, low: float, high: float) -> float:
    """Return the rms [V] of white noise between two frequencies: ``sqrt(S*(high - low))``.

    Parameters
    ----------
    density : float
        S [V2/Hz], in [0, 1e6].
    low, high : float
        Ends of the band [Hz], 0 <= low < high <= 1e15. For a one-pole low-pass at f1 take high = f1*pi/2.

    Returns
    -------
    float
        Noise [V rms].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range.
    """
    level = real_number("density", density, 0, DENSITY_LIMIT)
    low = real_number("low", low, 0, FREQUENCY_RANGE[1])
    high = real_number("high", high, math.nextafter(low, math.inf), FREQUENCY_RANGE[1])
    return math.sqrt(level * (high - low))


def bias_resistor_rms(resistance: float, capacitance: float, temperature: float, low: float, high: float) -> float:
    """Return the rms [V] between two frequencies of a resistor's noise across the capacitance that it charges.

    ``sqrt(k*T/C*2/pi*(arctan(2*pi*high*R*C) - arctan(2*pi*low*R*C)))``: Nyquist's density 4*k*T*R through the low-pass
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

    Returns
    -------
    float
        Noise [V rms].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range.

    Notes
    -----
    Over all frequencies it is sqrt(k*T/C), independent of R (B. Razavi, *Design of Analog CMOS Integrated Circuits*,
    chapter on noise). R determines its spectrum: a larger R moves it below the band, and the mean square in a band far
    above the corner frequency falls as 1/R.

    Examples
    --------
    10 Gohm on 26.6 pF, in a band that contains nearly all of it:

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

    Parameters
    ----------
    coefficient : float
        K [V2], in [0, 1e6].
    low, high : float
        Ends of the band [Hz], 1e-12 <= low < high <= 1e15: 1/f noise from 0 Hz has no finite power. A record of t
        seconds has about low = 1/t.

    Returns
    -------
    float
        Noise [V rms].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range.
    """
    volts2 = real_number("coefficient", coefficient, 0, DENSITY_LIMIT)
    low = real_number("low", low, *FREQUENCY_RANGE)
    high = real_number("high", high, math.nextafter(low, math.inf), FREQUENCY_RANGE[1])
    return math.sqrt(volts2 * math.log1p((high - low) / low))


def quantisation_rms(lsb: float) -> float:
    """Return the rms [V] of quantisation in steps of `lsb`: ``lsb/sqrt(12)``.

    Valid when the signal and its noise extend over half a step or more, so that the error is uniformly distributed.

    Parameters
    ----------
    lsb : float
        Step [V], in [0, 1e6].

    Returns
    -------
    float
        Noise [V rms].

    Raises
    ------
    ValueError
        The step is not real, not finite or out of range.
    """
    return real_number("lsb", lsb, 0, 1e6) / math.sqrt(12)


def flicker_sequence(
    coefficient: float, rate: float, samples: int, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return a record of Gaussian 1/f noise [V] with the density K/f.

    Parameters
    ----------
    coefficient : float
        K [V2], in [0, 1e6].
    rate : float
        Sampling rate [Hz], in [1e-9, 1e12].
    samples : int
        Length of the record, in [2, 2**26].
    generator : numpy.random.Generator
        Source of random numbers; the same seed reproduces the record.

    Returns
    -------
    ndarray
        Noise [V], shape [samples].

    Raises
    ------
    ValueError
        An argument is out of range, or the generator is not a Generator.

    Notes
    -----
    Generated in the frequency domain: at each frequency m*rate/samples, 0 < m <= samples/2, the expected periodogram is
    exactly K/f (spectrum error 0; a single periodogram scatters by 100 %, as for any noise). There is no power below
    rate/samples, so the mean is 0, and the record is periodic: make it longer than the part that is used.
    """
    volts2 = real_number("coefficient", coefficient, 0, DENSITY_LIMIT)
    rate = real_number("rate", rate, 1e-9, 1e12)
    samples = whole_number("samples", samples, 2, 2**26)
    generator = instance("generator", generator, np.random.Generator)
    order = np.arange(1, samples // 2 + 1)
    # Mean square of each complex amplitude: density*rate*samples/2, halved once more for real and imaginary part. The
    # bin at rate/2, present for an even number of samples, is real and represents half a bin's width.
    scale = np.sqrt(volts2 / (order * rate / samples) * rate * samples / 4)
    spectrum = np.zeros(samples // 2 + 1, np.complex128)
    spectrum[1:] = scale * (generator.standard_normal(order.size) + 1j * generator.standard_normal(order.size))
    if samples % 2 == 0:
        spectrum[-1] = spectrum[-1].real * math.sqrt(2)
    return np.fft.irfft(spectrum, samples)


def volts_per_newton(piezoelectric_coefficient: ArrayLike, area: ArrayLike, capacitance: ArrayLike) -> FloatArray:
    """Return the sensitivity at the gate [V/N]: ``|d33|/(A*C)``.

    Parameters
    ----------
    piezoelectric_coefficient : array_like
        d33 [C/N], within +-1e-6.
    area : array_like
        A [m2] on which the force acts, in [1e-18, 1e4].
    capacitance : array_like
        C [F/m2] of the plane at which the voltage is counted (`Stack.charge_divisor`), in [1e-12, 1e3].

    Returns
    -------
    ndarray
        Gate shift per force [V/N], of the broadcast shape.

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
    """Noise of the bias resistor [V rms]."""
    thermal: float
    """Thermal noise of the amplifier's input pair [V rms]."""
    flicker: float
    """1/f noise of the amplifier [V rms]."""
    quantisation: float
    """Quantisation noise of the ADC [V rms]."""
    volts_per_newton: float
    """Gate shift per force [V/N]."""

    @property
    def total(self) -> float:
        """Sum of all sources, as the root of their mean squares [V rms]."""
        return math.hypot(self.bias, self.thermal, self.flicker, self.quantisation)

    def minimum_force(self, sigmas: float = 3.0) -> float:
        """Return the smallest detectable force [N]: its gate shift is `sigmas` times the total rms.

        A change of force within the band is meant, since a static force leaks away.

        Parameters
        ----------
        sigmas : float, default 3.0
            Detection threshold in standard deviations [1], in (0, 100].

        Returns
        -------
        float
            Force [N]; inf when force gives no voltage.

        Raises
        ------
        ValueError
            `sigmas` is not real, not finite or out of range.
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
    """Return the noise referred to the gate in a band, by source.

    Parameters
    ----------
    bias_rms : float
        Noise of the bias resistor in the band [V], in [0, 1e6] (`bias_resistor_rms`).
    thermal_density : float
        Thermal noise density of the amplifier, referred to the gate [V2/Hz], in [0, 1e6].
    flicker_coefficient : float
        K of the 1/f noise, referred to the gate [V2], in [0, 1e6].
    lsb : float
        Step of the ADC behind the follower [V], in [0, 1e6]; all of its quantisation noise is assigned to the band.
    volts_per_newton : float
        Gate shift per force [V/N], in [0, 1e12].
    low, high : float
        Ends of the band [Hz], 1e-12 <= low < high <= 1e15.
    gain : float, default 1.0
        Gain of the follower [V/V], in [1e-3, 1e3].

    Returns
    -------
    NoiseBudget
        Noise of each source [V rms].

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
