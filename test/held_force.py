"""A force held by many taxels at once, ours against the optimal estimator that knows the true noise.

The taxels have white noise and 1/f noise of the simulated board (sums of octaves, not the observer's Markov processes),
an offset each, rest, and are then pressed all alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.sim_noise import FlickerNoise
from posfet_model.chain import charge_per_newton
from posfet_model.observer import ForceObserver
from posfet_model.observer_settings import ObserverSettings
from posfet_model.sensor import Sensor, load_sensor

BLOCK: Final = 20
"""Scans of a block of the optimal estimator."""

RATE: Final = 1000.0
"""[Hz]"""

KNOWN_LEAK: Final = ObserverSettings(leak_shared=1e-6, leak_own=1e-6)
"""The optimal estimator knows the leak, and so does ours."""


class Optimal:
    """Kalman filter that knows the noise, and when something touches.

    1/f noise is a sum of first-order Markov processes, one per decade from 10 ms to 1000 s. A taxel at rest shows its
    noise alone, so the filter learns the noise from the signal then, foretells it while a force is held, and takes
    signal and leaked charge for what is foretold of it.
    """

    MEMORIES: Final = np.array([1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3])

    def __init__(self, taxels: int, white: float, flicker: float, leak: float) -> None:
        """Take the variance of a reading [N2], the density of the 1/f noise at 1 Hz [N2], and tau [s]."""
        self._decade = flicker * math.log(10.0)
        self._state = np.zeros((len(self.MEMORIES) + 1, taxels))
        self._covariance = np.diag([*(self._decade for _ in self.MEMORIES), 1.0])  # the last: an unknown constant
        self._noise = white / BLOCK
        self._kept = np.append(np.exp(-BLOCK / RATE / self.MEMORIES), 1.0)
        self._leak = leak
        self._leaked = np.zeros(taxels)

    def rest(self, mean: NDArray[np.float64]) -> None:
        """Take the mean signal of a block [N] without force."""
        self._pass()
        seen = self._covariance.sum(axis=1)
        gain = seen / (seen.sum() + self._noise)
        self._state += np.outer(gain, mean - self._state.sum(axis=0))
        self._covariance -= np.outer(gain, seen)

    def hold(self, mean: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take the mean signal of a block [N] under force; return the mean force [N]."""
        self._pass()
        charge = mean - self._state.sum(axis=0)
        step = charge * (BLOCK / RATE / self._leak)
        self._leaked += step
        return charge + self._leaked - 0.5 * step

    def _pass(self) -> None:
        self._state *= self._kept[:, None]
        self._covariance *= np.outer(self._kept, self._kept)
        self._covariance += np.diag(np.append(self._decade * (1.0 - self._kept[:-1] ** 2), 0.0))


@dataclass(frozen=True)
class Held:
    """Errors of a held force at one time of the hold, over all taxels."""

    time: float
    """Since the force came up [s]."""
    force: float
    """The true one [N]."""
    error: float
    """Of the observer, in means over 0.1 s: root mean square [N]."""
    optimal: float
    """Of the optimal estimator, in the same means [N]."""
    deviation: float
    """What the observer reports [N]."""
    inside: float
    """Share of the taxels whose force is within two reported deviations of the truth [1]."""


def hold(
    seed: int,
    times: tuple[float, ...] = (1.0, 5.0, 20.0),
    force: float = 2.0,
    rest: float = 2.0,
    flicker: float = 10e-6,
    side: int = 16,
    sensor: Sensor | None = None,
) -> Iterator[Held]:
    """Yield the errors at `times` [s] of a `force` [N] held by side x side taxels after a `rest` [s].

    flicker [V/sqrt(Hz)] is the 1/f noise at 1 Hz.
    """
    sensor = sensor or load_sensor()
    sensor = replace(sensor, layout=replace(sensor.layout, rows=side, cols=side))
    taxels, start = sensor.layout.taxels, round(rest * RATE)
    white = (sensor.adc.noise / sensor.volts_per_newton) ** 2
    leak = sensor.device.leak_time_constant
    optimal = Optimal(taxels, white, (flicker / sensor.volts_per_newton) ** 2, leak)
    observer, touched = ForceObserver(sensor, KNOWN_LEAK), np.zeros(taxels, np.bool_)
    mean = np.zeros(taxels)
    recent: list[NDArray[np.float64]] = []
    best: list[NDArray[np.float64]] = []
    for index, (true, signal) in enumerate(_signals(sensor, seed, start, force, flicker)):
        _observe(observer, signal * charge_per_newton(sensor), touched, sensor.contact.threshold)
        mean = mean + signal / BLOCK
        if index % BLOCK == BLOCK - 1:
            if index < start:
                optimal.rest(mean)
            else:
                best = [*best[-4:], optimal.hold(mean)]
            mean = np.zeros(taxels)
        recent = [*recent[-99:], observer.force.copy()]
        held = (index + 1 - start) / RATE
        if held in times:
            error = np.mean(recent, axis=0) - true
            deviation = np.sqrt(observer.variance(np.empty(taxels)) + observer.common_variance)
            yield Held(
                time=held,
                force=true,
                error=float(np.sqrt(np.mean(error**2))),
                optimal=float(np.sqrt(np.mean((np.mean(best, axis=0) - true) ** 2))),
                deviation=float(np.mean(deviation)),
                inside=float(np.mean(np.abs(observer.force - true) <= 2 * deviation)),
            )
            if held >= max(times):
                return


def _observe(
    observer: ForceObserver, charge: NDArray[np.float64], touched: NDArray[np.bool_], threshold: float
) -> None:
    """Give a scan to the observer; a taxel above the threshold of contacts is touched."""
    observer.advance(charge, np.full(2, 25.0, np.float32), 1.0 / RATE)
    touched |= observer.force > threshold
    if observer.block_due:
        observer.close_block(touched)
        touched[:] = observer.force > threshold


def _signals(
    sensor: Sensor, seed: int, start: int, force: float, flicker: float
) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """Yield the true force [N], and the signals of the taxels as forces that leak [N], scan by scan for ever."""
    taxels, random = sensor.layout.taxels, np.random.default_rng(seed)
    per_newton = sensor.volts_per_newton
    source = FlickerNoise(seed, taxels, 64)
    offset = random.normal(0.0, 5e-3 / per_newton, taxels)
    ratio = 1.0 / RATE / sensor.device.leak_time_constant
    charge, last, index = 0.0, 0.0, 0
    while True:
        noise = source.weights @ source.rows(index // 64) * (flicker / per_newton)
        noise += random.normal(0.0, sensor.adc.noise / per_newton, noise.shape) + offset
        for row in noise:
            true = force * min(max((index - start) / 20, 0.0), 1.0)
            charge = charge * math.exp(-ratio) + (true - last) * -math.expm1(-ratio) / ratio
            last = true
            index += 1
            yield true, charge + row
