"""Mains hum, learnt where nothing touches and taken away everywhere, in contacts as well.

All taxels hum at one frequency, each with an amplitude and a phase of its own. These are learnt in windows of whole
periods in which nothing touches. Something may touch for long, and the frequency of the mains wanders: then the taxels
that are not in contact tell how the phase moves on, for all. So a touch that vibrates with the mains stays what it is.
Where too few are untouched the phase is foretold for a while, and after that the hum is left in.

Only the fundamental is followed. Harmonics stay.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_model._lib.reductions import any_true
from posfet_model._lib.types import Array, Mask

FREQUENCIES: Final = (50.0, 60.0)
"""Of the mains, nominally [Hz]."""

WINDOW: Final = 0.1
"""Time over which phases are compared [s]: whole periods of each of `FREQUENCIES`."""

SCANS_PER_PERIOD: Final = 2.5
"""At fewer scans in a period the hum is not told from other things [1]."""

PAUSE: Final = 0.5
"""Time between two looks for a hum while there is none [s]."""

CLEAR: Final = 5.0
"""A hum is more than this many standard deviations of what noise would show in a window [1]."""

WORTH_IT: Final = 0.2
"""A hum of less than this many standard deviations of a reading's noise is left in [1]."""

STEADY: Final = 1.0
"""From one window to the next the phase of the mains moves on as expected to within this [rad]."""

PHASE_GAIN: Final = 0.4
FREQUENCY_GAIN: Final = 0.06
"""Shares of a window's phase error by which phase and frequency are corrected [1]."""

AMPLITUDE_GAIN: Final = 0.4
"""Share by which all amplitudes are corrected together [1]."""

OWN_GAIN: Final = 0.1
"""Share by which what a taxel has alone is corrected in the end; before, it is the mean of all windows [1]."""

LARGEST_STEP: Final = 0.5
"""Largest relative change of amplitude [1] and phase [rad] that is believed of one window."""

FEWEST: Final = 0.2
"""Fewer untouched ones of all working taxels tell nothing [1]."""

TRUSTED: Final = 5.0
"""For so long the last frequency is good enough to foretell the phase [s]."""

FADING: Final = 0.8
"""After that the amplitude is multiplied by this each window [1]."""

TURN: Final = 2.0 * math.pi


