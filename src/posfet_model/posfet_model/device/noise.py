"""Noise of the readout: bias resistor, amplifier, 1/f, sampling and quantisation, and the smallest detectable force.

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


def white_rms(density: ArrayLike, low: ArrayLike, high: ArrayLike) -> FloatArray:
    """Return the rms [V] of white noise between two frequencies: ``sqrt(S*(high - low))``.

    Parameters
    ----------
    density : array_like
        S [V2/Hz], in [0, 1e6].
    low, high : array_like
        Ends of the band [Hz], 0 <= low < high <= 1e15. For a one-pole low-pass at f1 take high = f1*pi/2.

    Returns
    -------
    ndarray
        Noise [V rms], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    level, low, high = _in_band(low, high, density=real_array("density", density, 0, DENSITY_LIMIT))
    return np.sqrt(level * (high - low))


def bias_resistor_rms(
    resistance: ArrayLike, capacitance: ArrayLike, temperature: ArrayLike, low: ArrayLike, high: ArrayLike
) -> FloatArray:
    """Return the rms [V] between two frequencies of a resistor's noise across the capacitance that it charges.

    ``sqrt(k*T/C*2/pi*(arctan(2*pi*high*R*C) - arctan(2*pi*low*R*C)))``: Nyquist's density 4*k*T*R through the low-pass
    of R and C, ``S(f) = 4*k*T*R/(1 + (2*pi*f*R*C)^2)``, integrated.

    Parameters
    ----------
    resistance : array_like
        R [ohm], in [1, 1e18].
    capacitance : array_like
        C [F] of the node that R charges, in [1e-18, 1].
    temperature : array_like
        T [K], in [1, 1000].
    low, high : array_like
        Ends of the band [Hz], 0 <= low < high <= 1e15.

    Returns
    -------
    ndarray
        Noise [V rms], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

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
    ohms, farad, kelvin, low, high = _in_band(
        low,
        high,
        resistance=real_array("resistance", resistance, 1, 1e18),
        capacitance=real_array("capacitance", capacitance, 1e-18, 1),
        temperature=real_array("temperature", temperature, *TEMPERATURE_RANGE),
    )
    turn = 2 * math.pi * ohms * farad
    # The difference of the arctangents, without cancellation.
    angle = np.arctan2(turn * (high - low), 1 + turn * low * turn * high)
    return np.sqrt(BOLTZMANN * kelvin / farad * 2 / math.pi * angle)


def flicker_rms(coefficient: ArrayLike, low: ArrayLike, high: ArrayLike) -> FloatArray:
    """Return the rms [V] of 1/f noise between two frequencies: ``sqrt(K*ln(high/low))``.

    Parameters
    ----------
    coefficient : array_like
        K [V2], in [0, 1e6].
    low, high : array_like
        Ends of the band [Hz], 1e-12 <= low < high <= 1e15: 1/f noise from 0 Hz has no finite power. A record of t
        seconds has about low = 1/t.

    Returns
    -------
    ndarray
        Noise [V rms], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    checked = real_array("coefficient", coefficient, 0, DENSITY_LIMIT)
    volts2, low, high = _in_band(low, high, least=FREQUENCY_RANGE[0], coefficient=checked)
    return np.sqrt(volts2 * np.log1p((high - low) / low))


def gate_flicker_coefficient(
    constant: ArrayLike, width: ArrayLike, length: ArrayLike, capacitance: ArrayLike
) -> FloatArray:
    """Return the flicker coefficient K [V2] of a transistor, at its oxide: ``K = constant/(W*L*Cox)``.

    A large gate has less 1/f noise, because more traps take part and each one moves the threshold less.

    Parameters
    ----------
    constant : array_like
        Constant of the process [V2 F], in [0, 1e-15].
    width, length : array_like
        W, L [m], in [1e-9, 1].
    capacitance : array_like
        Cox [F/m2], in [1e-12, 1e3].

    Returns
    -------
    ndarray
        K [V2], for the density K/f, of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    B. Razavi, *Design of Analog CMOS Integrated Circuits*, chapter on noise. Referred to a gate behind a film, divide
    by the square of the coupling (`Taxel.coupling`).

    Examples
    --------
    >>> print(f"{gate_flicker_coefficient(1e-24, 3276e-6, 12e-6, 7.6736e-4):.3g} V2")
    3.31e-14 V2
    """
    constant, width, length, capacitance = common_dtype(
        constant=real_array("constant", constant, 0, 1e-15),
        width=real_array("width", width, 1e-9, 1),
        length=real_array("length", length, 1e-9, 1),
        capacitance=real_array("capacitance", capacitance, 1e-12, 1e3),
    )
    return constant / (width * length * capacitance)


