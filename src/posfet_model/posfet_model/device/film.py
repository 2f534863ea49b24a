# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The ferroelectric film: Miller's hysteresis branches, minor loops, poling history, and the resulting d33.

The saturated loop has a rising and a falling branch (the paper, eq. 2-4; S. L. Miller et al., J. Appl. Phys., 1990):

    P+(E) = Ps*tanh((E - Ec)/(2*delta)) + epsF*eps0*E,    P-(E) = -P+(-E)
    delta = Ec/ln((1 + Pr/Ps)/(1 - Pr/Ps))

A field that reverses before saturation follows a branch of the same shape, scaled to pass through the reversal point
and the turning point towards which it returns (B. Jiang, P. Zurcher, R. E. Jones, US patent 5867405, 1999; the problem
is that of S. L. Miller et al., J. Appl. Phys., 1991). Turning points that the field passes again are erased. Minor
loops are therefore closed and nested, and stay within the saturated loop; see Notes of `polarise`.

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
"""Largest accepted magnitude of a field [V/m], a thousand times the breakdown field of any film."""

POLARISATION_LIMIT: Final = 10.0
"""Largest accepted polarisation [C/m2]; the largest known of any ferroelectric is near 1.5."""

COERCIVE_FIELD_RANGE: Final = (1.0, 1e12)
"""Accepted coercive fields [V/m]."""

_NEAREST_TO_SATURATION: Final = 1e-9


@dataclass(frozen=True)
class Film:  # numpydoc ignore=PR02
    """A ferroelectric film.

    Parameters
    ----------
    coercive_field : float
        Ec [V/m], in [1, 1e12]: the field at which the switched part crosses zero.
    remnant_polarisation : float
        Pr [C/m2], in (0, Ps).
    saturation_polarisation : float
        Ps [C/m2], in (0, 10].
    relative_permittivity : float
        epsF [1], in [1, 1e5].

    Raises
    ------
    ValueError
        A value is out of range, or the remnant polarisation is not below Ps.
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
    """A reversal of the field: field [V/m], infinite for saturation, and switched polarisation [C/m2]."""

    field: float
    switched: float


@dataclass(frozen=True)
class History:  # numpydoc ignore=PR02
    """State of a film: present point, direction from which it was reached, and turning points still in memory.

    The turning points alternate between upper and lower and close in on the present point: the last one is where the
    present branch began, the one before is the point towards which it runs.

    Parameters
    ----------
    field : float
        Present field [V/m].
    switched : float
        Present switched polarisation [C/m2].
    direction : int
        +1 when the field was rising, -1 when it was falling, 0 for a virgin film.
    turning_points : tuple of TurningPoint
        Turning points that have not been passed again, oldest first.

    Raises
    ------
    ValueError
        A value is out of range, or the turning points do not alternate and close in on the present point.
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
    """Result of a poling sequence: polarisation [C/m2] at each of its fields, and the film's history at the end."""

    polarisation: NDArray[np.float64]
    history: History


VIRGIN: Final = History(field=0.0, switched=0.0, direction=0, turning_points=())
"""A film that has never been poled: zero polarisation at zero field."""


def branch_steepness(coercive_field: float, remnant_polarisation: float, saturation_polarisation: float) -> float:
    """Return delta [V/m] of eq. (3): ``delta = Ec/ln((1 + Pr/Ps)/(1 - Pr/Ps)) = Ec/ln((Ps + Pr)/(Ps - Pr))``.

    Parameters
    ----------
    coercive_field : float
        Ec [V/m], in [1, 1e12].
    remnant_polarisation : float
        Pr [C/m2], in (0, Ps); Pr/Ps at most 1 - 1e-9.
    saturation_polarisation : float
        Ps [C/m2], in (0, 10].

    Returns
    -------
    float
        delta [V/m].

    Raises
    ------
    ValueError
        An argument is not a real number, not finite or out of range, including Pr >= Ps.

    Notes
    -----
    Accurate to a few roundings for all accepted polarisations, up to Pr/Ps = 1 - 1e-9.

    The paper's text swaps the values and gives Pr = 5 and Ps = 2 uC/cm2: the argument of the logarithm would be -2.333.
    Taking the logarithm of its magnitude would hide the mistake, so it is an error here. The printed form is in
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
    # Not of the quotient Pr/Ps, whose rounding is amplified by 1/(1 - Pr/Ps); the difference is exact near saturation.
    switched = 2 * remnant_polarisation / (saturation_polarisation - remnant_polarisation)
    return coercive_field / math.log1p(switched)


def rising_branch(field: ArrayLike, film: Film) -> FloatArray:
    """Return P+(E) [C/m2], the saturated branch for a rising field, eq. (2).

    Parameters
    ----------
    field : array_like
        E [V/m], within +-1e12, any shape.
    film : Film
        The film.

    Returns
    -------
    ndarray
        P+ [C/m2], of the shape of `field`.

    Raises
    ------
    ValueError
        The field is not real, not finite or out of range.

    Notes
    -----
    The branch passes through (0, -Pr). The switched part crosses zero at Ec; the total polarisation crosses zero
    earlier, because the linear term has grown to epsF*eps0*Ec there (with Table I at 148 instead of 160 kV/cm).

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
    """Return P-(E) = -P+(-E) [C/m2], the saturated branch for a falling field, eq. (4).

    Parameters
    ----------
    field : array_like
        E [V/m], within +-1e12, any shape.
    film : Film
        The film.

    Returns
    -------
    ndarray
        P- [C/m2], of the shape of `field`.

    Raises
    ------
    ValueError
        The field is not real, not finite or out of range.

    Examples
    --------
    >>> print(f"{falling_branch(0.0, Film(160e5, 0.02, 0.05, 12.0)):.6f}")
    0.020000
    """
    return -rising_branch(-real_array("field", field, -FIELD_LIMIT, FIELD_LIMIT), film)


