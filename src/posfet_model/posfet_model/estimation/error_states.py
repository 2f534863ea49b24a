# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The states of the force errors that all taxels share: what they are, how they change, and how well they are known.

All priors and process noises are assumed; those that a calibration determines are smaller with one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final

from posfet_model.calibration.taxel_calibration import (
    CHIP_WARMING_TIMES,
    NOMINAL_BENDING_DEVIATION,
    NOMINAL_WARMTH_DEVIATION,
    NOMINAL_WARMTH_FORCE,
    NOMINAL_WARMTH_TIME_CONSTANT,
    PLAY_HALF_WIDTHS,
    POLES,
    WARMTH_LEAST_DIFFERENCE,
    WARMTH_SPREAD,
    Calibration,
)


class Shared(IntEnum):
    """Index of each shared state."""

    CHIP = 0
    """Temperature of the chip since the start [K]."""
    RATE = 1
    """Its rate of change [K/s]."""
    FILM = 2
    """Temperature of the film since the start [K]: follows the chip."""
    SENSOR = 3
    """Temperature of the sensors since the start [K]: follows the chip."""
    LAG = 4
    """Natural logarithm of the time constant of the sensors' lag in seconds [1]."""
    SCALE = 5
    """Relative error of the sensors' scale [1]."""
    EARLIER = 6
    """Rate at which the film has warmed since before the start, which no charge shows [K/s]: the temperatures above are
    without it. Its charge is in the offsets, which leak; at the leak rates of the calibration."""
    ZERO = 7
    """Error of the first reading of the sensors, which says what zero is [K]."""
    BEND = 8
    """Charge of bending on every taxel, as a force per total force [1]."""
    BEND_X = 9
    """Its gradient: difference between the middle of the array and its edge in x [1]."""
    BEND_Y = 10
    """The same in y [1]."""
    BEND_MOMENT = 11
    """The same as a force away from the middle causes it: a chip bends around the place that is pressed [1]."""
    LEAK = 12
    """Relative error of the leak rates that all taxels have in common [1]."""
    WARMTH = 13
    """Temperature of the film of a touched taxel above the others [K]."""
    WEAK_WARMTH = 14
    """The same beyond what is expected where the force is weak [K]."""
    TAIL = 15
    """Force that the cover lets an untouched taxel feel, relative to that of a geometric decline [1]."""
    DRIFT = 16
    """What the offsets of all taxels have in common, as a rate of the force errors [N/s]."""
    CREEP = 17
    """First of the slow responses of the film to a force, relative to the force [1]; `CREEPS` of them."""


CREEPS: Final = POLES
"""Number of slow responses of the film."""

LOOPS: Final = len(PLAY_HALF_WIDTHS)
"""Sizes of the loops of the film's hysteresis."""

BENDS: Final = len(NOMINAL_BENDING_DEVIATION)
"""Number of the states of bending, from `Shared.BEND` on."""

COUNT: Final = Shared.CREEP + CREEPS
"""Number of shared states."""


