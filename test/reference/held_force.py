# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A force held by many taxels at once: the estimator against the optimal one, which knows the true noise.

The taxels have the white and 1/f noise of the simulated board (sums of octaves, not the Markov processes of a filter)
and individual offsets. They are at rest, then all pressed with the same force. The temperature is constant or drifts
(temperature_drift.py).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice, repeat
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.estimation.error_states import BENDS, CREEPS, ErrorPriors
from posfet_model.estimation.force_estimator import BLOCK as DURATION
from posfet_model.estimation.force_estimator import ForceEstimator
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.signal_chain import charge_per_newton
from posfet_sim.device.flicker_noise import FlickerNoise
from reference.temperature_drift import (
    RESOLUTION,
    STEP,
    TIME_CONSTANTS,
    WARM_UP_SCANS,
    CommonModeFilter,
    Drift,
    newton_per_kelvin,
)

BLOCK: Final = 20
"""Number of scans in a block of the optimal estimator."""

RATE: Final = 1.0 / STEP
"""Scan rate [Hz]."""

COMMON_LEAKAGE: Final = 0.07
"""Relative deviation of the leakage time constants that all taxels have in common, where they are estimated online
[1]: the effect of temperature and ageing."""

OWN_LEAKAGE: Final = 0.02
"""The same of each taxel's own [1]."""

EXACT: Final = 1e-6
"""Relative deviation of what is known exactly [1]."""

KNOWN_FILM: Final = ErrorPriors(
    lag=EXACT,
    lag_least=EXACT,
    lag_spread=EXACT,
    scale=EXACT,
    reading=RESOLUTION / math.sqrt(24.0),
    leak_calibrated=EXACT,
    bend=(EXACT,) * BENDS,
    warmth=EXACT,
    warmth_least=EXACT,
    creep=(EXACT,) * CREEPS,
    gain_least=EXACT,
    motion=0.0,
)
"""No hysteresis, creep, bending or warmth of touched taxels, and two temperature sensors, only rounded and without lag:
as for the optimal estimator."""


class OptimalFilter:
    """Kalman filter of each taxel that knows the noise model and the times of contact.

    1/f noise is a sum of first-order Markov processes, one per decade from 10 ms to 1000 s. A taxel at rest shows its
    noise alone: the filter estimates the noise from it, predicts the noise while a force is held, and subtracts the
    prediction from signal and leaked charge. The individual part of a taxel's thermal signal is a random constant times
    the common thermal signal, which is an input.
    """

    def __init__(self, taxels: int, white: float, flicker: float, leakage: NDArray[np.float64], spread: float) -> None:
        """Set the variance of a reading [N2], the density of 1/f noise at 1 Hz [N2], time constants and spread.

        `leakage` holds the leakage time constants [s], shape [taxels]; `spread` [1] is the relative standard deviation
        of the pyroelectric response.
        """
        decade = flicker * math.log(10.0)
        self._state = np.zeros((len(TIME_CONSTANTS) + 2, taxels))  # the last two: offset and pyroelectric deviation
        self._covariance = np.diag([*(decade for _ in TIME_CONSTANTS), 1.0, spread**2])
        self._white = white / BLOCK
        self._decay = np.array([*np.exp(-BLOCK / RATE / TIME_CONSTANTS), 1.0, 1.0])
        self._noise = np.diag(decade * (1.0 - self._decay**2))
        self._leakage = leakage
        self._leaked = np.zeros(taxels)

    def update_at_rest(self, mean: NDArray[np.float64], thermal: float) -> None:
        """Process the mean signal of a block without force, and the thermal signal already subtracted from it [N]."""
        self._predict()
        shown = np.append(np.ones(len(self._state) - 1), thermal)
        seen = self._covariance @ shown
        gain = seen / (shown @ seen + self._white)
        self._state += np.outer(gain, mean - shown @ self._state)
        self._covariance -= np.outer(gain, seen)

    def update_held(self, mean: NDArray[np.float64], thermal: float) -> NDArray[np.float64]:
        """Process the mean signal and thermal signal of a block under force; return the mean force, all [N]."""
        self._predict()
        charge = mean - self._state[:-1].sum(axis=0)
        step = charge * (BLOCK / RATE / self._leakage)
        self._leaked += step
        return charge + self._leaked - 0.5 * step - thermal * (1.0 + self._state[-1])

    def _predict(self) -> None:
        self._state *= self._decay[:, None]
        self._covariance *= np.outer(self._decay, self._decay)
        self._covariance += self._noise