def saturated(film: Film, *, positive: bool) -> History:
    """Return the history of a film that was saturated and returned to zero field, where its polarisation is +-Pr.

    Parameters
    ----------
    film : Film
        The film.
    positive : bool
        Whether it was saturated in the positive direction.

    Returns
    -------
    History
        Zero field and a switched polarisation of +-Pr.
    """
    film = instance("film", film, Film)
    sign = 1 if positive else -1
    came_from = TurningPoint(sign * math.inf, sign * film.saturation_polarisation)
    return History(0.0, sign * film.remnant_polarisation, -sign, (came_from,))


def polarise(fields: ArrayLike, film: Film, history: History = VIRGIN) -> Poling:
    """Apply a sequence of fields and return the polarisation at each of them, and the history at the end.

    Parameters
    ----------
    fields : array_like
        E [V/m], shape (n,), n >= 0, each within +-1e12. Between two of them the field changes monotonically; the model
        is rate-independent, so intermediate values change nothing.
    film : Film
        The film.
    history : History, default VIRGIN
        Initial state: `VIRGIN`, `saturated(...)` or the history of an earlier poling.

    Returns
    -------
    Poling
        Polarisation, shape (n,) float64, and the history from which another call continues.

    Raises
    ------
    ValueError
        The fields are not a sequence of real numbers within range.

    Notes
    -----
    From the point (E0, P0) towards the turning point (Et, Pt), rising,
    ``P(E) = Pt + (P0 - Pt)*(S(Et) - S(E))/(S(Et) - S(E0))`` with ``S(E) = Ps*tanh((E - Ec)/(2*delta))``; when no
    turning point is left, (Et, Pt) is (infinity, Ps). A falling branch is the mirror image. A virgin film starts at
    zero polarisation towards saturation, and after its first reversal runs towards the mirror image of the reversal
    point, so that its loops are symmetric and their tips lie on the virgin curve. Since dS+/dS- rises with the field, a
    rising branch between two points lies below the falling one between them, hence loops are nested and bounded by the
    saturated loop; and since both pass through both points, they close.

    Miller et al. (1991) give a differential equation, dP/dE = Gamma*dPs/dE, instead. It has to be integrated, and its
    minor loops do not close: between Ec/2 and 2*Ec the upper end creeps from 2.66 to 2.94 uC/cm2 within six cycles.

    The error is a few roundings of Ps at each reversal and does not accumulate: a turning point passed again is reached
    exactly. The computing time grows with n and hardly with the number of turning points.

    Examples
    --------
    Poled with +40 V and then -25 V across 2.5 um, with a return to zero field after each:

    >>> film = Film(160e5, 0.02, 0.05, 12.0)
    >>> [f"{value:.5f}" for value in polarise([160e5, 0, -100e5, 0], film).polarisation]
    ['0.01599', '0.00229', '-0.00882', '-0.00049']
    """
    fields = real_array("fields", fields, -FIELD_LIMIT, FIELD_LIMIT)
    if fields.ndim != 1:
        raise ValueError(f"fields must be of shape (n,), got {fields.shape}")
    switched = np.empty(fields.shape)
    tracer = _BranchTracer(instance("film", film, Film), instance("history", history, History))
    for index, field in enumerate(fields.tolist()):
        switched[index] = tracer.go_to(field)
    linear = film.relative_permittivity * VACUUM_PERMITTIVITY * fields.astype(np.float64)
    return Poling(switched + linear, tracer.history())


