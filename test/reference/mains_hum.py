# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the estimation of mains hum, in NumPy; posfet_core/mains_hum.hpp says what it does."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from reference.hum_filter import ORDERS, HumFilter
from reference.reductions import any_true

FREQUENCIES: Final = (50.0, 60.0)
"""Nominal mains frequencies [Hz]."""

WINDOW: Final = 0.1
"""Window in which a phase is measured [s]: whole periods of each of `FREQUENCIES`."""

SCANS_PER_PERIOD: Final = 2.5
"""Least number of scans in a period with which the hum is distinguishable from other signals [1]."""

LEAST_RATE: Final = 0.9
"""Share of that to which the rate of a window's scans may fall [1]: some are lost."""

PAUSE: Final = 0.5
"""Time between two searches for hum while there is none [s]."""

DETECTION: Final = 5.0
"""Least amplitude of a hum, in standard deviations of the noise in a window [1]."""

LEAST_AMPLITUDE: Final = 0.2
"""A hum of less than this many standard deviations of a reading's noise is not subtracted [1]."""

STRONG_AMPLITUDE: Final = 5.0
"""A hum of more than this many standard deviations of a reading's noise is strong [1]."""

LARGEST_PHASE_CHANGE: Final = 1.0
"""Greatest deviation of the phase from its prediction between two windows [rad]."""

FREQUENCY_WALK: Final = 0.05
"""Deviation by which the mains frequency changes in a second [Hz]: a random walk."""

SIZE_WALK: Final = 0.1
"""Deviation by which the size of a hum changes in a second, relative to it [1]: a random walk."""

INDIVIDUAL_GAIN: Final = 0.1
"""Least share of a taxel's individual error by which it is corrected [1]; at first the mean of all windows is taken."""

LARGEST_STEP: Final = 0.5
"""Greatest relative change of amplitude [1] and greatest change of phase [rad] by one window."""

FEWEST: Final = 0.2
"""Least share of untouched taxels among all working ones from which the hum is estimated [1]."""

TURN: Final = 2.0 * math.pi


