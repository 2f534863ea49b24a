# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.


"""Paths other than keyframes: presses that vibrate, slide, twist or move at random, and taps.

Each applies and releases its load along the curve of `minimum_jerk`, and has no load before its start and after its
end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from posfet_sim.scene.keyframes import Pose, Span, minimum_jerk

WAVES: Final = 8
"""Number of sines in each coordinate of a random path; with it the RMS value is a quarter of the amplitude."""


@dataclass(frozen=True)
class PressRelease:
    """Press, hold and release; the derived paths move or vibrate while they hold."""

    start: float
    """Time at which the load begins [s]."""
    end: float
    """Time at which the load is 0 again [s]."""
    rise: float
    """Duration of the press, and of the release [s]; at most half of the total."""
    x: float
    """Position along the columns [m]."""
    y: float
    """Position along the rows [m]."""
    angle: float
    """Angle about z [rad]."""
    load: float
    """Load while it holds: force [N] or indentation [m]."""

    def relative_load(self, time: float) -> float:
        """Return the load at a time [s] relative to the full load, in [0, 1]."""
        edge = min(time - self.start, self.end - time)
        if edge <= 0:
            return 0.0
        return 1.0 if edge >= self.rise else minimum_jerk(edge / self.rise)

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        return (self.x, self.y, self.angle, self.load * self.relative_load(time))

    def changes(self) -> list[Span]:
        """Return the interval from start to end [s]."""
        return [(self.start, self.end)]

    def max_load(self) -> float:
        """Return the load while it holds."""
        return self.load


@dataclass(frozen=True)
class Vibration(PressRelease):
    """A sine added to the load, of constant or linearly swept frequency."""

    amplitude: float
    """Amplitude in the unit of the load; at most the load."""
    frequency: float
    """Frequency at the start [Hz]."""
    end_frequency: float
    """Frequency at the end [Hz]."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        since = time - self.start
        slope = (self.end_frequency - self.frequency) / (self.end - self.start)
        wave = math.sin(2 * math.pi * since * (self.frequency + slope * since / 2))
        return (self.x, self.y, self.angle, (self.load + self.amplitude * wave) * self.relative_load(time))

    def max_load(self) -> float:
        """Return the sum of load and amplitude."""
        return self.load + self.amplitude


@dataclass(frozen=True)
class Stroke(PressRelease):
    """Slide and twist: to another position or angle and back, at constant speed, while the load is held."""

    to_x: float
    """Other position along the columns [m]."""
    to_y: float
    """Other position along the rows [m]."""
    to_angle: float
    """Other angle [rad]."""
    strokes: int
    """Number of strokes; forth and back are two."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        travelled = self.strokes * (time - self.start - self.rise) / (self.end - self.start - 2 * self.rise)
        travelled = min(max(travelled, 0.0), float(self.strokes)) % 2 if travelled < self.strokes else self.strokes % 2
        fraction = travelled if travelled <= 1 else 2 - travelled
        return (
            self.x + (self.to_x - self.x) * fraction,
            self.y + (self.to_y - self.y) * fraction,
            self.angle + (self.to_angle - self.angle) * fraction,
            self.load * self.relative_load(time),
        )


@dataclass(frozen=True)
class RandomMotion(PressRelease):
    """Random load and position, each a sum of sines of random frequency and phase."""

    amplitude: float
    """Amplitude of the load, in its unit; at most the load."""
    reach: float
    """Amplitude of x and of y [m]."""
    bandwidth: float
    """Maximum frequency [Hz]."""
    seed: int
    """Seed of frequencies and phases."""

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
        fraction = self.relative_load(time)
        if fraction == 0:
            return (self.x, self.y, self.angle, 0.0)
        load, x, y = (sum(math.sin(rate * time + phase) for rate, phase in waves) / WAVES for waves in self._waves)
        return (
            self.x + self.reach * x,
            self.y + self.reach * y,
            self.angle,
            (self.load + self.amplitude * load) * fraction,
        )

    def max_load(self) -> float:
        """Return the sum of load and amplitude."""
        return self.load + self.amplitude


@dataclass(frozen=True)
class Taps:
    """Short contacts at regular intervals."""

    start: float
    """Start of the first contact [s]."""
    contact: float
    """Duration of each contact [s]; at most the interval."""
    interval: float
    """Time from contact to contact [s]."""
    count: int
    """Number of contacts."""
    x: float
    """Position along the columns [m]."""
    y: float
    """Position along the rows [m]."""
    angle: float
    """Angle about z [rad]."""
    load: float
    """Peak load: force [N] or indentation [m]."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s] of the scene."""
        number = math.floor((time - self.start) / self.interval)
        begin = self.start + number * self.interval
        fraction = 0.0
        if 0 <= number < self.count and begin < time < begin + self.contact:  # as in `changes`, to rounding
            u = 2 * (time - begin) / self.contact
            fraction = minimum_jerk(max(min(u, 2 - u), 0.0))
        return (self.x, self.y, self.angle, self.load * fraction)

    def changes(self) -> list[Span]:
        """Return the intervals of the contacts [s]."""
        starts = [self.start + number * self.interval for number in range(self.count)]
        return [(start, start + self.contact) for start in starts]

    def max_load(self) -> float:
        """Return the peak load."""
        return self.load
