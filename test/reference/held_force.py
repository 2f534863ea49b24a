"""A force held by many taxels at once, ours against the optimal estimator that knows the true noise.

The taxels have white noise and 1/f noise of the simulated board (sums of octaves, not the observer's Markov processes),
an offset each, rest, and are then pressed all alike. The temperature rests or drifts (held_warmth.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice, repeat
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.estimation.force_observer import ForceObserver
from posfet_model.estimation.settings import ObserverSettings
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.signal_chain import charge_per_newton
from posfet_sim.device.flicker_noise import FlickerNoise
from reference.held_warmth import BEFORE, MEMORIES, STEP, Drift, Warmth, newton_per_kelvin

BLOCK: Final = 20
"""Scans of a block of the optimal estimator."""

RATE: Final = 1.0 / STEP
"""[Hz]"""

LEARNT_LEAK: Final = ObserverSettings(gain_deviation=1e-6)
"""Gains are right, and known to be; the leak is known as well as by a calibration."""

KNOWN_LEAK: Final = ObserverSettings(
    gain_deviation=1e-6,
    leakage_common_deviation=1e-6,
    leakage_individual_deviation=1e-6,
    leakage_common_deviation_calibrated=1e-6,
    leakage_individual_deviation_calibrated=1e-6,
)
"""The optimal estimator knows the leak, and so does ours."""


class Optimal:
    """Kalman filter that knows the noise, and when something touches.

    1/f noise is a sum of first-order Markov processes, one per decade from 10 ms to 1000 s. A taxel at rest shows its
    noise alone, so the filter learns the noise from the signal then, foretells it while a force is held, and takes
    signal and leaked charge for what is foretold of it. What warmth does unevenly to a taxel is a random constant times
    the warmth, which is told.
    """

    def __init__(self, taxels: int, white: float, flicker: float, leak: NDArray[np.float64], uneven: float) -> None:
        """Take the variance of a reading [N2], the density of 1/f noise at 1 Hz [N2], tau [s] and unevenness [1].

        tau is of shape [taxels].
        """
        decade = flicker * math.log(10.0)
        self._state = np.zeros((len(MEMORIES) + 2, taxels))  # the last two: an unknown offset, and unevenness
        self._covariance = np.diag([*(decade for _ in MEMORIES), 1.0, uneven**2])
        self._white = white / BLOCK
        self._kept = np.array([*np.exp(-BLOCK / RATE / MEMORIES), 1.0, 1.0])
        self._noise = np.diag(decade * (1.0 - self._kept**2))
        self._leak = leak
        self._leaked = np.zeros(taxels)

    def rest(self, mean: NDArray[np.float64], warm: float) -> None:
        """Take the mean signal of a block without force, and what the warmth shows in it, left out already [N]."""
        self._pass()
        shown = np.append(np.ones(len(self._state) - 1), warm)
        seen = self._covariance @ shown
        gain = seen / (shown @ seen + self._white)
        self._state += np.outer(gain, mean - shown @ self._state)
        self._covariance -= np.outer(gain, seen)

    def hold(self, mean: NDArray[np.float64], warm: float) -> NDArray[np.float64]:
        """Take the mean signal of a block under force, and the warmth's part in it; return the mean force, all [N]."""
        self._pass()
        charge = mean - self._state[:-1].sum(axis=0)
        step = charge * (BLOCK / RATE / self._leak)
        self._leaked += step
        return charge + self._leaked - 0.5 * step - warm * (1.0 + self._state[-1])

    def _pass(self) -> None:
        self._state *= self._kept[:, None]
        self._covariance *= np.outer(self._kept, self._kept)
        self._covariance += self._noise


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
    """Of the optimal estimator, in the same means [N]; NaN when some are left untouched."""
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
    drift: Drift | None = None,
    lag: float | None = None,
    learnt: bool = False,
    untouched: int = 0,
) -> Iterator[Held]:
    """Yield the errors at `times` [s] of a `force` [N] held by side x side taxels after a `rest` [s].

    flicker [V/sqrt(Hz)] is the 1/f noise at 1 Hz; without drift the temperature rests. lag [s] is
    that of the film if it is another than the one told to ours; the optimal estimator is not told either. If `learnt`,
    ours is told time constants of the leak that are as wrong as a calibration leaves them; the optimal one knows them.
    So many taxels are left untouched, and do not count; what these show, the optimal one does not use.
    """
    sensor = sensor or load_sensor()
    sensor = replace(sensor, layout=replace(sensor.layout, rows=side, cols=side))
    taxels, start = sensor.layout.taxels, round(rest * RATE)
    settings = LEARNT_LEAK if learnt else KNOWN_LEAK
    random = np.random.default_rng([seed, 3])
    wrong = settings.leakage_common_deviation_calibrated * random.standard_normal()
    wrong = wrong + settings.leakage_individual_deviation_calibrated * random.standard_normal(taxels)
    leak = sensor.device.leak_time_constant * np.exp(wrong * learnt)
    optimal = _Optimum(sensor, flicker, drift, leak)
    observer, touched = ForceObserver(sensor, settings, _calibration(sensor)), np.zeros(taxels, np.bool_)
    recent: list[NDArray[np.float64]] = []
    best: list[NDArray[np.float64]] = []
    pressed = np.arange(taxels) >= untouched
    signals = _signals(sensor, seed, start, force * pressed, flicker, drift, lag, leak)
    for index, (rise, signal, readings) in enumerate(signals):
        _observe(observer, signal * charge_per_newton(sensor), readings, touched, sensor.contact.threshold)
        best = [*best[-4:], *optimal.take(signal, readings, index >= start)]
        recent = [*recent[-99:], observer.force.copy()]
        held = (index + 1 - start) / RATE
        if held in times:
            true = force * rise
            error, least = np.mean(recent, axis=0)[pressed] - true, np.mean(best, axis=0) - true
            deviation = np.sqrt(observer.force_variance(np.empty(taxels)) + observer.common_variance)[pressed]
            yield Held(
                time=held,
                force=true,
                error=float(np.sqrt(np.mean(error**2))),
                optimal=float(np.sqrt(np.mean(least**2))) if not untouched else math.nan,
                deviation=float(np.mean(deviation)),
                inside=float(np.mean(np.abs(observer.force[pressed] - true) <= 2 * deviation)),
            )
            if held >= max(times):
                return


