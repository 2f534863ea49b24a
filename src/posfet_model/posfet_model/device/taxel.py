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

import dataclasses
import enum
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import instance
from posfet_model.device import noise, paper, transistor
from posfet_model.device.film import Film, remnant_after
from posfet_model.device.paper import Quantity
from posfet_model.device.physical_units import Plausible
from posfet_model.device.transistor import Plane

Values: TypeAlias = "float | FloatArray"
"""A number, or an array of numbers that broadcasts with all others of a design."""

_THRESHOLD: Final = Quantity(
    "threshold of the transistors on the oxide alone, and of M1 and M2 below the paper's film poled to saturation",
    paper.THRESHOLD_VOLTAGE.value,
    "V",
    paper.THRESHOLD_VOLTAGE.source,
    paper.THRESHOLD_VOLTAGE.assumed,
)

POLING_VOLTAGE: Final = Plausible("V", 0, 1e5, signed=True)
"""Plausible voltages across the film while it is poled."""

_REFERENCE_SHIFT: Final = paper.FILM.remnant_polarisation / paper.STACK.film
"""Pr/Cf of the paper's film, poled to saturation [V]: the state in which the threshold voltage is given."""


class FilmGeometry(enum.Enum):
    """Where the film is."""

    EXTENDED = "extended"
    """On an electrode of its own area, loaded by the gate."""
    AS_IN_PAPER = "as in paper"
    """As the paper calculates: the current as if the film covered W*L only (coupling Cpvdf/(Cpvdf + Cox), 0.0525), but
    charge and leakage with the film's own area and without the gate's load. Both cannot be true of one device."""


def quantity(of: Quantity, low: float, high: float, *, signed: bool = False) -> Any:
    """Return a dataclass field with its default from a quantity, and a plausible range; unchecked.

    Parameters
    ----------
    of : Quantity
        Name, default value, unit and source.
    low, high : float
        Plausible range in SI units; of the magnitude with `signed`.
    signed : bool, default False
        Whether either sign is possible.
    """
    return field(default=of.value, metadata={"quantity": of, "plausible": Plausible(of.unit, low, high, signed)})


@dataclass(frozen=True, kw_only=True, eq=False)
class Taxel:
    """Film, gate and bias resistor of one taxel, or of many: any field may be an array.

    The defaults are the paper's film and transistor with the coefficients of the piezo film manual.

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

    film_area: Values = quantity(paper.FORCE_AREA, 1e-12, 1e-2)
    """Area A of the film and its electrode, on which the force acts [m2]."""
    film_thickness: Values = quantity(paper.FILM_THICKNESS, 1e-8, 1e-3)
    """Thickness t of the film [m]."""
    film_permittivity: Values = quantity(paper.FILM_PERMITTIVITY, 1, 1e4)
    """Relative permittivity of the film [1]."""
    piezoelectric_coefficient: Values = quantity(paper.PIEZOELECTRIC_COEFFICIENT, 1e-14, 1e-8, signed=True)
    """d33 of the film saturated in the positive direction [C/N]."""
    pyroelectric_coefficient: Values = quantity(paper.PYROELECTRIC_COEFFICIENT, 0, 5e-3, signed=True)
    """p of the film saturated in the positive direction [C/(m2 K)], of the sign of d33."""
    coercive_field: Values = quantity(paper.COERCIVE_FIELD, 1e5, 1e10)
    """Ec of the film [V/m]."""
    remnant_polarisation: Values = quantity(paper.REMNANT_POLARISATION, 1e-5, 1.5)
    """Pr of the film [C/m2], below Ps."""
    saturation_polarisation: Values = quantity(paper.SATURATION_POLARISATION, 1e-5, 1.5)
    """Ps of the film [C/m2]."""
    poling_voltages: tuple[Values, ...] | None = None
    """Voltages across the film in the order in which they were applied to the virgin film [V], back to 0 at the end;
    None: saturated in the positive direction."""
    uncompensated_fraction: Values = quantity(paper.UNCOMPENSATED_FRACTION, 0, 1)
    """Share kappa of the polarisation that is not compensated by trapped charge and moves the threshold [1]."""
    gate_width: Values = quantity(paper.CHANNEL_WIDTH, 1e-8, 0.1)
    """Width W of the channel [m]."""
    gate_length: Values = quantity(paper.CHANNEL_LENGTH, 1e-8, 1e-2)
    """Length L of the channel [m]."""
    oxide_thickness: Values = quantity(paper.OXIDE_THICKNESS, 5e-10, 1e-5)
    """Thickness of the gate oxide [m]."""
    oxide_permittivity: Values = quantity(paper.OXIDE_PERMITTIVITY, 1, 1e3)
    """Relative permittivity of the oxide [1]."""
    electron_mobility: Values = quantity(paper.MOBILITY, 1e-5, 1)
    """Mobility of the electrons [m2/(V s)]."""
    threshold_voltage: Values = quantity(_THRESHOLD, 0, 10)
    """Threshold voltage [V] of the transistor below the paper's film, poled to saturation, and of those on the oxide
    alone. Another film, thickness or poling moves it (`threshold`)."""
    bias_resistance: Values = quantity(paper.BIAS_RESISTANCE, 1e3, 1e17)
    """Resistance R from the node to ground [ohm]: the bias resistor and all other leakage in parallel."""
    film_geometry: FilmGeometry = FilmGeometry.EXTENDED
    """Where the film is; the paper's own way of calculating is one choice."""

    def __post_init__(self) -> None:
        for name, plausible in plausible_fields(self).items():
            object.__setattr__(self, name, plausible.array(name, getattr(self, name))[()])
        if self.poling_voltages is not None:
            volts = instance("poling_voltages", self.poling_voltages, tuple)
            checked = tuple(POLING_VOLTAGE.array("poling_voltages", volt)[()] for volt in volts)
            object.__setattr__(self, "poling_voltages", checked)
        instance("film_geometry", self.film_geometry, FilmGeometry)
        _ = self.shape
        if np.any(np.greater_equal(self.remnant_polarisation, self.saturation_polarisation)):
            raise ValueError("remnant_polarisation must be below saturation_polarisation (the paper's text swaps them)")

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Shape to which all fields broadcast; () for a single taxel."""
        shapes = {name: np.shape(getattr(self, name)) for name in plausible_fields(self)}
        shapes |= {f"poling_voltages[{i}]": np.shape(volt) for i, volt in enumerate(self.poling_voltages or ())}
        try:
            return np.broadcast_shapes(*shapes.values())
        except ValueError:
            listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items() if shape)
            raise ValueError(f"shapes must broadcast together, got {listed}") from None

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


def plausible_fields(of: Any) -> dict[str, Plausible]:
    """Return the numeric fields of a design, or of its class, with their units and plausible ranges; unchecked.

    Parameters
    ----------
    of : Taxel or type
        The design or its class.
    """
    return {item.name: item.metadata["plausible"] for item in dataclasses.fields(of) if "plausible" in item.metadata}


@lru_cache(maxsize=1 << 14)
def _remnant(material: tuple[float, ...], fields: tuple[float, ...]) -> float:
    coercive, remnant, saturation = material
    return remnant_after(fields, Film(coercive, remnant, saturation, relative_permittivity=1.0))
