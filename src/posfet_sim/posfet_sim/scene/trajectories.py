"""How the objects of a scene move: position, angle and load over time.

Between two keyframes every value moves as ``v0 + (v1 - v0)*(10*u^3 - 15*u^4 + 6*u^5)``, u from 0 to 1: the path of
least jerk from rest to rest (Flash and Hogan, J. Neurosci. 5(7), 1985, eq. 1). It never overshoots, and velocity and
acceleration are 0 at each keyframe. Before the first keyframe its values hold, after the last one the last values.

Every other path presses and lifts along the same curve, and has no load before its start and after its end.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol, TypeAlias

import numpy as np

Pose: TypeAlias = tuple[float, ...]
"""x, y [m], angle about z [rad], and load: force [N] or indentation [m]."""

Span: TypeAlias = tuple[float, float]
"""Start and end of a time [s]."""

WAVES: Final = 8
"""Sines in each coordinate of a random path; its values then stay within its amplitude, at a quarter of it RMS."""


class Path(Protocol):
    """Where an object is and how hard it presses."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        ...

    def changes(self) -> list[Span]:
        """Return the times [s] in which what the object does to the array changes."""
        ...

    def top_load(self) -> float:
        """Return the greatest load: force [N] or indentation [m]."""
        ...


def least_jerk(u: float) -> float:
    """Return the share of the way done after the share u, in [0, 1], of the time."""
    return min(u * u * u * (10 + u * (6 * u - 15)), 1.0)  # rounding may carry it past 1, and a force below 0


@dataclass(frozen=True)
class Track:
    """Values over time through keyframes."""

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
        share = least_jerk((time - self.times[index]) / (self.times[index + 1] - self.times[index]))
        return tuple([a + (b - a) * share for a, b in zip(start, end, strict=True)])

    def changing(self, rests: Callable[[tuple[float, ...], tuple[float, ...]], bool]) -> list[Span]:
        """Return the parts over which `rests` (values at the start, values at the end) is not true."""
        return [
            (self.times[index], self.times[index + 1])
            for index in range(len(self.times) - 1)
            if not rests(self.values[index], self.values[index + 1])
        ]

    def changes(self) -> list[Span]:
        """Return the times in which the last value, the load, is above 0 and something changes."""
        return self.changing(lambda a, b: a == b or (a[-1] <= 0 and b[-1] <= 0))

    def top_load(self) -> float:
        """Return the greatest last value."""
        return max(values[-1] for values in self.values)


@dataclass(frozen=True)
class Touch:
    """Press on, hold, lift; the other paths do something while they hold."""

    start: float
    """Time at which the load begins [s]."""
    end: float
    """Time at which it is 0 again [s]."""
    rise: float
    """Time of the press, and of the lift [s]; at most half of the whole."""
    x: float
    y: float
    angle: float
    load: float

    def share(self, time: float) -> float:
        """Return the share of the load at a time [s], in [0, 1]."""
        edge = min(time - self.start, self.end - time)
        if edge <= 0:
            return 0.0
        return 1.0 if edge >= self.rise else least_jerk(edge / self.rise)

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        return (self.x, self.y, self.angle, self.load * self.share(time))

    def changes(self) -> list[Span]:
        """Return the whole of the touch."""
        return [(self.start, self.end)]

    def top_load(self) -> float:
        """Return the greatest load."""
        return self.load


@dataclass(frozen=True)
class Vibration(Touch):
    """A sine on top of the load, of one frequency or swept evenly from one to another."""

    amplitude: float
    """In the unit of the load; at most the load."""
    frequency: float
    """At the start [Hz]."""
    end_frequency: float
    """At the end [Hz]."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        since = time - self.start
        slope = (self.end_frequency - self.frequency) / (self.end - self.start)
        wave = math.sin(2 * math.pi * since * (self.frequency + slope * since / 2))
        return (self.x, self.y, self.angle, (self.load + self.amplitude * wave) * self.share(time))

    def top_load(self) -> float:
        """Return load and amplitude."""
        return self.load + self.amplitude


@dataclass(frozen=True)
class Stroke(Touch):
    """To another place or angle and back, at constant speed, while the load is held: slide and twist."""

    to_x: float
    to_y: float
    to_angle: float
    strokes: int
    """How many times it goes the way, there and back again counting as two."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        way = self.strokes * (time - self.start - self.rise) / (self.end - self.start - 2 * self.rise)
        way = min(max(way, 0.0), float(self.strokes)) % 2 if way < self.strokes else self.strokes % 2
        share = way if way <= 1 else 2 - way
        return (
            self.x + (self.to_x - self.x) * share,
            self.y + (self.to_y - self.y) * share,
            self.angle + (self.to_angle - self.angle) * share,
            self.load * self.share(time),
        )


@dataclass(frozen=True)
class Wander(Touch):
    """Load and place wander at random, each as a sum of sines drawn with a seed."""

    amplitude: float
    """Of the load, in its unit; at most the load."""
    reach: float
    """Of x and of y [m]."""
    bandwidth: float
    """Highest frequency [Hz]."""
    seed: int

    @cached_property
    def _waves(self) -> list[list[tuple[float, float]]]:
        """Angular frequency [rad/s] and phase [rad] of the sines in load, x and y."""
        random = np.random.default_rng(self.seed)
        rates = 2 * math.pi * self.bandwidth * random.random((3, WAVES))
        phases = 2 * math.pi * random.random((3, WAVES))
        return [
            list(zip(rate, phase, strict=True)) for rate, phase in zip(rates.tolist(), phases.tolist(), strict=True)
        ]

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        share = self.share(time)
        if share == 0:
            return (self.x, self.y, self.angle, 0.0)
        load, x, y = (sum(math.sin(rate * time + phase) for rate, phase in waves) / WAVES for waves in self._waves)
        return (
            self.x + self.reach * x,
            self.y + self.reach * y,
            self.angle,
            (self.load + self.amplitude * load) * share,
        )

    def top_load(self) -> float:
        """Return load and amplitude."""
        return self.load + self.amplitude


@dataclass(frozen=True)
class Taps:
    """Short touches at regular times."""

    start: float
    """Time of the first touch [s]."""
    contact: float
    """How long each lasts [s]; at most the interval."""
    interval: float
    """From touch to touch [s]."""
    count: int
    x: float
    y: float
    angle: float
    load: float
    """At the height of a touch."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        number = math.floor((time - self.start) / self.interval)
        share = 0.0
        if 0 <= number < self.count:
            u = 2 * (time - self.start - number * self.interval) / self.contact
            share = least_jerk(max(min(u, 2 - u), 0.0))
        return (self.x, self.y, self.angle, self.load * share)

    def changes(self) -> list[Span]:
        """Return the times of the touches."""
        starts = [self.start + number * self.interval for number in range(self.count)]
        return [(start, start + self.contact) for start in starts]

    def top_load(self) -> float:
        """Return the load at the height of a touch."""
        return self.load