@dataclass(frozen=True)
class Held:
    """Errors of a held force at one time of the hold, over all taxels."""

    time: float
    """Time since the onset of the force [s]."""
    force: float
    """True force [N]."""
    error: float
    """Root mean square error of the estimator, in means over 0.1 s [N]."""
    optimal: float
    """Error of the optimal estimator, in the same means [N]; NaN if some taxels are left untouched."""
    deviation: float
    """Standard uncertainty that the estimator reports [N]."""
    inside: float
    """Coverage of the two-sigma interval: share of the taxels whose true force lies in it [1]."""


def hold(
    seed: int,
    times: tuple[float, ...] = (1.0, 5.0, 20.0),
    force: float = 2.0,
    rest: float = 2.0,
    flicker: float = 10e-6,
    side: int = 16,
    drift: Drift | None = None,
    leakage_estimated: bool = False,
    untouched: int = 0,
) -> Iterator[Held]:
    """Yield the errors of a held force, at `times` after its onset.

    The estimator knows gains and film, and not the noise.

    Parameters
    ----------
    seed : int
        Seed of the noise and of the drift.
    times : tuple of float
        Times since the onset of the force [s].
    force : float
        True force on each pressed taxel [N].
    rest : float
        Duration at rest before the onset [s].
    flicker : float
        1/f noise at 1 Hz [V/sqrt(Hz)].
    side : int
        Number of rows and of columns of the array.
    drift : Drift, optional
        Drift of the temperature; constant temperature without it.
    leakage_estimated : bool
        Whether the leakage time constants that the estimator assumes have the error of a calibration; the optimal
        estimator always knows the true ones.
    untouched : int
        Number of taxels left untouched. The errors exclude them, and the optimal estimator does not use them.
    """
    sensor = load_sensor()
    sensor = replace(sensor, layout=replace(sensor.layout, rows=side, cols=side))
    taxels, start = sensor.layout.taxels, round(rest * RATE)
    random = np.random.default_rng([seed, 3])
    wrong = COMMON_LEAKAGE * random.standard_normal() + OWN_LEAKAGE * random.standard_normal(taxels)
    leakage = sensor.device.leak_time_constant * np.exp(wrong * leakage_estimated)
    optimal = None if untouched else _OptimalEstimator(sensor, flicker, drift, leakage)
    known = replace(KNOWN_FILM, leak_calibrated=COMMON_LEAKAGE if leakage_estimated else EXACT, touch_rate=0.0)
    if drift:
        # Both estimators know that the ramp begins with the touch, and so what the film did before the start.
        rate = drift.random_walk / math.sqrt(2.0 * sensor.device.leak_time_constant)
        known = replace(known, earlier=max(rate, EXACT), touch_rate=drift.ramp / (force * (taxels - untouched)))
    estimated = _estimated(sensor, known, OWN_LEAKAGE if leakage_estimated else EXACT)
    touched = np.zeros(taxels, np.bool_)
    recent: deque[NDArray[np.float64]] = deque(maxlen=100)
    best: list[NDArray[np.float64]] = []
    pressed = np.arange(taxels) >= untouched
    signals = _signals(sensor, seed, start, force * pressed, flicker, drift, leakage)
    for index, (rise, signal, readings) in enumerate(signals):
        _observe(estimated, signal * charge_per_newton(sensor), readings, touched, sensor.contact.threshold)
        if optimal:
            best = [*best[-4:], *optimal.update(signal, readings, index >= start)]
        recent.append(estimated.force.copy())
        held = (index + 1 - start) / RATE
        if held in times:
            true = force * rise
            error = np.mean(recent, axis=0)[pressed] - true
            shared = np.square(estimated.correlated_error).sum(axis=1)
            deviation = np.sqrt(estimated.force_variance(np.empty(taxels)) + shared)[pressed]
            yield Held(
                time=held,
                force=true,
                error=float(np.sqrt(np.mean(error**2))),
                optimal=float(np.sqrt(np.mean((np.mean(best, axis=0) - true) ** 2))) if optimal else math.nan,
                deviation=float(np.mean(deviation)),
                inside=float(np.mean(np.abs(estimated.force[pressed] - true) <= 2 * deviation)),
            )
            if held >= max(times):
                return


