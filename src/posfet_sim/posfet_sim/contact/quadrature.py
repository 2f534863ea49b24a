# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Quadrature rules for the pressure profiles of contact mechanics, on unit lengths.

A rule represents a pressure over an area by weighted points: the sum of weights times a smooth function at the points
is the integral of pressure times that function, and the weights sum to 1. The root or singularity at the edge of each
profile is in the weights, so that few points suffice. All rules lie within [-1, 1] and are symmetric.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Line: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Points and weights of a profile along one axis, both of shape [points]."""


@dataclass(frozen=True, eq=False)
class DiscRule:
    """Points of a pressure on the unit disc; only those with x > 0, as the rule is symmetric."""

    x: NDArray[np.float64]
    """Positive coordinates, shape [n/2]."""
    both: NDArray[np.float64]
    """x, then -x, shape [n]."""
    x_weight: NDArray[np.float64]
    """Weights of x, shape [n/2]; the sum is 1/2."""
    y: NDArray[np.float64]
    """Coordinates along y for each x, shape [n/2, n]."""
    y_weight: NDArray[np.float64]
    """Weights of y, shape [n]; the sum is 1."""


@lru_cache(maxsize=128)
def hertz_disc(order: int) -> DiscRule:
    """Return `order` (even) times `order` points of the pressure sqrt(1 - x^2 - y^2), exact to degree 2*order - 1.

    With y = sqrt(1 - x^2)*u the weight becomes (1 - x^2)*sqrt(1 - u^2): Gauss-Jacobi (1, 1) points in x by the
    eigenvalues of the Jacobi matrix (Golub and Welsch, Math. Comp. 23, 1969), Gauss-Chebyshev of the second kind
    in u.

    Parameters
    ----------
    order : int
        Number of points along one axis, even.
    """
    k = np.arange(1, order)
    side = np.sqrt(k * (k + 2) / ((2 * k + 1) * (2 * k + 3)))
    x, vectors = np.linalg.eigh(np.diag(side, 1) + np.diag(side, -1))
    return _disc(x, vectors[0] ** 2, half_ellipse(order))


@lru_cache(maxsize=128)
def flat_disc(order: int) -> DiscRule:
    """Return `order` (even) times `order` points of the pressure 1/sqrt(1 - x^2 - y^2), exact to degree 2*order - 1.

    With y = sqrt(1 - x^2)*u the weight becomes 1/sqrt(1 - u^2): Gauss-Legendre points in x, Gauss-Chebyshev of the
    first kind in u.

    Parameters
    ----------
    order : int
        Number of points along one axis, even.
    """
    return _disc(*uniform(order), inverse_root(order))


def _disc(x: NDArray[np.float64], weight: NDArray[np.float64], chord: Line) -> DiscRule:
    right = slice(len(x) // 2, None)
    return DiscRule(
        x=x[right],
        both=np.concatenate([x[right], -x[right]]),
        x_weight=weight[right] * (0.5 / weight[right].sum()),
        y=np.sqrt(1 - x[right, None] ** 2) * chord[0],
        y_weight=chord[1],
    )


@lru_cache(maxsize=256)
def uniform(order: int) -> Line:
    """Return Gauss-Legendre points, for a uniform pressure."""
    points, weights = np.polynomial.legendre.leggauss(order)
    return points, weights / 2


@lru_cache(maxsize=256)
def uniform_both(order: int) -> Line:
    """Return `uniform` for an even `order`: points above 0, then their mirror images; weights of the former only."""
    points, weights = uniform(order)
    right = slice(order // 2, None)
    return np.concatenate([points[right], -points[right]]), weights[right]


@lru_cache(maxsize=128)
def half_ellipse(order: int) -> Line:
    """Return Gauss-Chebyshev points of the second kind, for the pressure sqrt(1 - x^2) of a cylinder."""
    angle = np.arange(1, order + 1) * math.pi / (order + 1)
    return np.cos(angle), np.sin(angle) ** 2 * 2 / (order + 1)


@lru_cache(maxsize=128)
def inverse_root(order: int) -> Line:
    """Return Gauss-Chebyshev points of the first kind, for the pressure 1/sqrt(1 - x^2) of a flat indenter."""
    return np.cos((np.arange(order) + 0.5) * math.pi / order), np.full(order, 1 / order)


@lru_cache(maxsize=128)
def wedge(order: int) -> Line:
    """Return points for the pressure acosh(1/|x|) of a wedge.

    It is the mean of 1/sqrt(r^2 - x^2)/pi over r from |x| to 1, so its points are those of `inverse_root` scaled by
    Gauss-Legendre points of [0, 1].

    Parameters
    ----------
    order : int
        Number of points of each of the two rules.
    """
    scale, scale_weight = uniform(order // 2)
    chord, chord_weight = inverse_root(order)
    points = np.multiply.outer((scale + 1) / 2, chord)
    return points.ravel(), np.multiply.outer(scale_weight, chord_weight).ravel()
