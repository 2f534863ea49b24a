# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts of the compiled path compared with those of the reference in NumPy."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

TOLERANCE: Final = {"rtol": 1e-12, "atol": 1e-12}
AREA: Final = 1e-6
"""Scale of areas [m2]."""
PITCH: Final = 1.5e-3
"""Scale of lengths [m]."""


def numbers(region: Any) -> list[float]:
    """Return all that is a number in a region."""
    return [
        *region.centre_of_pressure, *region.geometric_centre, region.force, region.force_variance, region.area,
        region.peak_pressure * AREA,
    ]  # fmt: skip


def second_moments(region: Any) -> NDArray[np.float64]:
    """Return the variances and the covariance that the principal axes stand for [pitch2].

    The axes themselves are ill-conditioned: of a line, the minor one is the root of a difference that vanishes; of a
    circle, the direction is arbitrary.
    """
    axes = np.array([region.major_axis, region.minor_axis]) / PITCH
    moments: NDArray[np.float64] = axes.T @ axes
    return moments


def assert_same(compiled: tuple[Any, ...], plain: tuple[Any, ...]) -> None:
    """Assert that contacts are those of the reference."""
    assert [(each.id, int(each.state)) for each in compiled] == [(each.id, int(each.state)) for each in plain]
    for one, other in zip(compiled, plain, strict=True):
        assert one.region.taxels.tolist() == other.region.taxels.tolist()
        assert (one.region.separated, one.split_from) == (other.region.separated, other.split_from)
        np.testing.assert_allclose(numbers(one.region), numbers(other.region), **TOLERANCE)
        np.testing.assert_allclose(second_moments(one.region), second_moments(other.region), **TOLERANCE)
        np.testing.assert_allclose([*one.velocity, one.age], [*other.velocity, other.age], **TOLERANCE)
        assert [(past.id, past.split_from) for past in one.merged] == [
            (past.id, past.split_from) for past in other.merged
        ]
        np.testing.assert_allclose(
            [[past.age, *past.offset] for past in one.merged],
            [[past.age, *past.offset] for past in other.merged],
            **TOLERANCE,
        )


def assert_same_motions(compiled: dict[int, Any], plain: dict[int, Any]) -> None:
    """Assert that vibration and slip are those of the reference."""
    assert compiled.keys() == plain.keys()
    for number, motion in compiled.items():
        assert motion.slipping == plain[number].slipping
        for name in ("power", "still"):
            np.testing.assert_allclose(getattr(motion, name), getattr(plain[number], name), **TOLERANCE)