class _OptimalEstimator:
    """The optimal estimator, scan by scan: a filter of the common mode and one of each taxel's own signal."""

    def __init__(self, sensor: Sensor, flicker: float, drift: Drift | None, leakage: NDArray[np.float64]) -> None:
        white, density = (sensor.adc.noise / sensor.volts_per_newton) ** 2, (flicker / sensor.volts_per_newton) ** 2
        taxels, spread = sensor.layout.taxels, drift.spread if drift else 0.0
        self._common = CommonModeFilter(sensor, drift, white, density) if drift else None
        self._individual = OptimalFilter(taxels, white, density, leakage, spread)
        self._mean = np.zeros(taxels)
        self._scans = 0

    def update(
        self, signal: NDArray[np.float64], readings: NDArray[np.float32], touched: bool
    ) -> Iterator[NDArray[np.float64]]:
        """Process a scan [N] and temperatures [degC]; yield the mean force [N] at the end of a block under force."""
        self._mean += signal / BLOCK
        self._scans += 1
        if self._common:
            self._common.update(float(signal.mean()), readings, touched)
        if self._scans % BLOCK:
            return
        common, thermal = self._common.close_block(BLOCK) if self._common else (0.0, 0.0)
        if touched:
            yield self._individual.update_held(self._mean - common, thermal)
        else:
            self._individual.update_at_rest(self._mean - common, thermal)
        self._mean[:] = 0.0


def _estimated(sensor: Sensor, known: ErrorPriors, own_leakage: float) -> ForceEstimator:
    """Return the estimator with a recorded calibration without error, and exact gains."""
    calibration = replace(
        Calibration.nominal(sensor),
        residuals=Residuals(0.0, 0.0, 1),
        gain_deviation=np.full(sensor.layout.taxels, EXACT),
        common_gain_deviation=EXACT,
        leak_deviation=np.full(sensor.layout.taxels, own_leakage),
    )
    return ForceEstimator(sensor, known, calibration)


def _observe(
    estimated: ForceEstimator,
    charge: NDArray[np.float64],
    readings: NDArray[np.float32],
    touched: NDArray[np.bool_],
    threshold: float,
) -> None:
    """Process a scan; taxels above the contact threshold count as touched."""
    if not estimated.integration.process(charge, readings, 1.0 / RATE):
        estimated.start(charge)
    estimated.integration.compensate_common_mode(bool(touched.any()))
    touched |= estimated.force > threshold
    if estimated.block_time >= DURATION:
        estimated.close_block(touched, [touched.nonzero()[0]] if touched.any() else [])
        touched[:] = estimated.force > threshold


def _signals(
    sensor: Sensor,
    seed: int,
    start: int,
    force: NDArray[np.float64],
    flicker: float,
    drift: Drift | None,
    leakage: NDArray[np.float64],
) -> Iterator[tuple[float, NDArray[np.float64], NDArray[np.float32]]]:
    """Yield, for each scan, the applied share of the `force` [N], the signals [N] and temperatures [degC], without end.

    The signals are forces with charge leakage, not compensated.
    """
    taxels, random = sensor.layout.taxels, np.random.default_rng(seed)
    per_newton = sensor.volts_per_newton
    source = FlickerNoise(seed, taxels, 64)
    offset = random.normal(0.0, 5e-3 / per_newton, taxels)
    steady = repeat((0.0, np.full(2, 25.0, np.float32)))
    temperatures = drift.scans(seed, start, sensor.device.thermal_time_constant) if drift else steady
    spread = drift.spread if drift else 0.0
    per_kelvin = newton_per_kelvin(sensor) * (1.0 + spread * np.random.default_rng([seed, 2]).standard_normal(taxels))
    ratio = 1.0 / RATE / leakage
    mean, decay = -np.expm1(-ratio) / ratio, np.exp(-ratio)
    charge = thermal = np.zeros(taxels)
    last, film, index = 0.0, 0.0, 0
    for now, _ in islice(temperatures, WARM_UP_SCANS if drift else 0):
        thermal, film = thermal * decay + (now - film) * mean, now
    while True:
        noise = source.weights @ source.rows(index // 64) * (flicker / per_newton)
        noise += random.normal(0.0, sensor.adc.noise / per_newton, noise.shape) + offset
        for row, (now, readings) in zip(noise, temperatures, strict=False):
            rise = min(max((index - start) / 20, 0.0), 1.0)
            charge = charge * decay + force * (rise - last) * mean
            thermal = thermal * decay + (now - film) * mean
            last, film = rise, now
            index += 1
            yield rise, charge + row + thermal * per_kelvin, readings