def remnant_after(fields: ArrayLike, film: Film, history: History = VIRGIN) -> float:
    """Return the polarisation [C/m2] that remains after a sequence of fields, when the field is zero again.

    Parameters
    ----------
    fields : array_like
        E [V/m], shape (n,), n >= 0, each within +-1e12.
    film : Film
        The film.
    history : History, default VIRGIN
        Initial state, as in `polarise`.

    Returns
    -------
    float
        Polarisation [C/m2], in [-Pr, Pr].

    Raises
    ------
    ValueError
        The fields are not a sequence of real numbers within range.

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
        P [C/m2] at zero field, within [-Pr, Pr] (to 1e-12 of Pr, for rounding).
    film : Film
        The film.
    saturated_coefficient : array_like
        d33_sat [C/N] of the film at P = +Pr, after saturation, within +-1e-6.

    Returns
    -------
    ndarray
        d33 [C/N], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The paper does not give it. In a polar polymer the effect is electrostriction about the remnant polarisation,
    d33 = 2*Q33*eps33*P (T. Furukawa, IEEE Trans. Electr. Insul., 1989), hence proportional to P and of opposite sign
    for opposite poling. The field dependence of eps33 is neglected.
    """
    limit = instance("film", film, Film).remnant_polarisation * (1 + 1e-12)
    remnant, coefficient = common_dtype(
        remnant_polarisation=real_array("remnant_polarisation", remnant_polarisation, -limit, limit),
        saturated_coefficient=real_array("saturated_coefficient", saturated_coefficient, -1e-6, 1e-6),
    )
    return coefficient * (remnant / film.remnant_polarisation)


class _BranchTracer:
    """Traces the branches, one field at a time, in plain floats."""

    def __init__(self, film: Film, history: History) -> None:
        for switched in (history.switched, *(point.switched for point in history.turning_points)):
            real_number("history.switched", switched, -film.saturation_polarisation, film.saturation_polarisation)
        self._saturation = film.saturation_polarisation
        self._centre = film.coercive_field
        self._steepness = film.steepness
        self._field = history.field
        self._switched = history.switched
        self._direction = history.direction
        # The last one is where the present branch began; the one before is the point towards which it runs.
        self._turns = [(point.field, point.switched) for point in history.turning_points]

    def history(self) -> History:
        """Return the history at the present point."""
        turns = tuple(TurningPoint(*turn) for turn in self._turns)
        return History(self._field, self._switched, self._direction, turns)

    def go_to(self, field: float) -> float:
        """Change the field monotonically to the given one; return the switched polarisation there."""
        if field == self._field:
            return self._switched
        direction = 1 if field > self._field else -1
        if self._direction == -direction:
            if not self._turns:  # first reversal of a virgin film
                self._turns.append((-self._field, -self._switched))
            self._turns.append((self._field, self._switched))
        self._direction = direction
        while len(self._turns) > 1 and direction * (field - self._turns[-2][0]) >= 0:
            self._field, self._switched = self._turns[-2]
            del self._turns[-2:]
        if len(self._turns) == 1 and math.isfinite(self._turns[0][0]):  # back on the virgin curve
            self._turns.clear()
        if field != self._field:
            self._switched = direction * self._risen(direction, direction * field)
            self._field = field
        return self._switched

    def _risen(self, direction: int, field: float) -> float:
        """Return the switched polarisation further along the present branch; a falling branch is mirrored to rise."""
        target, limit = (
            self._turns[-2] if len(self._turns) > 1 else (direction * math.inf, direction * self._saturation)
        )
        start = (direction * self._field - self._centre) / self._steepness
        here = (field - self._centre) / self._steepness
        end = (direction * target - self._centre) / self._steepness
        if not start < end:  # the loop is narrower than rounding
            return direction * limit
        # (tanh(end/2) - tanh(here/2))/(tanh(end/2) - tanh(start/2)) without cancellation and overflow
        weight = math.expm1(here - end) / math.expm1(start - end)
        weight *= math.exp(max(start, 0.0) - max(here, 0.0))
        weight *= (1 + math.exp(-abs(start))) / (1 + math.exp(-abs(here)))
        return direction * limit + direction * (self._switched - limit) * weight
