# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.


"""Paths by keyframes, from rest to rest.

Keyframes are connected by minimum-jerk trajectories: ``v0 + (v1 - v0)*(10*u^3 - 15*u^4 + 6*u^5)``, u from 0 to 1, from
rest to rest (Flash and Hogan, J. Neurosci. 5(7), 1985, eq. 1). There is no overshoot, and velocity and acceleration are
0 at each keyframe. Values are constant before the first and after the last keyframe.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

Pose: TypeAlias = tuple[float, ...]
"""x, y [m], angle about z [rad], and load: force [N] or indentation [m]."""

Span: TypeAlias = tuple[float, float]
"""Start and end of an interval [s]."""


class Path(Protocol):
    """Position, angle and load of an object over time."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        ...

    def changes(self) -> list[Span]:
        """Return the intervals [s] in which the effect of the object on the array changes."""
        ...

    def max_load(self) -> float:
        """Return the maximum load: force [N] or indentation [m]."""
        ...


def minimum_jerk(u: float) -> float:
    """Return the minimum-jerk position in [0, 1] at the normalised time u.

    Parameters
    ----------
    u : float
        Time since the previous keyframe over the interval [1], in [0, 1].

    Examples
    --------
    >>> minimum_jerk(0.25)
    0.103515625
    """
    return min(u * u * u * (10 + u * (6 * u - 15)), 1.0)  # rounding may exceed 1, and make a force negative


@dataclass(frozen=True)
class Keyframes:
    """Values over time, with minimum-jerk trajectories between keyframes."""

    times: tuple[float, ...]
    """Times of the keyframes [s], ascending, at least one."""
    values: tuple[tuple[float, ...], ...]
    """Values at each keyframe."""

    def at(self, time: float) -> tuple[float, ...]:
        """Return the values at a time [s] of the scene."""
        index = bisect_right(self.times, time) - 1
        if index < 0:
            return self.values[0]
        start = self.values[index]
        if index + 1 == len(self.times):
            return start
        end = self.values[index + 1]
        if start == end:
            return start
        fraction = minimum_jerk((time - self.times[index]) / (self.times[index + 1] - self.times[index]))
        return tuple([a + (b - a) * fraction for a, b in zip(start, end, strict=True)])

    def changing(self, constant: Callable[[tuple[float, ...], tuple[float, ...]], bool]) -> list[Span]:
        """Return the intervals [s] for which `constant` (values at the start, values at the end) is false."""
        return [
            (self.times[index], self.times[index + 1])
            for index in range(len(self.times) - 1)
            if not constant(self.values[index], self.values[index + 1])
        ]

    def changes(self) -> list[Span]:
        """Return the intervals [s] in which the last value, the load, is above 0 and a value changes."""
        return self.changing(lambda a, b: a == b or (a[-1] <= 0 and b[-1] <= 0))

    def max_load(self) -> float:
        """Return the maximum of the last value, the load."""
        return max(values[-1] for values in self.values)
