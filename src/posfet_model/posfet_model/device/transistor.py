# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The transistor under the film: capacitances of the stack, threshold shift, drain current, and their inverses.

The square-law model of the paper (eq. 6-10) for an n-channel device with its source at 0 V:

    cut-off       Vgs <= Vth                Id = 0
    linear        Vds <= Vgs - Vth          Id = beta*((Vgs - Vth)*Vds - Vds^2/2)*(1 + lambda*Vds)
    saturation    Vds >= Vgs - Vth          Id = beta/2*(Vgs - Vth)^2*(1 + lambda*Vds)

with beta = mu*C*W/L [A/V2]. With v = min(Vds, max(Vgs - Vth, 0)) all three are one expression, continuous with its
first derivatives. Voltages in V, currents in A, capacitances per area in F/m2. Arrays of any shapes that broadcast
together are accepted; float32 arrays stay float32 when combined with scalars.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import common_dtype, instance, real_array, real_number
from posfet_model.device.constants import VACUUM_PERMITTIVITY

VOLTAGE_LIMIT: Final = 1e6
"""Largest accepted magnitude of a voltage [V]."""

CURRENT_LIMIT: Final = 1e6
"""Largest accepted current [A]."""

GAIN_FACTOR_RANGE: Final = (1e-12, 1e6)
"""Accepted gain factors beta [A/V2]."""

CAPACITANCE_RANGE: Final = (1e-12, 1e3)
"""Accepted capacitances per area [F/m2]."""


class Plane(enum.Enum):
    """Plane on which voltages are counted; charge and current of one calculation must use the same plane."""

    GATE = "gate"
    """The top electrode above the film, at a fixed voltage: the channel is driven through Cstack, and charge between
    film and oxide counts as sigma/Cpvdf."""

    OXIDE = "oxide"
    """The top of the oxide, all charge there mirrored in the channel, Cox for both: the limit of `GATE` when the film's
    capacitance is negligible compared with the oxide's."""


@dataclass(frozen=True)
class Stack:  # numpydoc ignore=PR02
    """Oxide and film, one above the other, as capacitances per area.

    Parameters
    ----------
    oxide, film : float
        Cox, Cpvdf [F/m2], in [1e-12, 1e3].

    Raises
    ------
    ValueError
        A capacitance is not real, not finite or out of range.
    """

    oxide: float
    film: float

    def __post_init__(self) -> None:
        real_number("oxide", self.oxide, *CAPACITANCE_RANGE)
        real_number("film", self.film, *CAPACITANCE_RANGE)

    @property
    def series(self) -> float:
        """Cstack [F/m2], eq. (8): ``1/Cstack = 1/Cox + 1/Cpvdf``."""
        return self.oxide * self.film / (self.oxide + self.film)

    def drive(self, plane: Plane) -> float:
        """Return the capacitance [F/m2] through which a voltage on the plane drives the channel."""
        return {Plane.GATE: self.series, Plane.OXIDE: self.oxide}[_known(plane)]

    def charge_divisor(self, plane: Plane) -> float:
        """Return the capacitance [F/m2] that converts charge between film and oxide to a voltage on the plane."""
        return {Plane.GATE: self.film, Plane.OXIDE: self.oxide}[_known(plane)]


def capacitance_per_area(relative_permittivity: ArrayLike, thickness: ArrayLike) -> FloatArray:
    """Return the capacitance per area [F/m2] of a layer: ``C = eps_r*eps0/t``, eq. (8).

    Parameters
    ----------
    relative_permittivity : array_like
        eps_r [1], in [1, 1e5].
    thickness : array_like
        t [m], in [1e-10, 1].

    Returns
    -------
    ndarray
        C [F/m2], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Examples
    --------
    >>> print(f"{capacitance_per_area(3.9, 45e-9):.4e} {capacitance_per_area(12.0, 2.5e-6):.4e}")
    7.6736e-04 4.2500e-05
    """
    relative_permittivity, thickness = common_dtype(
        relative_permittivity=real_array("relative_permittivity", relative_permittivity, 1, 1e5),
        thickness=real_array("thickness", thickness, 1e-10, 1),
    )
    return relative_permittivity * VACUUM_PERMITTIVITY / thickness


