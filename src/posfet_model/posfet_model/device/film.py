"""The ferroelectric film: Miller's hysteresis branches, minor loops, memory of poling, and d33 after it.

The saturated loop has a rising and a falling branch (the paper, eq. 2-4; S. L. Miller et al., J. Appl. Phys., 1990):

    P+(E) = Ps*tanh((E - Ec)/(2*delta)) + epsF*eps0*E,    P-(E) = -P+(-E)
    delta = Ec/ln((1 + Pr/Ps)/(1 - Pr/Ps))

A field that turns before saturation runs on a branch of the same shape, scaled to pass through the point where it
turned and the turning point it is heading back to (B. Jiang, P. Zurcher, R. E. Jones, US patent 5867405, 1999; the
question is that of S. L. Miller et al., J. Appl. Phys., 1991). Turning points that the field has passed again are
forgotten. So minor loops close, lie within each other, and stay within the saturated loop; see Notes of `polarise`.

Polarisation is in C/m2 (1 uC/cm2 = 0.01 C/m2), field in V/m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import common_dtype, instance, real_array, real_number, whole_number
from posfet_model.device.constants import VACUUM_PERMITTIVITY

FIELD_LIMIT: Final = 1e12
"""Largest accepted magnitude of a field [V/m], a thousand times any film's breakdown."""

POLARISATION_LIMIT: Final = 10.0
"""Largest accepted polarisation [C/m2]; the largest known of any ferroelectric is near 1.5."""

COERCIVE_FIELD_RANGE: Final = (1.0, 1e12)
"""Accepted coercive fields [V/m]."""

_NEAREST_TO_SATURATION: Final = 1e-9


@dataclass(frozen=True)
class Film:
    """A ferroelectric film; ValueError when a value is out of range or the remnant polarisation is not below Ps.

    coercive_field : Ec [V/m], in [1, 1e12]. The field at which the switched part crosses zero.
    remnant_polarisation : Pr [C/m2], in (0, Ps).
    saturation_polarisation : Ps [C/m2], in (0, 10].
    relative_permittivity : epsF [1], in [1, 1e5].
    """

    coercive_field: float
    remnant_polarisation: float
    saturation_polarisation: float
    relative_permittivity: float

    def __post_init__(self) -> None:
        branch_steepness(self.coercive_field, self.remnant_polarisation, self.saturation_polarisation)
        real_number("relative_permittivity", self.relative_permittivity, 1, 1e5)

    @property
    def steepness(self) -> float:
        """The branch steepness delta [V/m], eq. (3)."""
        return branch_steepness(self.coercive_field, self.remnant_polarisation, self.saturation_polarisation)

    @property
    def switched_polarisation(self) -> float:
        """Psw = Ps + Pr [C/m2], eq. (5): from one remnant state to saturation in the other direction."""
        return self.saturation_polarisation + self.remnant_polarisation


@dataclass(frozen=True)
class TurningPoint:
    """Where the field turned round: field [V/m], infinite for saturation, and switched polarisation [C/m2]."""

    field: float
    switched: float


@dataclass(frozen=True)
class History:
    """What a film remembers: the present point, the way it came (+1, -1, 0 for none), turning points not passed again.

    The turning points alternate between upper and lower and close in on the present point: the last one is where the
    present branch began, the one before is where it is heading. ValueError when they do not.
    """

    field: float
    switched: float
    direction: int
    turning_points: tuple[TurningPoint, ...]

    def __post_init__(self) -> None:
        real_number("field", self.field, -FIELD_LIMIT, FIELD_LIMIT)
        real_number("switched", self.switched, -POLARISATION_LIMIT, POLARISATION_LIMIT)
        whole_number("direction", self.direction, -1, 1)
        low, high, side = self.field, self.field, self.direction
        for point in reversed(instance("turning_points", self.turning_points, tuple)):
            field = instance("turning_points", point, TurningPoint).field
            if not math.isinf(field):
                field = real_number("turning_points", field, -FIELD_LIMIT, FIELD_LIMIT)
            if side == 0 or (side > 0 and field > low) or (side < 0 and field < high):
                raise ValueError(f"turning_points must alternate and close in on the field, got {self.turning_points}")
            low, high, side = min(low, field), max(high, field), -side


