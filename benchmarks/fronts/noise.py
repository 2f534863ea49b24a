# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Read-out noise: generators of 1/f noise, time against error of the spectrum."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.fronts.interleaved import interleaved
from benchmarks.outcome import shown
from posfet_model._lib.types import Array
from posfet_sim.device.flicker_noise import FlickerNoise

BLOCK = 64
CHANNELS = 64
LENGTH = 4096
BANDS = (4, 1024)
"""First and last bin of the spectrum that is compared, of a record of `LENGTH` samples."""

POLES = (1, 2, 4)
"""First-order processes per factor of 4 in frequency."""

Generator = Callable[[int], Array]


def measure(effort: Effort) -> list[Front]:
    """Return the front of the generators; the spectrum is that of 1/f, density 1/f at 1 Hz, in cycles per sample."""
    records = 4 if effort.short else 32
    makers: dict[tuple[str, str], Generator] = {
        ("octaves, this stack", ""): _octaves,
        ("white noise alone", ""): lambda seed: np.random.default_rng(seed).standard_normal((LENGTH, CHANNELS)),
        ("shaped by FFT", ""): _shaped,
        **{
            ("first-order processes", f"{count} per factor of 4"): (lambda seed, n=count: _poles(seed, n))
            for count in POLES
        },
    }
    errors = {key: _error(make, records) for key, make in makers.items()}
    seconds = interleaved({"|".join(key): (lambda make=make: make(1)) for key, make in makers.items()}, effort.repeats)
    samples = LENGTH * CHANNELS
    choices = tuple(
        Choice(*key, error, tuple(each / samples for each in seconds["|".join(key)])) for key, error in errors.items()
    )
    bins = 2.0**0.5 * BANDS[0] - BANDS[0]
    uncertainty = 10 / np.log(10) / np.sqrt(records * CHANNELS * max(bins, 1.0))
    shaped, white = errors["shaped by FFT", ""], errors["white noise alone", ""]
    slope = 10 * np.log10(4.0) / 2
    span = np.log2(BANDS[1] / BANDS[0])
    checks = (
        Check("error of the spectrum of noise shaped by FFT over its statistical uncertainty [1]", shaped / uncertainty,
              0.0, 4.0),
        Check("error of white noise over that of a flat spectrum in place of 1/f [1]",
              white / (slope * span / np.sqrt(12)), 0.85, 1.2),
        Check("error of the octaves [dB]", errors["octaves, this stack", ""], 0.0, 1.0),
    )  # fmt: skip
    own, fft = choices[0], choices[2]
    return [
        Front(
            "noise",
            "1/f noise of the read-out",
            f"one sample of one of {CHANNELS} channels",
            "error of the spectrum, rms over half octaves [dB]",
            f"the density 1/f, mean of {records * CHANNELS} periodograms",
            float(uncertainty),
            choices,
            "octaves, this stack",
            checks,
            f"The sum of octaves is within {shown(own.error)} dB of 1/f and takes {shown(own.median / fft.median)} "
            "of the run time of shaping a whole record by FFT. Choose the FFT for a record whose length is known, "
            "and octaves where scans are drawn in any order; first-order processes need every sample before.",
            why_not="It alone gives any scan without those before it, and the same bytes for the same seed whatever "
            "was read in between.",
            question="1/f noise",
            rival=fft.name,
            swept=True,
        )
    ]


def _octaves(seed: int) -> Array:
    """Return one record of this stack's noise, with the white noise that it leaves to its caller."""
    noise = FlickerNoise(seed, CHANNELS, BLOCK)
    found = np.concatenate([noise.weights @ noise.rows(number) for number in range(LENGTH // BLOCK)])
    fold = np.sqrt(FlickerNoise.folded_variance(1.0, 0.5))
    return found + fold * np.random.default_rng(seed).standard_normal(found.shape)


def _shaped(seed: int) -> Array:
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal((2 * LENGTH, CHANNELS)), axis=0)
    frequency = np.fft.rfftfreq(2 * LENGTH)
    frequency[0] = np.inf
    return np.fft.irfft(spectrum / np.sqrt(2 * frequency)[:, None], axis=0)[:LENGTH]


def _poles(seed: int, per_factor: int) -> Array:
    """Return a sum of first-order processes whose corner frequencies are evenly spaced in the logarithm."""
    random = np.random.default_rng(seed)
    corners = 0.25 * 4.0 ** (-np.arange(8 * per_factor) / per_factor)
    decay = np.exp(-2 * np.pi * corners)[:, None]
    deviation = np.sqrt(np.log(4.0) / per_factor)
    state = deviation * random.standard_normal((len(corners), CHANNELS))
    kick = deviation * np.sqrt(1 - decay**2)
    found = np.empty((LENGTH, CHANNELS))
    for row in found:
        state *= decay
        state += kick * random.standard_normal(state.shape)
        state.sum(axis=0, out=row)
    return found


def _error(make: Generator, records: int) -> float:
    """Return the rms deviation of the spectrum from 1/f over half octaves, the mean deviation left out [dB]."""
    window = np.hanning(LENGTH)[:, None]
    power = np.zeros(LENGTH // 2 + 1)
    for seed in range(records):
        power += (np.abs(np.fft.rfft(make(seed) * window, axis=0)) ** 2).mean(axis=1)
    frequency = np.fft.rfftfreq(LENGTH)
    edges = BANDS[0] * 2 ** np.arange(0, np.log2(BANDS[1] / BANDS[0]) + 0.1, 0.5)
    ratio = power[1:] * frequency[1:]
    numbers = np.arange(1, len(power))
    bands = [ratio[(numbers >= low) & (numbers < high)] for low, high in itertools.pairwise(edges)]
    level = np.array([10 * np.log10(band.mean()) for band in bands if len(band)])
    return float(np.sqrt(((level - level.mean()) ** 2).mean()))