class MainsHum(HumFilter):
    """Estimates and subtracts the hum of signals in any unit, scan by scan, shape [taxels].

    `remove` subtracts the hum from the signals of a scan, in place, and keeps them for the estimation; required while
    `sampling`.

    State variables: cosine and sine parts of each taxel's hum by order [unit of the signals], phase [rad] and frequency
    [Hz], the signals of the current window.

    Parameters
    ----------
    taxels : int
        Number of taxels.
    rate : float
        Scans per second [Hz].
    noise : float
        Standard deviation of a reading, in the unit of the signals.
    """

    def __init__(self, taxels: int, rate: float, noise: float) -> None:
        scans = round(WINDOW * rate) if rate >= SCANS_PER_PERIOD * max(FREQUENCIES) else 0
        super().__init__(taxels, scans)
        self._orders = [order for order in ORDERS if rate >= SCANS_PER_PERIOD * order * max(FREQUENCIES)]
        self._pause = 0.0
        self._touched = np.zeros(taxels, np.bool_)
        # Hann window: suppresses slow changes.
        self._weights = 2.0 / max(scans, 1) * (1.0 - np.cos(TURN * (np.arange(scans) + 0.5) / max(scans, 1)))
        self._noise_of_window = noise * math.sqrt(3.0 / max(scans, 1))
        self._least, self._strong = LEAST_AMPLITUDE * noise, STRONG_AMPLITUDE * noise
        self._suspected: complex | None = None  # mean phasor of the free taxels in the previous window
        self._windows = 0
        self._lock = np.zeros((2, 2))  # covariance of the phase at the end of a window and the frequency [rad, rad/s]
        self._size = 0.0  # variance of the relative size

    @property
    def searches(self) -> bool:
        """Whether the rate suffices to find hum."""
        return self.scans > 0

    @property
    def frequency(self) -> float:
        """Frequency of the hum [Hz]; NaN: no hum."""
        return self.hum_frequency if self.present else math.nan

    @property
    def amplitude(self) -> float:
        """Root mean square of the taxels' amplitudes of the fundamental, in the unit of the signals."""
        return math.sqrt(2.0 * float(np.mean(self.parts[0] ** 2)))

    @property
    def strong(self) -> bool:
        """Whether a hum is subtracted without which the signals say little."""
        return self.present and self.amplitude > self._strong

    def forget(self) -> None:
        """Forget what was seen of the window that an interruption has ended; the scan path has cleared the hum."""
        self._suspected, self._pause = None, 0.0
        self._touched[:] = False

    def close_block(self, touched: Mask, ignored: Mask, duration: float) -> None:
        """End a block of scans; process the window when it is complete.

        Parameters
        ----------
        touched : ndarray of bool, shape [taxels]
            Taxels touched during the block.
        ignored : ndarray of bool, shape [taxels]
            Faulty taxels.
        duration : float
            Duration of the block [s].
        """
        if self._pause > 0.0:
            self._pause -= duration
            if self._pause <= 0.0:
                self._start_window()
            return
        self._touched |= touched
        if not self.searches or self.filled < self.scans:
            return
        free = ~(self._touched | ignored)
        enough = np.count_nonzero(free) >= max(1.0, FEWEST * np.count_nonzero(~ignored))
        if not self._shows_hum():
            self._suspected = None
        elif self.present:
            self._track(free if enough else ~ignored, any_true(self._touched))
        elif enough:
            self._detect(free)
        if self.present or self._suspected is not None:
            self._start_window()
        else:
            self._pause, self.sampling = PAUSE, False

    def _shows_hum(self) -> bool:
        """Return whether the scans of the window followed each other fast enough."""
        span = self.times[self.scans - 1] - self.times[0]
        return self.scans - 1 >= LEAST_RATE * SCANS_PER_PERIOD * max(FREQUENCIES) * span

    def _detect(self, free: Mask) -> None:
        """Detect a persistent hum: two consecutive windows must agree."""
        measured = {frequency: self._correlate(frequency) for frequency in FREQUENCIES}
        common = {frequency: _phasor(parts[:, free].mean(axis=1)) for frequency, parts in measured.items()}
        frequency = max(common, key=lambda one: abs(common[one]))
        now, before = common[frequency], self._suspected
        self._suspected = None
        if abs(now) <= max(DETECTION * self._noise_of_window / math.sqrt(np.count_nonzero(free)), self._least):
            return
        if before is None or self.hum_frequency != frequency:
            self._suspected, self.hum_frequency = now, frequency
            return
        phase_change = np.angle(now / before)
        if abs(phase_change) > LARGEST_PHASE_CHANGE:
            self._suspected = now
            return
        self.present = True
        for index, order in enumerate(self._orders):
            parts = self._correlate(frequency, order)
            self.parts[index] = np.where(free, parts, parts[:, free].mean(axis=1, keepdims=True))
        self.hum_frequency += phase_change / (TURN * self.time)
        self.phase -= 0.5 * phase_change
        self._windows = 1
        self._size = self._noise_of_window**2 / (np.count_nonzero(free) * abs(now) ** 2)
        of_frequency = 2.0 * self._size / self.time**2 + (TURN * FREQUENCY_WALK) ** 2 * self.time
        half = 0.5 * self.time
        self._lock = of_frequency * np.array([[half**2, half], [half, 1.0]])
        self._lock[0, 0] += self._size

    def _track(self, free: Mask, touched: bool) -> None:
        """Correct phase, frequency and size by the residual hum of free taxels, and each while nothing touches."""
        duration = self.time
        step = np.array([[1.0, duration], [0.0, 1.0]])
        walk = np.array([[duration**3 / 3.0, duration**2 / 2.0], [duration**2 / 2.0, duration]])
        self._lock = step @ self._lock @ step.T + (TURN * FREQUENCY_WALK) ** 2 * walk
        self._size += SIZE_WALK**2 * duration
        if not any_true(free):
            return
        residual, parts = self._correlate(self.hum_frequency), self.parts[0]
        power = float(np.sum(parts[:, free] ** 2))
        if power == 0.0:
            self._reset()
            return
        quadrature = np.stack([parts[1], -parts[0]])
        in_phase = float(np.sum(parts[:, free] * residual[:, free])) / power
        lead = float(np.sum(quadrature[:, free] * residual[:, free])) / power
        own = residual - in_phase * parts - lead * quadrature
        freedom = 2.0 * max(np.count_nonzero(free) - 1.0, 1.0)
        variance = max(float(np.sum(own[:, free] ** 2)) / freedom, self._noise_of_window**2) / power
        seen = np.array([1.0, -0.5 * duration])
        gain = self._lock @ seen / (seen @ self._lock @ seen + variance)
        self._lock -= np.outer(gain, seen @ self._lock)
        of_size = self._size / (self._size + variance)
        self._size -= of_size * self._size
        if not touched:
            self._windows += 1
            individual = max(1.0 / self._windows, INDIVIDUAL_GAIN)
            for order, of_order in zip(self._orders, self.parts, strict=False):
                rest = self._correlate(self.hum_frequency, order) - order * lead * np.stack([of_order[1], -of_order[0]])
                if order == 1:
                    rest -= in_phase * of_order
                np.add(of_order, individual * np.where(free, rest, 0.0), out=of_order)
        error = min(max(math.atan2(lead, 1.0 + in_phase), -LARGEST_STEP), LARGEST_STEP)
        self.phase += float(gain[0] - duration * gain[1]) * error
        self.hum_frequency += float(gain[1]) * error / TURN
        factor = 1.0 + of_size * min(max(in_phase, -LARGEST_STEP), LARGEST_STEP)
        self._size /= factor**2
        self._scale(factor)

    def _scale(self, factor: float) -> None:
        """Scale all amplitudes; drop the hum when it becomes negligible."""
        np.multiply(self.parts, factor, out=self.parts)
        if self.amplitude < 0.5 * self._least:
            self._reset()

    def _reset(self) -> None:
        self.clear()
        self._suspected = None

    def _start_window(self) -> None:
        self.start_window()
        self._touched[:] = False
        self._pause = 0.0

    def _correlate(self, frequency: float, order: int = 1) -> Array:
        """Return the parts of the window's signals at an order of a fundamental frequency [Hz], shape [2, taxels]."""
        angle = order * (self.phase + TURN * frequency * self.times)
        parts: Array = np.stack([np.cos(angle), np.sin(angle)]) * self._weights @ self.window
        return parts


def _phasor(parts: Array) -> complex:
    """Return cosine and sine parts as a phasor, whose angle is the phase lead."""
    return complex(parts[0], -parts[1])