@dataclass(frozen=True)
class Poling:
    """Outcome of a poling sequence: polarisation [C/m2] at each of its fields, and the film's memory at the end."""

    polarisation: NDArray[np.float64]
    history: History


VIRGIN: Final = History(field=0.0, switched=0.0, direction=0, turning_points=())
"""A film that has never been poled: no polarisation at no field."""


def branch_steepness(coercive_field: float, remnant_polarisation: float, saturation_polarisation: float) -> float:
    """Return delta [V/m] of eq. (3): ``delta = Ec/ln((1 + Pr/Ps)/(1 - Pr/Ps)) = Ec/(2*artanh(Pr/Ps))``.

    Parameters
    ----------
    coercive_field : float
        Ec [V/m], in [1, 1e12].
    remnant_polarisation : float
        Pr [C/m2], in (0, Ps); Pr/Ps at most 1 - 1e-9.
    saturation_polarisation : float
        Ps [C/m2], in (0, 10].

    Raises
    ------
    ValueError
        An argument is not a real number, not finite or out of range, Pr >= Ps included.

    Notes
    -----
    The paper's text gives Pr = 5 and Ps = 2 uC/cm2, swapped: the logarithm's argument would be -2.333. Taking the
    logarithm of its magnitude would hide that, so it is an error here. The printed form is in
    `posfet_model.device.as_printed`.

    Examples
    --------
    >>> print(f"{branch_steepness(160e5, 0.02, 0.05):.5g}")
    1.8884e+07
    """
    coercive_field = real_number("coercive_field", coercive_field, *COERCIVE_FIELD_RANGE)
    saturation_polarisation = real_number("saturation_polarisation", saturation_polarisation, 1e-9, POLARISATION_LIMIT)
    low, high = 1e-9 * saturation_polarisation, (1 - _NEAREST_TO_SATURATION) * saturation_polarisation
    remnant_polarisation = real_number("remnant_polarisation", remnant_polarisation)
    if not low <= remnant_polarisation <= high:
        raise ValueError(
            f"remnant_polarisation must be in [{low:g}, {high:g}], below the saturation polarisation "
            f"{saturation_polarisation:g}, got {remnant_polarisation:g}"
        )
    return coercive_field / (2 * math.atanh(remnant_polarisation / saturation_polarisation))


def rising_branch(field: ArrayLike, film: Film) -> FloatArray:
    """Return P+(E) [C/m2], the saturated branch on which the field rises, eq. (2).

    Parameters
    ----------
    field : array_like
        E [V/m], within +-1e12, any shape.
    film : Film
        The film.

    Raises
    ------
    ValueError
        The field is not real, not finite or out of range.

    Notes
    -----
    Through (0, -Pr). The switched part crosses zero at Ec; the whole polarisation crosses zero earlier, because the
    linear term has grown to epsF*eps0*Ec there (with Table I at 148 instead of 160 kV/cm).

    Examples
    --------
    >>> film = Film(160e5, 0.02, 0.05, 12.0)
    >>> print(f"{rising_branch(0.0, film):.5f} {rising_branch(148e5, film):.5f} {rising_branch(160e5, film):.5f}")
    -0.02000 -0.00002 0.00170
    """
    field = real_array("field", field, -FIELD_LIMIT, FIELD_LIMIT)
    film = instance("film", film, Film)
    turned: FloatArray = np.tanh((field - film.coercive_field) / (2 * film.steepness))
    return film.saturation_polarisation * turned + film.relative_permittivity * VACUUM_PERMITTIVITY * field