def threshold_shift(charge: ArrayLike, stack: Stack, plane: Plane, uncompensated_fraction: ArrayLike) -> FloatArray:
    """Return the shift [V] of flat-band and threshold voltage by charge: ``dV = -kappa*sigma/C``, eq. (6) and (7).

    Parameters
    ----------
    charge : array_like
        sigma [C/m2] at the interface of film and oxide, within +-1e6: Psw = Ps + Pr (eq. 5) for a film switched from
        one remnant state to the opposite saturation, or the piezoelectric charge density.
    stack : Stack
        Capacitances of oxide and film.
    plane : Plane
        Plane on which the voltage is counted: C is Cpvdf at the gate, Cox on the oxide.
    uncompensated_fraction : array_like
        kappa [1], in [0, 1], the part of the charge not compensated by trapped or injected charge.

    Returns
    -------
    ndarray
        dV [V], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The paper has no kappa. With kappa = 1 its numbers shift the voltage on the oxide plane by 91.222 V, a field of
    20.3 MV/cm in the oxide, twice its breakdown field: nearly all of the polarisation is compensated. kappa = 0.010962
    shifts by 1 V.

    The two planes are not equivalent. By Gauss's law an electrode at a fixed voltage takes up part of the charge, and
    Cox/(Cox + Cpvdf) of it reaches the channel (0.9475 with Table I): the gate plane. On the oxide plane, the paper's
    eq. (6), all of it reaches the channel. Charge divided by Cox must not be combined with a current driven by Cstack,
    as the paper does: see `posfet_model.device.as_printed`.

    Examples
    --------
    >>> stack = Stack(oxide=7.6736295e-4, film=4.2500102e-5)
    >>> print(*(f"{threshold_shift(0.07, stack, plane, 1.0):.3f}" for plane in (Plane.OXIDE, Plane.GATE)))
    -91.222 -1647.055
    """
    charge, uncompensated_fraction = common_dtype(
        charge=real_array("charge", charge, -1e6, 1e6),
        uncompensated_fraction=real_array("uncompensated_fraction", uncompensated_fraction, 0, 1),
    )
    return -uncompensated_fraction * charge / instance("stack", stack, Stack).charge_divisor(plane)


def uncompensated_fraction(shift: ArrayLike, charge: ArrayLike, stack: Stack, plane: Plane) -> FloatArray:
    """Return kappa [1] that explains a measured shift: the inverse of `threshold_shift`.

    Parameters
    ----------
    shift : array_like
        dV [V], of the sign opposite to the charge and no larger than the shift by the whole charge.
    charge : array_like
        sigma [C/m2], within +-1e6 and not zero.
    stack : Stack
        Capacitances of oxide and film.
    plane : Plane
        Plane on which the voltage is counted.

    Returns
    -------
    ndarray
        kappa [1], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, the shapes do not broadcast, or the charge cannot explain
        the shift (kappa outside [0, 1]).

    Examples
    --------
    >>> stack = Stack(oxide=7.6736295e-4, film=4.2500102e-5)
    >>> print(f"{uncompensated_fraction(-1.0, 0.07, stack, Plane.OXIDE):.6f}")
    0.010962
    """
    shift, charge = common_dtype(
        shift=real_array("shift", shift, -VOLTAGE_LIMIT, VOLTAGE_LIMIT),
        charge=real_array("charge", charge, -1e6, 1e6),
    )
    if not charge.all():
        raise ValueError("charge must not be 0, got 0")
    fraction = -shift * instance("stack", stack, Stack).charge_divisor(plane) / charge
    return np.minimum(real_array("kappa of this shift and charge", fraction, 0, 1 + 1e-12), 1)