class _Optimum:
    """The optimal estimator, scan by scan: of what all taxels have in common, and of what each has alone."""

    def __init__(self, sensor: Sensor, flicker: float, drift: Drift | None, leak: NDArray[np.float64]) -> None:
        white, density = (sensor.adc.noise / sensor.volts_per_newton) ** 2, (flicker / sensor.volts_per_newton) ** 2
        taxels, uneven = sensor.layout.taxels, drift.uneven if drift else 0.0
        self._warmth = Warmth(sensor, drift, white, density) if drift else None
        self._own = Optimal(taxels, white, density, leak, uneven)
        self._mean = np.zeros(taxels)
        self._scans = 0

    def take(
        self, signal: NDArray[np.float64], readings: NDArray[np.float32], touched: bool
    ) -> Iterator[NDArray[np.float64]]:
        """Take a scan [N] and temperatures [degC]; yield the mean force [N] where a block under force ends."""
        self._mean += signal / BLOCK
        self._scans += 1
        if self._warmth:
            self._warmth.take(float(signal.mean()), readings, touched)
        if self._scans % BLOCK:
            return
        common, warm = self._warmth.close_block(BLOCK) if self._warmth else (0.0, 0.0)
        if touched:
            yield self._own.hold(self._mean - common, warm)
        else:
            self._own.rest(self._mean - common, warm)
        self._mean[:] = 0.0


def _calibration(sensor: Sensor) -> Calibration:
    """Return a recorded calibration that is right."""
    return replace(Calibration.nominal(sensor), residuals=Residuals(0.0, 0.0, 1))


def _observe(
    observer: ForceObserver,
    charge: NDArray[np.float64],
    readings: NDArray[np.float32],
    touched: NDArray[np.bool_],
    threshold: float,
) -> None:
    """Give a scan to the observer; a taxel above the threshold of contacts is touched."""
    observer.advance(charge, readings, 1.0 / RATE)
    observer.compensate_common_mode(bool(touched.any()))
    touched |= observer.force > threshold
    if observer.block_due:
        observer.close_block(touched)
        touched[:] = observer.force > threshold


def _signals(
    sensor: Sensor,
    seed: int,
    start: int,
    force: NDArray[np.float64],
    flicker: float,
    drift: Drift | None,
    lag: float | None,
    leak: NDArray[np.float64],
) -> Iterator[tuple[float, NDArray[np.float64], NDArray[np.float32]]]:
    """Yield, scan by scan for ever, which share of the `force` [N] is there, the signals, and temperatures [degC].

    Signals are forces that leak [N].
    """
    taxels, random = sensor.layout.taxels, np.random.default_rng(seed)
    per_newton = sensor.volts_per_newton
    source = FlickerNoise(seed, taxels, 64)
    offset = random.normal(0.0, 5e-3 / per_newton, taxels)
    steady = repeat((0.0, np.full(2, 25.0, np.float32)))
    warmth = drift.scans(seed, start, lag or sensor.device.thermal_time_constant) if drift else steady
    uneven = drift.uneven if drift else 0.0
    per_kelvin = newton_per_kelvin(sensor) * (1.0 + uneven * np.random.default_rng([seed, 2]).standard_normal(taxels))
    ratio = 1.0 / RATE / leak
    mean, kept = -np.expm1(-ratio) / ratio, np.exp(-ratio)
    charge = warm = np.zeros(taxels)
    last, film, index = 0.0, 0.0, 0
    for now, _ in islice(warmth, BEFORE if drift else 0):
        warm, film = warm * kept + (now - film) * mean, now
    while True:
        noise = source.weights @ source.rows(index // 64) * (flicker / per_newton)
        noise += random.normal(0.0, sensor.adc.noise / per_newton, noise.shape) + offset
        for row, (now, readings) in zip(noise, warmth, strict=False):
            rise = min(max((index - start) / 20, 0.0), 1.0)
            charge = charge * kept + force * (rise - last) * mean
            warm = warm * kept + (now - film) * mean
            last, film = rise, now
            index += 1
            yield rise, charge + row + warm * per_kelvin, readings