def falling_branch(field: ArrayLike, film: Film) -> FloatArray:
    """Return P-(E) = -P+(-E) [C/m2], the saturated branch on which the field falls, eq. (4).

    Parameters and errors as in `rising_branch`.

    Examples
    --------
    >>> print(f"{falling_branch(0.0, Film(160e5, 0.02, 0.05, 12.0)):.6f}")
    0.020000
    """
    return -rising_branch(-real_array("field", field, -FIELD_LIMIT, FIELD_LIMIT), film)


def saturated(film: Film, *, positive: bool) -> History:
    """Return the memory of a film that has been saturated and brought back to no field, its polarisation +-Pr."""
    film = instance("film", film, Film)
    sign = 1 if positive else -1
    came_from = TurningPoint(sign * math.inf, sign * film.saturation_polarisation)
    return History(0.0, sign * film.remnant_polarisation, -sign, (came_from,))


def polarise(fields: ArrayLike, film: Film, history: History = VIRGIN) -> Poling:
    """Apply a sequence of fields [V/m] one after the other and return polarisation [C/m2] and memory.

    Parameters
    ----------
    fields : array_like
        Shape (n,), n >= 0, each within +-1e12 V/m. Between two of them the field moves straight from one to the next;
        the model knows no rate, so intermediate values change nothing.
    film : Film
        The film.
    history : History, default VIRGIN
        Where the film starts; `VIRGIN`, `saturated(...)` or the history of an earlier poling.

    Returns
    -------
    Poling
        polarisation, shape (n,) float64, and history, from which another call goes on.

    Raises
    ------
    ValueError
        The fields are not a sequence of real numbers within range.

    Notes
    -----
    From the point (E0, P0) towards the turning point (Et, Pt), rising,
    ``P(E) = Pt + (P0 - Pt)*(S(Et) - S(E))/(S(Et) - S(E0))`` with ``S(E) = Ps*tanh((E - Ec)/(2*delta))``; when no
    turning point is left, (Et, Pt) is (infinity, Ps). Falling is the mirror image. A film never poled starts at no
    polarisation towards saturation, and where it first turns it heads for the mirror image of that point, so that its
    loops are symmetric and their tips lie on the curve of first poling. Since dS+/dS- rises with the field,
    a rising branch between two points lies below the falling one between them, hence loops are nested and bounded by
    the saturated loop; and since both pass through both points, they close.

    Miller et al. (1991) give a differential equation, dP/dE = Gamma*dPs/dE, instead. It has to be integrated, and its
    minor loops do not close: between Ec/2 and 2*Ec the upper end creeps from 2.66 to 2.94 uC/cm2 within six cycles.

    The error is a few roundings of Ps at each turn and does not add up: a turning point passed again is reached
    exactly. Time grows with n and hardly with the number of turning points.

    Examples
    --------
    Poled with +40 V and then -25 V across 2.5 um, and left alone:

    >>> film = Film(160e5, 0.02, 0.05, 12.0)
    >>> [f"{value:.5f}" for value in polarise([160e5, 0, -100e5, 0], film).polarisation]
    ['0.01599', '0.00229', '-0.00882', '-0.00049']
    """
    fields = real_array("fields", fields, -FIELD_LIMIT, FIELD_LIMIT)
    if fields.ndim != 1:
        raise ValueError(f"fields must be of shape (n,), got {fields.shape}")
    switched = np.empty(fields.shape)
    walker = _Walker(instance("film", film, Film), instance("history", history, History))
    for index, field in enumerate(fields.tolist()):
        switched[index] = walker.go_to(field)
    linear = film.relative_permittivity * VACUUM_PERMITTIVITY * fields.astype(np.float64)
    return Poling(switched + linear, walker.history())


def remnant_after(fields: ArrayLike, film: Film, history: History = VIRGIN) -> float:
    """Return the polarisation [C/m2] that remains once the sequence is over and the field is zero again.

    Parameters and errors as in `polarise`. Between -Pr and Pr.

    Examples
    --------
    >>> film = Film(160e5, 0.02, 0.05, 12.0)
    >>> [f"{remnant_after([volt / 2.5e-6], film):.5f}" for volt in (20, 40, 80, 160)]
    ['0.00057', '0.00229', '0.00788', '0.01675']
    """
    return float(polarise([0.0], film, polarise(fields, film, history).history).polarisation[0])