def gain_factor(mobility: ArrayLike, capacitance: ArrayLike, width: ArrayLike, length: ArrayLike) -> FloatArray:
    """Return beta [A/V2] of eq. (9): ``beta = mu*C*W/L``.

    Parameters
    ----------
    mobility : array_like
        mu [m2/(V s)], in [1e-9, 100] (850 cm2/Vs is 0.085).
    capacitance : array_like
        C [F/m2] of the plane that the gate voltage refers to (`Stack.drive`), in [1e-12, 1e3].
    width, length : array_like
        W, L [m] of the channel, in [1e-9, 1].

    Returns
    -------
    ndarray
        beta [A/V2], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Examples
    --------
    >>> print(f"{gain_factor(0.085, 4.0269756e-5, 3276e-6, 12e-6):.4e}")
    9.3446e-04
    """
    mobility, capacitance, width, length = common_dtype(
        mobility=real_array("mobility", mobility, 1e-9, 100),
        capacitance=real_array("capacitance", capacitance, *CAPACITANCE_RANGE),
        width=real_array("width", width, 1e-9, 1),
        length=real_array("length", length, 1e-9, 1),
    )
    return mobility * capacitance * (width / length)


def drain_current(
    gate_voltage: ArrayLike,
    drain_voltage: ArrayLike,
    threshold_voltage: ArrayLike,
    gain_factor: ArrayLike,
    channel_length_modulation: ArrayLike = 0.0,
) -> FloatArray:
    """Return Id [A] in cut-off, linear region and saturation, eq. (9) and (10).

    Parameters
    ----------
    gate_voltage : array_like
        Vgs [V], within +-1e6.
    drain_voltage : array_like
        Vds [V], in [0, 1e6].
    threshold_voltage : array_like
        Vth [V], within +-1e6.
    gain_factor : array_like
        beta [A/V2], in [1e-12, 1e6].
    channel_length_modulation : array_like, default 0.0
        lambda [1/V], in [0, 10]; the factor 1 + lambda*Vds applies to both regions, as in SPICE level 1, so that the
        current stays continuous.

    Returns
    -------
    ndarray
        Id [A], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The paper prints eq. (10) without the factor 1/2; the current would double at Vds = Vgs - Vth. The square law has no
    subthreshold current and no velocity saturation: below some 0.1 V of overdrive it is a lower bound.

    Examples
    --------
    >>> [f"{value:.4e}" for value in drain_current(1.7, [0.1, 1.0, 5.0], 0.7, 9.3446e-4)]
    ['8.8774e-05', '4.6723e-04', '4.6723e-04']
    """
    bias = _bias(gate_voltage, drain_voltage, threshold_voltage, gain_factor, channel_length_modulation)
    return bias.gain_factor * (bias.overdrive - bias.channel / 2) * bias.channel * bias.modulation


def transconductance(
    gate_voltage: ArrayLike,
    drain_voltage: ArrayLike,
    threshold_voltage: ArrayLike,
    gain_factor: ArrayLike,
    channel_length_modulation: ArrayLike = 0.0,
) -> FloatArray:
    """Return gm = dId/dVgs [S]: ``beta*min(Vds, Vgs - Vth)*(1 + lambda*Vds)``, 0 in cut-off.

    Parameters
    ----------
    gate_voltage, drain_voltage, threshold_voltage : array_like
        Vgs, Vds, Vth [V], as in `drain_current`.
    gain_factor : array_like
        beta [A/V2], in [1e-12, 1e6].
    channel_length_modulation : array_like, default 0.0
        lambda [1/V], in [0, 10].

    Returns
    -------
    ndarray
        gm [S], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    bias = _bias(gate_voltage, drain_voltage, threshold_voltage, gain_factor, channel_length_modulation)
    return bias.gain_factor * bias.channel * bias.modulation


def output_conductance(
    gate_voltage: ArrayLike,
    drain_voltage: ArrayLike,
    threshold_voltage: ArrayLike,
    gain_factor: ArrayLike,
    channel_length_modulation: ArrayLike = 0.0,
) -> FloatArray:
    """Return gds = dId/dVds [S], with v = min(Vds, Vgs - Vth), 0 in cut-off.

    ``beta*(Vgs - Vth - v)*(1 + lambda*Vds) + lambda*beta*(Vgs - Vth - v/2)*v``

    Parameters
    ----------
    gate_voltage, drain_voltage, threshold_voltage : array_like
        Vgs, Vds, Vth [V], as in `drain_current`.
    gain_factor : array_like
        beta [A/V2], in [1e-12, 1e6].
    channel_length_modulation : array_like, default 0.0
        lambda [1/V], in [0, 10].

    Returns
    -------
    ndarray
        gds [S], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    bias = _bias(gate_voltage, drain_voltage, threshold_voltage, gain_factor, channel_length_modulation)
    slope = (bias.overdrive - bias.channel) * bias.modulation
    lengthening = bias.channel_length_modulation * (bias.overdrive - bias.channel / 2) * bias.channel
    return bias.gain_factor * (slope + lengthening)