def sampling_rms(capacitance: ArrayLike, temperature: ArrayLike) -> FloatArray:
    """Return the rms [V] of the noise that a switch leaves on the sampling capacitor of an ADC: ``sqrt(k*T/C)``.

    Parameters
    ----------
    capacitance : array_like
        C [F], in [1e-18, 1].
    temperature : array_like
        T [K], in [1, 1000].

    Returns
    -------
    ndarray
        Noise [V rms], of the broadcast shape; sampled, it is all in the band up to half the sampling rate.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Examples
    --------
    >>> print(f"{sampling_rms(10e-12, 300.0) * 1e6:.2f} uV")
    20.35 uV
    """
    farad, kelvin = common_dtype(
        capacitance=real_array("capacitance", capacitance, 1e-18, 1),
        temperature=real_array("temperature", temperature, *TEMPERATURE_RANGE),
    )
    return np.sqrt(BOLTZMANN * kelvin / farad)


def quantisation_rms(lsb: ArrayLike) -> FloatArray:
    """Return the rms [V] of quantisation in steps of `lsb`: ``lsb/sqrt(12)``.

    Valid when the signal and its noise extend over half a step or more, so that the error is uniformly distributed.

    Parameters
    ----------
    lsb : array_like
        Step [V], in [0, 1e6].

    Returns
    -------
    ndarray
        Noise [V rms].

    Raises
    ------
    ValueError
        The step is not real, not finite or out of range.
    """
    return real_array("lsb", lsb, 0, 1e6) / math.sqrt(12)


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


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseBudget:
    """Noise at the gate in a band, by source; numbers or arrays, which broadcast."""

    bias: FloatArray
    """Noise of the bias resistor [V rms]."""
    thermal: FloatArray
    """Thermal noise of the amplifier's input stage [V rms]."""
    flicker: FloatArray
    """1/f noise of the amplifier [V rms]."""
    sampling: FloatArray
    """kT/C noise of the ADC's sampling capacitor [V rms]."""
    quantisation: FloatArray
    """Quantisation noise of the ADC [V rms]."""
    volts_per_newton: FloatArray
    """Magnitude of the gate shift per force [V/N]."""

    @property
    def sources(self) -> dict[str, FloatArray]:
        """Noise of each source [V rms] by name."""
        return {name: getattr(self, name) for name in ("bias", "thermal", "flicker", "sampling", "quantisation")}

    @property
    def total(self) -> FloatArray:
        """Sum of all sources, as the root of their mean squares [V rms]."""
        squares: FloatArray = sum((np.square(source) for source in self.sources.values()), np.zeros(()))
        return np.sqrt(squares)

    def minimum_force(self, sigmas: float = 3.0) -> FloatArray:
        """Return the smallest detectable force [N]: its gate shift is `sigmas` times the total rms.

        A change of force within the band is meant, since a static force leaks away.

        Parameters
        ----------
        sigmas : float, default 3.0
            Detection threshold in standard deviations [1], in (0, 100].

        Returns
        -------
        ndarray
            Force [N]; inf when force gives no voltage.

        Raises
        ------
        ValueError
            `sigmas` is not real, not finite or out of range.
        """
        noise = real_number("sigmas", sigmas, 1e-3, 100) * np.asarray(self.total)
        with np.errstate(divide="ignore", invalid="ignore"):
            force: FloatArray = np.where(np.equal(self.volts_per_newton, 0), math.inf, noise / self.volts_per_newton)
        return force[()]

    def signal_to_noise(self, force: ArrayLike) -> FloatArray:
        """Return the ratio of a force's gate shift to the total rms [dB].

        Parameters
        ----------
        force : array_like
            Force [N], in [1e-12, 1e9]; the rms value of a vibration, or the height of a step.

        Returns
        -------
        ndarray
            ``20*log10(F*volts_per_newton/total)`` [dB]; -inf when force gives no voltage, inf without noise.

        Raises
        ------
        ValueError
            The force is not real, not finite or out of range.
        """
        newtons = real_array("force", force, 1e-12, 1e9)
        with np.errstate(divide="ignore"):
            ratio: FloatArray = 20 * np.log10(newtons * self.volts_per_newton) - 20 * np.log10(self.total)
        return ratio