def piezoelectric_coefficient(
    remnant_polarisation: ArrayLike, film: Film, saturated_coefficient: ArrayLike
) -> FloatArray:
    """Return d33 [C/N] of a film with the given remnant polarisation: ``d33 = d33_sat*P/Pr``.

    Parameters
    ----------
    remnant_polarisation : array_like
        P [C/m2] at no field, within [-Pr, Pr] (to 1e-12 of Pr, for rounding).
    film : Film
        The film.
    saturated_coefficient : array_like
        d33_sat [C/N] of the film saturated and back at P = +Pr, within +-1e-6.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The paper does not give it. In a polar polymer the effect is electrostriction about the remnant polarisation,
    d33 = 2*Q33*eps33*P (T. Furukawa, IEEE Trans. Electr. Insul., 1989), hence proportional to P and of
    opposite sign for opposite poling. The field dependence of eps33 is left out.
    """
    limit = instance("film", film, Film).remnant_polarisation * (1 + 1e-12)
    remnant, coefficient = common_dtype(
        remnant_polarisation=real_array("remnant_polarisation", remnant_polarisation, -limit, limit),
        saturated_coefficient=real_array("saturated_coefficient", saturated_coefficient, -1e-6, 1e-6),
    )
    return coefficient * (remnant / film.remnant_polarisation)


class _Walker:
    """The point that moves along the branches; plain floats, because a sequence is walked one field at a time."""

    def __init__(self, film: Film, history: History) -> None:
        for switched in (history.switched, *(point.switched for point in history.turning_points)):
            real_number("history.switched", switched, -film.saturation_polarisation, film.saturation_polarisation)
        self._saturation = film.saturation_polarisation
        self._centre = film.coercive_field
        self._steepness = film.steepness
        self._field = history.field
        self._switched = history.switched
        self._direction = history.direction
        # The last one is where the present branch began; the one before is where the branch is heading.
        self._turns = [(point.field, point.switched) for point in history.turning_points]

    def history(self) -> History:
        """The memory at the present point."""
        turns = tuple(TurningPoint(*turn) for turn in self._turns)
        return History(self._field, self._switched, self._direction, turns)

    def go_to(self, field: float) -> float:
        """Move the field straight to the given one; return the switched polarisation there."""
        if field == self._field:
            return self._switched
        direction = 1 if field > self._field else -1
        if self._direction == -direction:
            if not self._turns:  # first turn of a film never saturated
                self._turns.append((-self._field, -self._switched))
            self._turns.append((self._field, self._switched))
        self._direction = direction
        while len(self._turns) > 1 and direction * (field - self._turns[-2][0]) >= 0:
            self._field, self._switched = self._turns[-2]
            del self._turns[-2:]
        if len(self._turns) == 1 and math.isfinite(self._turns[0][0]):  # back on the curve of first poling
            self._turns.clear()
        if field != self._field:
            self._switched = direction * self._risen(direction, direction * field)
            self._field = field
        return self._switched

    def _risen(self, direction: int, field: float) -> float:
        """The switched polarisation further up the present branch; a falling one is mirrored to rise."""
        target, limit = (
            self._turns[-2] if len(self._turns) > 1 else (direction * math.inf, direction * self._saturation)
        )
        start = (direction * self._field - self._centre) / self._steepness
        here = (field - self._centre) / self._steepness
        end = (direction * target - self._centre) / self._steepness
        if not start < end:  # the loop is narrower than a rounding
            return direction * limit
        # (tanh(end/2) - tanh(here/2))/(tanh(end/2) - tanh(start/2)), with no difference of near numbers, no overflow
        weight = math.expm1(here - end) / math.expm1(start - end)
        weight *= math.exp(max(start, 0.0) - max(here, 0.0))
        weight *= (1 + math.exp(-abs(start))) / (1 + math.exp(-abs(here)))
        return direction * limit + direction * (self._switched - limit) * weight
