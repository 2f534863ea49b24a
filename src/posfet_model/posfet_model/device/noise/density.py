# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Noise densities of single sources: resistor, differential pair, 1/f."""

from __future__ import annotations

from typing import Final

from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import common_dtype, real_array
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
