# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Noise of single sources in a band of frequencies [V rms]."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import common_dtype, real_array
from posfet_model.device.constants import BOLTZMANN
from posfet_model.device.noise.density import DENSITY_LIMIT, FREQUENCY_RANGE, TEMPERATURE_RANGE


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
