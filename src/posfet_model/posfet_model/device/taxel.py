# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One taxel: film, gate below it and bias resistor, from geometry, material and poling history to volts and amperes.

The film lies on an electrode of its own area, which is connected to the gate of the transistor:

    top electrode --- film, Cf = eps*A/t --- node --- oxide, Cg = Cox*W*L --- channel
                                              |
                                       bias resistor R to ground

A force F puts the charge ``-d33*F`` on the node. Seen from the top electrode, the input of the follower, this equals a
voltage ``-d33*F/Cf`` (Gauss's law), whatever the gate. A voltage of the top electrode reaches the oxide, and so the
channel, in the share of the coupling ``Cf/(Cf + Cg)``; the node discharges with ``R*(Cf + Cg)``.

Every field may be an array; arrays broadcast, and every result is the same as for each element alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import instance
from posfet_model.device import noise, paper, transistor
from posfet_model.device.film import Film, remnant_after
from posfet_model.device.taxel_fields import FilmGeometry, TaxelFields
from posfet_model.device.transistor import Plane

_REFERENCE_SHIFT: Final = paper.FILM.remnant_polarisation / paper.STACK.film
"""Pr/Cf of the paper's film, poled to saturation [V]: the state in which the threshold voltage is given."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Taxel(TaxelFields):
    """Film, gate and bias resistor of one taxel, or of many: any field may be an array.

    The fields are those of `TaxelFields`; their defaults are the paper's film and transistor.

    Raises
    ------
    ValueError
        A value is not a real number, not plausible in its SI unit, or the shapes of arrays do not broadcast.

    Examples
    --------
    >>> taxel = Taxel()
    >>> print(f"{taxel.volts_per_newton():.3f} V/N, coupling {taxel.coupling:.3f}, {taxel.leak_time_constant:.2f} s")
    0.894 V/N, coupling 0.585, 0.73 s
    >>> Taxel(film_thickness=2.5)
    Traceback (most recent call last):
        ...
    ValueError: film_thickness must be in [1e-08, 0.001] m, got 2.5; meant in um? 2.5 um is 2.5e-06 m
    """

    @property
    def _extended(self) -> bool:
        return self.film_geometry is FilmGeometry.EXTENDED

    @property
    def film_capacitance(self) -> FloatArray:
        """Capacitance Cf of the film [F]."""
        return self._film_per_area * self.film_area

    @property
    def _film_per_area(self) -> FloatArray:
        return transistor.capacitance_per_area(self.film_permittivity, self.film_thickness)

    @property
    def oxide_capacitance(self) -> FloatArray:
        """Capacitance Cox of the oxide per area [F/m2]."""
        return transistor.capacitance_per_area(self.oxide_permittivity, self.oxide_thickness)

    @property
    def gate_capacitance(self) -> FloatArray:
        """Capacitance Cg = Cox*W*L with which the gate loads the film [F]."""
        return self.oxide_capacitance * self.gate_width * self.gate_length

    @property
    def film_on_gate(self) -> FloatArray:
        """Capacitance [F/m2] of the film per area of the gate that it drives: Cf/(W*L); as in paper Cpvdf."""
        return self.film_capacitance / (self.gate_width * self.gate_length) if self._extended else self._film_per_area

    @property
    def coupling(self) -> FloatArray:
        """Share of a voltage of the top electrode that reaches the oxide, Cf/(Cf + Cg) [1]."""
        return self.film_on_gate / (self.film_on_gate + self.oxide_capacitance)

    @property
    def node_capacitance(self) -> FloatArray:
        """Capacitance Cf + Cg that holds the charge [F]; Cf as in paper."""
        return self.film_capacitance + self.gate_capacitance if self._extended else self.film_capacitance

    @property
    def leak_time_constant(self) -> FloatArray:
        """Leakage time constant [s], in which the signal of a static force falls to 37 %; -3 dB at 1/(2*pi*tau)."""
        return self.bias_resistance * self.node_capacitance

    @cached_property
    def poled_polarisation(self) -> FloatArray:
        """Polarisation that the poling history leaves at zero field [C/m2]; Pr for a saturated film."""
        if self.poling_voltages is None:
            return np.asarray(self.remnant_polarisation)[()]
        volts = [np.asarray(volt) / self.film_thickness for volt in self.poling_voltages]
        material = (self.coercive_field, self.remnant_polarisation, self.saturation_polarisation)
        rows = np.broadcast_arrays(*material, *volts)
        flat = zip(*(row.ravel().tolist() for row in rows), strict=True)
        left = np.array([_remnant(row[:3], row[3:]) for row in flat])
        return left.reshape(rows[0].shape)[()]

    @property
    def poled_fraction(self) -> FloatArray:
        """Polarisation in units of Pr [1], in [-1, 1]; d33 and p are proportional to it."""
        return self.poled_polarisation / self.remnant_polarisation

    @property
    def poling_shift(self) -> FloatArray:
        """Shift of the threshold by the poled film from that of the virgin one [V], at the gate: -kappa*P*A/Cf."""
        return -self.uncompensated_fraction * self.poled_polarisation / self._film_per_area

    @property
    def threshold(self) -> FloatArray:
        """Threshold voltage with this film and poling [V], at the gate."""
        return self.threshold_voltage + self.poling_shift + self.uncompensated_fraction * _REFERENCE_SHIFT

    def volts_per_newton(self, plane: Plane = Plane.GATE) -> FloatArray:
        """Return the sensitivity to a compressive force before leakage.

        Parameters
        ----------
        plane : Plane, default Plane.GATE
            GATE: the voltage of the top electrode with the same effect, -d33/Cf. OXIDE: the voltage of the node, which
            is there, -d33/(Cf + Cg).

        Returns
        -------
        ndarray
            Sensitivity [V/N], positive for a film poled in the positive direction with d33 < 0.

        Raises
        ------
        ValueError
            `plane` is not a Plane.
        """
        at_gate = -self.piezoelectric_coefficient * self.poled_fraction / self.film_capacitance
        return at_gate if instance("plane", plane, Plane) is Plane.GATE else at_gate * self.coupling

    @property
    def newtons_per_kelvin(self) -> FloatArray:  # numpydoc ignore=RT01
        """-p*A/d33 [N/K]: apparent force of a sudden temperature rise, negative (a pull) where p has the sign of d33.

        A steady heating of g [K/s] reads as ``newtons_per_kelvin*g*leak_time_constant`` in the end.
        """
        return -np.asarray(self.pyroelectric_coefficient) * self.film_area / self.piezoelectric_coefficient

    def gain_factor(self, plane: Plane = Plane.GATE) -> FloatArray:
        """Return beta [A/V2] of eq. (9) for a gate voltage counted on a plane: ``mu*Cox*coupling*W/L`` at the gate.

        Parameters
        ----------
        plane : Plane, default Plane.GATE
            Plane of the gate voltage.

        Returns
        -------
        ndarray
            beta [A/V2].

        Raises
        ------
        ValueError
            `plane` is not a Plane.
        """
        share = self.coupling if instance("plane", plane, Plane) is Plane.GATE else 1.0
        return self.electron_mobility * self.oxide_capacitance * share * (self.gate_width / self.gate_length)

    def drain_current(
        self, gate_voltage: ArrayLike, drain_voltage: ArrayLike, channel_length_modulation: ArrayLike = 0.0
    ) -> FloatArray:
        """Return the I-V curves of the transistor below this film, eq. (9) and (10).

        Parameters
        ----------
        gate_voltage, drain_voltage : array_like
            Vgs of the top electrode and Vds [V]; they broadcast with the fields.
        channel_length_modulation : array_like, default 0.0
            lambda [1/V], in [0, 10].

        Returns
        -------
        ndarray
            Drain current [A], of the broadcast shape.

        Raises
        ------
        ValueError
            An argument is not real, not finite or out of range, or the shapes do not broadcast.

        Examples
        --------
        >>> print(f"{Taxel().drain_current(1.7, 5.0) * 1e3:.3f} mA")
        5.207 mA
        """
        device = (self.threshold, self.gain_factor())
        return transistor.drain_current(gate_voltage, drain_voltage, *device, channel_length_modulation)

    def bias_noise(self, low: ArrayLike, high: ArrayLike, temperature: ArrayLike = 300.0) -> FloatArray:
        """Return the noise of the bias resistor in a band, as a voltage of the top electrode.

        Parameters
        ----------
        low, high : array_like
            Ends of the band [Hz], 0 <= low < high <= 1e15.
        temperature : array_like, default 300.0
            Temperature of the resistor [K], in [1, 1000].

        Returns
        -------
        ndarray
            Noise [V rms]: that of the node over the coupling.

        Raises
        ------
        ValueError
            An argument is not real, not finite or out of range, or the shapes do not broadcast.
        """
        at_node = noise.bias_resistor_rms(self.bias_resistance, self.node_capacitance, temperature, low, high)
        return at_node / self.coupling if self._extended else at_node


@lru_cache(maxsize=1 << 14)
def _remnant(material: tuple[float, ...], fields: tuple[float, ...]) -> float:
    coercive, remnant, saturation = material
    return remnant_after(fields, Film(coercive, remnant, saturation, relative_permittivity=1.0))