def noise_budget(
    bias_rms: ArrayLike,
    thermal_density: ArrayLike,
    flicker_coefficient: ArrayLike,
    lsb: ArrayLike,
    volts_per_newton: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    *,
    gain: ArrayLike = 1.0,
    sampled_rms: ArrayLike = 0.0,
) -> NoiseBudget:
    """Return the noise referred to the gate in a band, by source.

    Parameters
    ----------
    bias_rms : array_like
        Noise of the bias resistor in the band, referred to the gate [V], in [0, 1e6] (`bias_resistor_rms`).
    thermal_density : array_like
        Thermal noise density of the amplifier, referred to the gate [V2/Hz], in [0, 1e6].
    flicker_coefficient : array_like
        K of the 1/f noise, referred to the gate [V2], in [0, 1e6].
    lsb : array_like
        Step of the ADC behind the follower [V], in [0, 1e6]; all of its quantisation noise is assigned to the band.
    volts_per_newton : array_like
        Gate shift per force [V/N], in [0, 1e12].
    low, high : array_like
        Ends of the band [Hz], 1e-12 <= low < high <= 1e15.
    gain : array_like, default 1.0
        Gain of the follower [V/V], in [1e-3, 1e3].
    sampled_rms : array_like, default 0.0
        kT/C noise of the ADC behind the follower [V], in [0, 1e6] (`sampling_rms`).

    Returns
    -------
    NoiseBudget
        Noise of each source [V rms].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    follower = real_array("gain", gain, 1e-3, 1e3)
    sampled = real_array("sampled_rms", sampled_rms, 0, 1e6)
    bias, thermal, flicker, sampling, quantisation, sensitivity = common_dtype(
        bias_rms=real_array("bias_rms", bias_rms, 0, 1e6),
        thermal_density=white_rms(real_array("thermal_density", thermal_density, 0, DENSITY_LIMIT), low, high),
        flicker_coefficient=flicker_rms(
            real_array("flicker_coefficient", flicker_coefficient, 0, DENSITY_LIMIT), low, high
        ),
        sampled_rms=sampled / follower,
        lsb=quantisation_rms(lsb) / follower,
        volts_per_newton=real_array("volts_per_newton", volts_per_newton, 0, 1e12),
    )
    return NoiseBudget(
        bias=bias,
        thermal=thermal,
        flicker=flicker,
        sampling=sampling,
        quantisation=quantisation,
        volts_per_newton=sensitivity,
    )


def _in_band(low: ArrayLike, high: ArrayLike, *, least: float = 0.0, **arguments: FloatArray) -> tuple[FloatArray, ...]:
    """Return the arguments and both ends of the band with their common dtype; ValueError unless low < high."""
    arguments["low"] = real_array("low", low, least, FREQUENCY_RANGE[1])
    arguments["high"] = real_array("high", high, least, FREQUENCY_RANGE[1])
    checked = common_dtype(**arguments)
    if not np.all(checked[-1] > checked[-2]):
        raise ValueError(f"high must be above low, got {_first(high)} to a low of {_first(low)} Hz")
    return checked


def _first(values: ArrayLike) -> str:
    return f"{float(np.asarray(values).flat[0]):g}"