def gate_voltage(
    drain_current: ArrayLike,
    drain_voltage: ArrayLike,
    threshold_voltage: ArrayLike,
    gain_factor: ArrayLike,
    channel_length_modulation: ArrayLike = 0.0,
) -> FloatArray:
    """Return Vgs [V] for a drain current: the inverse of `drain_current`.

    Parameters
    ----------
    drain_current : array_like
        Id [A], in [0, 1e6]. 0 gives Vth, the highest of all gate voltages without current.
    drain_voltage : array_like
        Vds [V], in [1e-9, 1e6].
    threshold_voltage : array_like
        Vth [V], within +-1e6.
    gain_factor : array_like
        beta [A/V2], in [1e-12, 1e6].
    channel_length_modulation : array_like, default 0.0
        lambda [1/V], in [0, 10].

    Returns
    -------
    ndarray
        Vgs [V], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    Closed form: with i = Id/(beta*(1 + lambda*Vds)) the overdrive is sqrt(2*i) in saturation and i/Vds + Vds/2 in the
    linear region; the two meet with equal slope at i = Vds^2/2. The rounding error of the overdrive is at most 4 units
    in the last place.
    """
    current, drain_voltage, threshold_voltage, gain_factor, channel_length_modulation = common_dtype(
        drain_current=real_array("drain_current", drain_current, 0, CURRENT_LIMIT),
        drain_voltage=real_array("drain_voltage", drain_voltage, 1e-9, VOLTAGE_LIMIT),
        threshold_voltage=real_array("threshold_voltage", threshold_voltage, -VOLTAGE_LIMIT, VOLTAGE_LIMIT),
        gain_factor=real_array("gain_factor", gain_factor, *GAIN_FACTOR_RANGE),
        channel_length_modulation=real_array("channel_length_modulation", channel_length_modulation, 0, 10),
    )
    scaled = current / (gain_factor * (1 + channel_length_modulation * drain_voltage))
    saturated = np.sqrt(2 * scaled)
    linear = scaled / drain_voltage + drain_voltage / 2
    return threshold_voltage + np.where(saturated <= drain_voltage, saturated, linear)


def _known(plane: Plane) -> Plane:
    if not isinstance(plane, Plane):
        raise ValueError(f"plane must be Plane.GATE or Plane.OXIDE, got {plane!r:.60}")
    return plane


@dataclass(frozen=True)
class _Bias:
    """Bias point: overdrive max(Vgs - Vth, 0), channel voltage min(Vds, overdrive) [V], 1 + lambda*Vds, beta."""

    overdrive: FloatArray
    channel: FloatArray
    modulation: FloatArray
    gain_factor: FloatArray
    channel_length_modulation: FloatArray


def _bias(
    gate_voltage: ArrayLike,
    drain_voltage: ArrayLike,
    threshold_voltage: ArrayLike,
    gain_factor: ArrayLike,
    channel_length_modulation: ArrayLike,
) -> _Bias:
    gate, drain, threshold, beta, modulation = common_dtype(
        gate_voltage=real_array("gate_voltage", gate_voltage, -VOLTAGE_LIMIT, VOLTAGE_LIMIT),
        drain_voltage=real_array("drain_voltage", drain_voltage, 0, VOLTAGE_LIMIT),
        threshold_voltage=real_array("threshold_voltage", threshold_voltage, -VOLTAGE_LIMIT, VOLTAGE_LIMIT),
        gain_factor=real_array("gain_factor", gain_factor, *GAIN_FACTOR_RANGE),
        channel_length_modulation=real_array("channel_length_modulation", channel_length_modulation, 0, 10),
    )
    overdrive = np.maximum(gate - threshold, 0)
    return _Bias(overdrive, np.minimum(drain, overdrive), 1 + modulation * drain, beta, modulation)