@dataclass(frozen=True)
class ErrorPriors:
    """Standard deviations of the force errors; all assumed."""

    film_walk: float = 0.4e-3
    """Random walk of the film temperature, at least [K/sqrt(s)]."""
    rate: float = 0.05
    """Rate of the chip temperature at the start [K/s]."""
    rate_walk: float = 2e-3
    """Random walk of that rate [K/s/sqrt(s)], and"""
    rate_change: float = 3.0
    """the same as a share of the rate [1/sqrt(s)]: what warms the chip fast soon warms it less."""
    slow_rate: float = 0.0
    """Rate below which that share falls with the square root of the rate [K/s]: a slow drift goes on."""
    slow_rate_calibrated: float = 3.0
    """The same with calibration [K/s]: where the sensors' lag is known, they would show it. Above 0, readings may tell
    a press from a film that cools."""
    touch_rate: float = 0.01
    """Rate that an object on the chip causes beyond what is expected, per total force [K/s/N]."""
    touch_rate_calibrated: float = 0.015
    """The same with calibration [K/s/N], where bending is known: the rest of a common change is temperature."""
    warming_share: float = 0.25
    """Error of the rate at which an object is expected to warm the chip, as that rate changes [1]."""
    chip_times: tuple[float, ...] = CHIP_WARMING_TIMES
    """Time constants with which an object warms the chip [s], and"""
    chip_warming: tuple[float, ...] = (0.0,) * len(CHIP_WARMING_TIMES)
    """by how much, expected, per total force [K/N]."""
    fastest: float = 3.0
    """Greatest change of the chip's rate between two readings [K/s]."""
    lag: float = 0.4
    """Time constant of the sensors' lag [s]."""
    lag_least: float = 0.02
    """Least time constant of that lag [s]."""
    lag_spread: float = 0.8
    """Standard deviation of its logarithm [1]."""
    lag_spread_calibrated: float = 0.3
    """The same with calibration [1], and"""
    lag_resolution: float = 0.015
    """the standard deviation of that lag beyond it [s]: readings come ten times a second."""
    dead_share: float = 0.0
    """Share of that lag that a calibration found to be a dead time [1]; the filter has a lag of first order."""
    scale: float = 0.04
    """Scale of the temperature sensors [1], and"""
    scale_calibrated: float = 0.015
    """the same with calibration, in which they were the scale of the film's temperature [1]."""
    reading: float = 3.5e-3
    """A reading of the temperature sensors: rounding and noise [K]."""
    earlier: float = 3.5e-3
    """Rate at which the film has warmed since before the start [K/s]: readings soon show a higher one."""
    bend_mean: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """Charge of bending as a force per total force, its gradients in x and y over half the array, and that of the
    moment, expected [1], and"""
    bend: tuple[float, ...] = NOMINAL_BENDING_DEVIATION
    """their standard deviations [1]."""
    bend_profile: tuple[float, ...] = ()
    """Part of each taxel in the first of them [1]; empty: all the same."""
    bend_mounted: tuple[float, ...] = (1e-3, 0.5e-3, 0.5e-3, 0.5e-3)
    """The least of them with calibration [1], as the chip is mounted otherwise on its calibration rig, and"""
    bend_share: float = 0.25
    """share of the bending that a calibration found by which they grow [1]."""
    leak: float = 0.1
    """Leak rates that all taxels have in common [1]."""
    leak_calibrated: float = 0.03
    """The same with calibration: the effect of temperature and ageing [1]."""
    tail: float = 0.1
    """Force of a taxel beside a contact, relative to that of a geometric decline, expected under a fingertip [1]."""
    tail_spread: float = 0.2
    """Standard deviation of what these forces have in common [1]: beside a pad they do not decline geometrically."""
    tail_least: float = 0.005
    """The same as a share of its neighbours' force [1]."""
    tail_change: float = 0.003
    """Change of that force from block to block, as a share of the neighbours' force [1]."""
    warmth_mean: float = 0.0
    """Warmth of a touched taxel, expected [K], and"""
    warmth: float = NOMINAL_WARMTH_DEVIATION
    """its standard deviation [K]."""
    warmth_least: float = WARMTH_LEAST_DIFFERENCE
    """Difference between the warmth of one taxel and that of the others [K], and"""
    warmth_spread: float = WARMTH_SPREAD
    """as a share of the common warmth [1]."""
    warmth_force: float = NOMINAL_WARMTH_FORCE
    """Force of a taxel at which it has 1 - 1/e of that warmth [N], assumed: the thermal contact saturates, and"""
    warmth_steepness: float = 1.0
    """how abruptly [1], assumed: with what power of the force relative to that one."""
    warmth_force_spread: float = 10.0
    """Factor by which that force may be less [1], assumed: a soft object may touch a taxel wholly at once."""
    warmth_force_spread_calibrated: float = 2.0
    """The same with calibration [1]."""
    warmth_certain: float = 0.0
    """Share of the thermal contact by what a force is at least that is expected [1]: without a calibration none is, as
    warmth itself; with one, all."""
    warmth_contact: float = 0.58
    """Standard deviation of the thermal contact under a weak force, over the range in which it may be [1], and"""
    warmth_contact_calibrated: float = 0.2
    """the same with calibration [1]."""
    warmth_time: float = NOMINAL_WARMTH_TIME_CONSTANT
    """Time constant of that warmth [s]."""
    creep_times: tuple[float, ...] = (0.3, 2.0, 15.0)
    """Time constants of the slow responses of the film [s]."""
    creep_mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Their expected sizes [1], and"""
    creep: tuple[float, ...] = (0.008, 0.012, 0.015)
    """the standard deviations of these [1]."""
    creep_least: float = 0.003
    """Least standard deviation of a size with calibration [1]."""
    loop_half_widths: tuple[float, ...] = (0.025, 0.1, 0.4)
    """Half widths r of the play operators P of the film's hysteresis [N], and"""
    loop_weights: tuple[float, ...] = (0.0, 0.0, 0.0)
    """their weights w: a force F makes a charge of F + sum(w*(F - P)) - loop_slope*F [1]."""
    loop_slope: float = 0.0
    """Part of it that is in the gains [1]."""
    gain_least: float = 0.01
    """Gain of one taxel, in addition to what its calibration states [1]."""
    pyroelectric: float = 0.1
    """Pyroelectric response of one taxel, uncalibrated [1]."""
    pyroelectric_calibrated: float = 0.02
    """The same with calibration [1]."""
    drift: float = 2e-4
    """Common drift of the forces at the start, due to the offsets [N/s]."""
    offset_walk: float = 1e-5
    """Random walk of the offset of a signal [N/sqrt(s)]."""
    left_charge: float = 5e-5
    """Charge left by an earlier force at the start, as a voltage [V]; grows when rejected."""
    motion: float = 0.01
    """Share of a change of the force by which the film's hysteresis changes the baseline [1]."""

    def with_calibration(self, calibration: Calibration) -> ErrorPriors:
        """Return a copy with what a calibration determined.

        Parameters
        ----------
        calibration : Calibration
            Properties of each taxel; unchanged priors when uncalibrated.
        """
        if not calibration.calibrated:
            return self
        found: dict[str, Any] = {
            "leak": self.leak_calibrated,
            "pyroelectric": self.pyroelectric_calibrated,
            "scale": self.scale_calibrated,
            "reading": max(self.reading, calibration.temperature_reading_deviation),
        }
        if calibration.temperature_sensor_lag > 0.0:
            lag = max(calibration.temperature_sensor_lag, self.lag_least)
            spread = math.hypot(self.lag_spread_calibrated, self.lag_resolution / lag)
            found |= {"lag": lag, "lag_spread": spread, "slow_rate": self.slow_rate_calibrated}
            found["dead_share"] = min(calibration.temperature_sensor_dead_time / lag, 1.0)
        if calibration.warmth_deviation != NOMINAL_WARMTH_DEVIATION:  # stated, and not only assumed
            found["warmth"] = calibration.warmth_deviation
        if calibration.warmth_observed:
            deviation = math.hypot(calibration.warmth_deviation, self.warmth_least)
            found |= {"warmth_mean": calibration.warmth, "warmth": deviation}
            found |= {"warmth_time": calibration.warmth_time_constant, "warmth_contact": self.warmth_contact_calibrated}
            if abs(calibration.warmth) > self.warmth_least:  # what saturates is more than nothing
                found |= {"warmth_force": calibration.warmth_force, "warmth_certain": 1.0}
                found |= {"warmth_steepness": calibration.warmth_steepness}
                found |= {"warmth_force_spread": self.warmth_force_spread_calibrated}
        if len(calibration.chip_warming):
            sizes, times = calibration.chip_warming.tolist(), calibration.chip_warming_time_constants.tolist()
            found |= {"chip_warming": tuple(sizes), "chip_times": tuple(times)}
            found["touch_rate"] = self.touch_rate_calibrated
        if len(calibration.bending):
            sizes, deviations = calibration.bending.tolist(), calibration.bending_deviation.tolist()
            change = self.bend_share * max(map(abs, sizes))
            found["bend_mean"] = tuple(sizes)
            found["bend_profile"] = tuple(calibration.bending_profile.tolist())
            found["bend"] = tuple(
                math.hypot(deviation, change, least)
                for deviation, least in zip(deviations, self.bend_mounted, strict=True)
            )
        if len(calibration.hysteresis_weights) == LOOPS:
            found["loop_half_widths"] = tuple(calibration.hysteresis_half_widths.tolist())
            found["loop_weights"] = tuple(calibration.hysteresis_weights.tolist())
            found["loop_slope"] = calibration.hysteresis_slope
        times = calibration.relaxation_time_constants[:CREEPS].tolist()
        if times:
            kept = len(times)
            sizes, deviations = calibration.relaxation_sizes.tolist(), calibration.relaxation_deviations.tolist()
            found["creep_times"] = (*times, *self.creep_times[kept:])
            found["creep_mean"] = (*sizes[:kept], *self.creep_mean[kept:])
            stated = [math.hypot(each, self.creep_least) for each in deviations[:kept]]
            found["creep"] = (*stated, *self.creep[kept:])
        return replace(self, **found)