class MainsHum:
    """Takes the hum off signals of any unit, scan by scan, shape [taxels]."""

    def __init__(self, taxels: int, rate: float, noise: float) -> None:
        """Take the scans per second [Hz] and the standard deviation of a reading's noise in the unit of the signals."""
        scans = round(WINDOW * rate) if rate >= SCANS_PER_PERIOD * max(FREQUENCIES) else 0
        self.present = False
        """Whether there is a hum to take away."""
        self._parts = np.zeros((2, taxels))  # of the cosine and the sine of the phase
        self._hum = np.zeros(taxels)
        self._turned = np.zeros(2)
        self._frequency = 0.0
        self._phase = 0.0  # when the window began [rad]
        self._time = 0.0  # since then [s]
        self._window = np.zeros((scans, taxels))
        self._rows = list(self._window)
        self._times = np.zeros(scans)
        self._filled = 0
        self._pause = 0.0
        self._touched = np.zeros(taxels, np.bool_)
        # Hann's window: what changes slowly shows little of itself.
        self._weights = 2.0 / max(scans, 1) * (1.0 - np.cos(TURN * (np.arange(scans) + 0.5) / max(scans, 1)))
        self._noise_of_window = noise * math.sqrt(3.0 / max(scans, 1))
        self._least = WORTH_IT * noise
        self._suspected: complex | None = None  # what all free taxels showed together in the window before
        self._windows = 0
        self._untold = 0.0

    @property
    def listening(self) -> bool:
        """Whether the signals of the next scan are wanted."""
        return self._pause <= 0.0 and len(self._rows) > 0

    @property
    def frequency(self) -> float:
        """Of the hum [Hz]; NaN when there is none."""
        return self._frequency if self.present else math.nan

    @property
    def amplitude(self) -> float:
        """Root mean square of the taxels' amplitudes in the unit of the signals."""
        return math.sqrt(2.0 * float(np.mean(self._parts * self._parts)))

    def remove(self, signal: Array, step: float) -> None:
        """Take the hum off the signals of a scan that ends a step [s], in place. For while `listening`."""
        self._time += step
        if self.present:
            angle = self._phase + TURN * self._frequency * self._time
            turned = self._turned
            turned[0], turned[1] = math.cos(angle), math.sin(angle)
            signal -= turned.dot(self._parts, self._hum)
        filled = self._filled
        if filled < len(self._rows):
            self._rows[filled][...] = signal
            self._times[filled] = self._time
            self._filled = filled + 1

    def interrupt(self) -> None:
        """Take note that an unknown time passes before the next scan: the phase is lost."""
        self._lose()
        self._begin_window()

    def close_block(self, touched: Mask, ignored: Mask, duration: float) -> None:
        """Take which taxels were touched during a block of scans [s], and which do not work."""
        if self._pause > 0.0:
            self._pause -= duration
            if self._pause <= 0.0:
                self._begin_window()
            return
        self._touched |= touched
        if not len(self._rows) or self._filled < len(self._rows):
            return
        free = ~(self._touched | ignored)
        enough = np.count_nonzero(free) >= max(1.0, FEWEST * np.count_nonzero(~ignored))
        if self.present:
            self._follow(free if enough else None, any_true(self._touched))
        elif enough:
            self._look(free)
        if self.present or self._suspected is not None:
            self._begin_window()
        else:
            self._pause = PAUSE

    def _look(self, free: Mask) -> None:
        """Look for a hum that lasts: two windows must agree."""
        shown = {frequency: self._correlate(frequency) for frequency in FREQUENCIES}
        common = {frequency: _phasor(parts[:, free].mean(axis=1)) for frequency, parts in shown.items()}
        frequency = max(common, key=lambda one: abs(common[one]))
        now, before = common[frequency], self._suspected
        self._suspected = None
        if abs(now) <= max(CLEAR * self._noise_of_window / math.sqrt(np.count_nonzero(free)), self._least):
            return
        if before is None or self._frequency != frequency:
            self._suspected, self._frequency = now, frequency
            return
        turned = np.angle(now / before)
        if abs(turned) > STEADY:
            self._suspected = now
            return
        self.present = True
        self._parts[:] = np.where(free, shown[frequency], shown[frequency][:, free].mean(axis=1, keepdims=True))
        self._frequency += turned / (TURN * self._time)
        self._windows, self._untold = 1, 0.0

    def _follow(self, free: Mask | None, touched: bool) -> None:
        """Correct phase and frequency by what the free taxels still show, and amplitudes unless something touches."""
        if free is None:
            self._untold += self._time
            if self._untold > TRUSTED:
                self._scale(FADING)
            return
        self._untold = 0.0
        left, parts = self._correlate(self._frequency), self._parts
        power = float(np.sum(parts[:, free] ** 2))
        if power == 0.0:
            self._lose()
            return
        in_phase = float(np.sum(parts[:, free] * left[:, free])) / power
        ahead = float(np.sum(parts[0, free] * -left[1, free] + parts[1, free] * left[0, free])) / power
        error = min(max(math.atan2(ahead, 1.0 + in_phase), -LARGEST_STEP), LARGEST_STEP)
        self._phase += PHASE_GAIN * error
        self._frequency += FREQUENCY_GAIN * error / (TURN * self._time)
        if touched:
            return
        self._windows += 1
        own = left - in_phase * parts - ahead * np.stack([parts[1], -parts[0]])
        parts += max(1.0 / self._windows, OWN_GAIN) * np.where(free, own, 0.0)
        self._scale(1.0 + AMPLITUDE_GAIN * min(max(in_phase, -LARGEST_STEP), LARGEST_STEP))

    def _scale(self, factor: float) -> None:
        """Change all amplitudes; give the hum up where it is not worth it any more."""
        self._parts *= factor
        if self.amplitude < 0.5 * self._least:
            self._lose()

    def _lose(self) -> None:
        self.present, self._suspected = False, None
        self._parts[:] = 0.0

    def _begin_window(self) -> None:
        self._phase = (self._phase + TURN * self._frequency * self._time) % TURN
        self._time = 0.0
        self._filled = 0
        self._touched[:] = False
        self._pause = 0.0

    def _correlate(self, frequency: float) -> Array:
        """Return what the window shows of cosine and sine of the phase, shape [2, taxels]."""
        angle = self._phase + TURN * frequency * self._times
        shown: Array = np.stack([np.cos(angle), np.sin(angle)]) * self._weights @ self._window
        return shown


def _phasor(parts: Array) -> complex:
    """Return cosine and sine parts as a phasor: what is ahead has the greater angle."""
    return complex(parts[0], -parts[1])
