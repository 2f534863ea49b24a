# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Least-squares calibration of every taxel from a recording with known forces, in steps that do not mix up the causes.

1. *Presses alone.* Gain, hysteresis, leakage and offset of each taxel are fitted while and shortly after it is pressed
   (`response_fit`), without the chip's temperature: a drift of the film over a second is an offset there. Where
   that does not tell the leakage, how much touched taxels are warmed is fitted, too: it looks like leakage. A first fit
   has the signals of the four neighbours as a further source, from which the crosstalk follows, for which the signals
   are then compensated; the total force is a source, too, so that bending of the chip does not count as crosstalk.
2. *Bending* of the chip, from the charge that presses make on untouched taxels (`bending_fit`).
3. *Temperature.* What the untouched taxels have in common, with leakage compensated, is compared with the chip's
   sensors (`temperature_fit`): lag of either sign, pyroelectric gains.
4. *Long hold.* The common-mode signal and bending are subtracted, and the sizes of slow poles (dielectric relaxation,
   viscoelastic creep) and the temperature rise of touched taxels are fitted jointly with the taxels' gain and leakage.
5. *Cover.* A force on the surface spreads over the taxels by a mixture of Gaussians. Their shares are fitted jointly
   with all of the last step: presses on all taxels determine the forces on each by all the others. A cover that spreads
   as the sensor file says is left as it is.
6. *Checks* (`fit_checks`): a fit whose residuals are not noise is refused.

Hysteresis of the film is fitted in all of them (`bench_signals`). Forces that are not typical have another gain than
typical ones, which the deviation of the gains contains (`ATYPICAL`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_model._lib.types import Mask
from posfet_model.calibration.bench_signals import (
    MIN_FORCE,
    TYPICAL_FORCE,
    BenchSignals,
    Recording,
    loop_slopes,
)
from posfet_model.calibration.bending_fit import BendingFit
from posfet_model.calibration.cover_fit import find_cover
from posfet_model.calibration.fit_checks import (
    LEAK_DEVIATION,
    check_bending,
    check_leakage,
    check_ranges,
    check_responses,
    check_temperature,
    check_warmth,
    leakage_deviation,
)
from posfet_model.calibration.fit_steps import FitSteps
from posfet_model.calibration.hold_out_error import hold_out_error
from posfet_model.calibration.response_fit import ResponseFit
from posfet_model.calibration.stuck_bits import find_stuck_bits
from posfet_model.calibration.taxel_calibration import (
    CALIBRATED_COMMON_GAIN_DEVIATION,
    CHIP_WARMING_TIMES,
    COVER_SPREADS,
    NOMINAL_WARMTH_DEVIATION,
    PLAY_HALF_WIDTHS,
    POLES,
    WARMTH_LEAST_DIFFERENCE,
    WARMTH_SPREAD,
    Calibration,
)
from posfet_model.calibration.temperature_fit import TemperatureFit
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import charge_per_newton

DEAD_GAIN: Final = 0.1
"""A taxel with a smaller gain is dead [1]."""

ATYPICAL: Final = 3.0
"""Forces of a third of the typical one and three times as strong are one standard deviation from it [1], assumed."""

HYSTERESIS_UNCERTAINTY: Final = 0.03
"""Standard deviation of the size of a relaxation pole, relative to the sum of the weights w of the play operators [1]:
loops of other half widths than these three leave that much, as measured on films with one to five others."""

ROUNDS: Final = 2
"""Rounds of steps 2 to 4: the first knows no slow poles, which leave charge on taxels that are no longer touched."""

MAX_WARMTH_DEVIATION: Final = 0.01
"""The temperature rise of touched taxels counts as measured with a smaller standard deviation [K]."""

LEAST_SENSOR_LAG: Final = 2e-3
"""Time constant of the lag of temperature sensors that are faster than the film [s], assumed."""


def fit(sensor: Sensor, recording: Recording, date: str) -> Calibration:
    """Return the calibration of a sensor from a recording with known forces.

    Parameters
    ----------
    sensor : Sensor
        The sensor file, whose values are the nominal ones.
    recording : Recording
        Scans and forces; at least four leakage time constants long, with at least 0.2 N on every taxel.
    date : str
        When the recording was made, ISO 8601.

    Returns
    -------
    Calibration
        Gain, pyroelectric gain, time constant and offset of every taxel, crosstalk, thermal lag, relaxation, and the
        residuals on the hold-out set.

    Raises
    ------
    ValueError
        The recording is too short, has the wrong shape, leaves a taxel without force, no taxel responds, or a part of
        the fit leaves residuals that are not noise; one line.
    """
    _check(sensor, recording)
    bench = BenchSignals(sensor, recording)
    for taxel in range(bench.taxels):
        if not bench.intervals(taxel, with_hold=False):
            raise ValueError(f"taxel {taxel} must be pressed before the long hold, or well after it, but was not")
    steps = FitSteps(bench)
    stuck = find_stuck_bits(recording.counts)
    found = _fit_presses(steps, stuck)
    if bench.hold is not None and leakage_deviation(found, steps.dead)[0] > LEAK_DEVIATION:
        steps.warm_presses = True
        found = _fit_presses(steps, stuck)
    dead = steps.dead
    check_leakage(sensor, found, dead)
    check_ranges(sensor, found, dead)
    for index in range(ROUNDS):
        bending = steps.find_bending(found)
        steps.find_common_mode(found)
        thermal = steps.fit_temperature()
        steps.find_shares(found)
        last = index == ROUNDS - 1
        steps.fit_warmth(found)
        found = steps.fit_all(found, with_crosstalk=not last)
        if not last:
            bench.compensate(bench.crosstalk + _crosstalk(found))
            found = find_cover(steps, found)
    steps.find_common_mode(found)
    if thermal is not None:
        check_temperature(thermal, bench.block_temperature)
    check_ranges(sensor, found, dead)
    check_warmth(float(found.common[POLES]) if len(found.common) else 0.0)
    check_bending(bending)
    check_responses(steps.segments, found, bench.noise, bench.hold)
    return _calibration(steps, found, bending, thermal, date)


def _fit_presses(steps: FitSteps, stuck: Mask) -> ResponseFit:
    """Fit the presses alone, with crosstalk compensated, and find the dead taxels; those with a stuck bit are."""
    bench = steps.bench
    total = np.broadcast_to(bench.force.sum(axis=1, keepdims=True), bench.force.shape)
    bench.compensate(0.0)
    bench.compensate(_crosstalk(steps.fit_presses(total, bench.near_signal)))
    found = steps.fit_presses()
    steps.dead = stuck | np.array([found.taxels[taxel].gain < DEAD_GAIN for taxel in range(bench.taxels)])
    if steps.dead.all():
        raise ValueError("no taxel responds to the force: nothing to calibrate")
    return found


def _calibration(
    steps: FitSteps, found: ResponseFit, bending: BendingFit, thermal: TemperatureFit | None, date: str
) -> Calibration:
    """Return the calibration that a fit has found."""
    bench, sensor, dead = steps.bench, steps.bench.sensor, steps.dead
    nominal_tau = sensor.device.leak_time_constant
    gain, tau = np.full(bench.taxels, np.nan), np.full(bench.taxels, nominal_tau)
    gain_deviation, leak_deviation = np.zeros(bench.taxels), np.zeros(bench.taxels)
    for taxel in steps.alive:
        each = found.taxels[taxel]
        gain[taxel] = each.gain
        tau[taxel] = 1.0 / each.rate
        gain_deviation[taxel] = each.deviations[0] / each.gain
        leak_deviation[taxel] = each.deviations[-1] / each.rate
    nominal = sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)
    pyroelectric = np.ones(bench.taxels)
    if thermal is not None and nominal:
        pyroelectric = np.where(dead, 1.0, steps.shares * thermal.newton_per_kelvin / nominal)
    poles = POLES if bench.hold is not None else 0
    weights = np.median([each.coefficients[1:] / each.gain for each in found.taxels.values()], axis=0)
    atypical = loop_slopes(TYPICAL_FORCE / ATYPICAL) - loop_slopes(TYPICAL_FORCE * ATYPICAL)
    unknown = HYSTERESIS_UNCERTAINTY * np.abs(weights).sum()
    deviations = np.hypot(np.sqrt(np.diag(found.common_covariance)[:poles]), unknown)
    warmth, warmth_deviation = 0.0, NOMINAL_WARMTH_DEVIATION
    deviation = math.sqrt(float(found.common_covariance[poles, poles])) if poles else math.inf
    if deviation < MAX_WARMTH_DEVIATION:
        warmth = float(found.common[poles])
        warmth_deviation = math.hypot(deviation, WARMTH_LEAST_DIFFERENCE + WARMTH_SPREAD * abs(warmth))
    spreads = np.array((1.0, *COVER_SPREADS) if len(bench.cover) > 1 else ()) * sensor.device.contact_spread
    film_lag, sensor_lag = sensor.device.thermal_time_constant, 0.0
    temperature: dict[str, float] = {}
    if thermal is not None:
        temperature["temperature_reading_deviation"] = thermal.reading_deviation
        temperature["leak_per_kelvin"] = thermal.leak_per_kelvin
        temperature["leak_per_kelvin_deviation"] = thermal.leak_per_kelvin_deviation
        film_lag = thermal.lag + LEAST_SENSOR_LAG if thermal.lag >= 0.0 else film_lag
        sensor_lag = film_lag - thermal.lag
        temperature["temperature_sensor_dead_time"] = thermal.dead_share * sensor_lag
    return Calibration(
        gain=gain,
        pyroelectric_gain=pyroelectric,
        leak_time_constant=tau,
        offset=np.where(dead, 0.0, steps.offsets) * sensor.volts_per_newton,
        gain_deviation=gain_deviation,
        leak_deviation=leak_deviation,
        crosstalk=bench.crosstalk,
        common_gain_deviation=math.hypot(CALIBRATED_COMMON_GAIN_DEVIATION, 0.5 * float(weights @ atypical)),
        thermal_time_constant=film_lag,
        date=date,
        residuals=hold_out_error(steps, found),
        relaxation_time_constants=np.array(steps.poles[:poles]),
        relaxation_sizes=found.common[:poles],
        relaxation_deviations=deviations,
        hysteresis_half_widths=np.array(PLAY_HALF_WIDTHS) * sensor.device.force_max,
        hysteresis_weights=weights,
        hysteresis_slope=float(weights @ loop_slopes(TYPICAL_FORCE)),
        warmth=warmth,
        warmth_deviation=warmth_deviation,
        warmth_time_constant=steps.warmth_time,
        warmth_force=steps.warmth_force,
        warmth_steepness=steps.warmth_steepness,
        bending=bending.sizes,
        bending_deviation=bending.deviations,
        bending_profile=steps.profile,
        cover_spreads=spreads,
        cover_shares=bench.cover[: len(spreads)],
        chip_warming_time_constants=np.array(CHIP_WARMING_TIMES),
        chip_warming=bending.warming,
        temperature_sensor_lag=sensor_lag,
        temperature=bench.pressed_temperature,
        **temperature,
    )


def _check(sensor: Sensor, recording: Recording) -> None:
    taxels, scans = sensor.layout.taxels, len(recording.time)
    if recording.counts.shape != (scans, taxels) or recording.force.shape != (scans, taxels):
        raise ValueError(f"counts and force must have shape ({scans}, {taxels}), got {recording.counts.shape}")
    if scans < 2 or recording.time[-1] - recording.time[0] < 4 * sensor.device.leak_time_constant:
        raise ValueError("the recording must last at least four leakage time constants")
    if not np.isfinite(recording.force).all() or not np.isfinite(recording.temperature).all():
        raise ValueError("force and temperature must be finite")
    weak = np.flatnonzero(recording.force.max(axis=0) < MIN_FORCE)
    if len(weak):
        raise ValueError(f"every taxel must be pressed with {MIN_FORCE:g} N, but taxel {weak[0]} was not")


def _crosstalk(found: ResponseFit) -> float:
    """Return the share of each neighbour's signal that a taxel picks up: the median over the taxels."""
    shares = [float(each.coefficients[-1]) for each in found.taxels.values() if each.gain >= DEAD_GAIN]
    return float(np.median(shares)) if shares else 0.0
