# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Steps of a calibration fit, and what they have found so far: each explains one cause of the signals.

All of them read the signals and forces of `BenchSignals`. What one step finds the others subtract.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.bench_signals import NO_FORCE, SOURCES, BenchSignals, runs
from posfet_model.calibration.bending_fit import BendingFit, UntouchedTaxel, fit_bending
from posfet_model.calibration.leaky_response import block_means, compensated, high_pass, low_pass
from posfet_model.calibration.response_fit import (
    WARMTH_FORCE_SPREAD,
    WARMTH_FORCES,
    WARMTH_STEEPNESSES,
    WARMTH_TIME_CONSTANTS,
    WARMTH_TIME_SPREAD,
    ResponseFit,
    Segment,
    TaxelResponse,
    fit_responses,
    least_of_parabola,
)
from posfet_model.calibration.taxel_calibration import (
    NOMINAL_WARMTH_FORCE,
    NOMINAL_WARMTH_TIME_CONSTANT,
    POLES,
    WARMTH_LEAST_DIFFERENCE,
)
from posfet_model.calibration.temperature_fit import TemperatureFit, fit_temperature
from posfet_model.sensor.signal_chain import charge_per_newton

MIN_TEMPERATURE_RANGE: Final = 0.5
"""The temperature has to vary by at least this much for the pyroelectric gain to be fitted [K]."""

LEAK_IN_DECADE: Final = math.log10(2.7)
"""Where the leakage time constant is between the time constants of two poles, in decades after the faster one [1]: a
pole with the time constant of the leakage cannot be told from it."""

SLOWEST_POLE: Final = 5.0
"""The slowest pole has at least this time constant, and less than ten times it [s]: within a long hold."""

SLOW_SOURCES: Final = POLES + 1
"""Number of the common sources that come in slowly: relaxation, and the temperature rise of a touched taxel."""

SIZE_PRIOR: Final = 0.1
"""Prior standard deviation of the size of a relaxation pole [1], assumed; for sizes that are not observable."""

WARMTH_PRIOR: Final = 0.3
"""Prior standard deviation of the temperature rise of a touched taxel [K], assumed: that of a thin chip."""

SLOPE_STEP: Final = 0.05
"""Difference of the logarithms over which slopes are taken [1]."""

REFINEMENTS: Final = 2
"""Corrections of time constant and force of the temperature rise after the search."""

LARGEST_STEP: Final = 0.3
"""Largest such correction of their logarithms [1]."""

COVER_PRIOR: Final = 0.5
"""Prior standard deviation of the share that each of these has [1], assumed."""

MIN_UNTOUCHED: Final = 3
"""Fewest untouched taxels from which the common-mode signal is known."""


class FitSteps:
    """The steps, in the order in which they are first taken.

    Parameters
    ----------
    bench : BenchSignals
        Signals and forces.

    Attributes
    ----------
    bench : BenchSignals
        Signals and forces.
    dead : ndarray of bool
        Taxels that measure nothing, shape [taxels].
    poles : tuple of float
        Time constants of the relaxation poles [s].
    segments : list of Segment
        Segments of the last fit.
    common : ndarray
        Common-mode signal of the untouched taxels, leakage compensated [N], shape [scans].
    shares : ndarray
        Signal of each taxel per common-mode signal [1], shape [taxels].
    offsets : ndarray
        Offset of each taxel [N], shape [taxels].
    time_constant : float
        Median time constant of the leakage [s].
    bending : ndarray
        Bending of the chip [1], shape [4].
    profile : ndarray
        Part of each taxel in it [1], shape [taxels].
    newton_per_kelvin : float
        Pyroelectric signal [N/K].
    warmth_time : float
        Time constant of the temperature rise of touched taxels [s].
    warmth_force : float
        Force at which they have 1 - 1/e of it [N].
    warmth_steepness : float
        Power of the force relative to that one with which it becomes whole [1].
    warm_presses : bool
        Whether the presses tell nothing without the temperature rise.
    """

    def __init__(self, bench: BenchSignals) -> None:
        self.bench, self.dead = bench, np.zeros(bench.taxels, np.bool_)
        self.poles = relaxation_poles(bench.sensor.device.leak_time_constant)
        self.segments: list[Segment] = []
        self.common = np.zeros(len(bench.time))
        self.shares = np.ones(bench.taxels)
        self.offsets = np.zeros(bench.taxels)
        self.time_constant = bench.sensor.device.leak_time_constant
        self.bending, self.profile = np.zeros(4), np.ones(bench.taxels)
        self.newton_per_kelvin = bench.sensor.device.pyroelectric_coefficient / charge_per_newton(bench.sensor)
        self.warmth_time = NOMINAL_WARMTH_TIME_CONSTANT
        self.warmth_force = NOMINAL_WARMTH_FORCE
        self.warmth_steepness = 1.0
        self.warm_presses = False

    @property
    def alive(self) -> list[int]:
        """Numbers of the taxels that are not dead."""
        return [int(taxel) for taxel in np.flatnonzero(~self.dead)]

    def fit_presses(self, *further: Array) -> ResponseFit:
        """Fit the presses alone, and find the offsets; where presses are warm, how much touched taxels are warmed, too.

        Parameters
        ----------
        *further : ndarray
            Further sources [N], shape [scans, taxels]: one that leaks, then signals.

        Returns
        -------
        ResponseFit
            The fit, without poles; where presses are warm, those before the warmth have the size 0.
        """
        bench = self.bench
        segments = []
        for taxel in range(bench.taxels):
            warmth = self._warmth_source(taxel, 1.0)[:, None] if self.warm_presses else None
            segments += [
                bench.segment(taxel, begin, end, bench.signal[begin:end, taxel], further, warmth)
                for begin, end in bench.intervals(taxel, with_hold=False)
            ]
        found = fit_responses(
            segments,
            bench.noise,
            bench.start(SOURCES + len(further)),
            1.0 / bench.sensor.device.leak_time_constant,
            np.array([WARMTH_PRIOR]) if self.warm_presses else None,
        )
        self.offsets = np.array([np.median(found.taxels[taxel].offsets) for taxel in range(bench.taxels)])
        return found.with_common_before(POLES) if self.warm_presses else found

    def find_bending(self, fitted: ResponseFit) -> BendingFit:
        """Find the bending of the chip from what untouched taxels show.

        Parameters
        ----------
        fitted : ResponseFit
            The fit so far.

        Returns
        -------
        BendingFit
            Sizes and standard deviations.
        """
        bench = self.bench
        untouched = bench.untouched
        pressed = block_means(bench.force.sum(axis=1), bench.size) > NO_FORCE
        taxels = []
        for taxel in self.alive:
            found = fitted.taxels[taxel]
            charge = compensated(bench.time, bench.signal[:, taxel] - self.offsets[taxel], 1.0 / found.rate)
            charge = (charge - self._slow_charge(taxel, found.gain, fitted)) / found.gain - bench.force[:, taxel]
            near = bench.force[:, bench.neighbours[taxel]].sum(axis=1)
            per_kelvin = self.newton_per_kelvin * self.shares[taxel] / found.gain
            taxels.append(
                UntouchedTaxel(
                    charge=block_means(charge, bench.size),
                    sources=block_means(bench.bending_sources.of_all(taxel, per_kelvin, near), bench.size),
                    used=untouched[:, taxel] & pressed,
                    noise=bench.noise[taxel] / found.gain,
                )
            )
        bending = fit_bending(taxels)
        self.bending = bending.sizes
        self.profile[self.alive] = bending.profile
        return bending

    def find_common_mode(self, fitted: ResponseFit) -> None:
        """Find what the untouched taxels have in common, as the mean of their changes with leakage compensated.

        Bending, weak forces, and what an earlier touch still brings in by the slow poles, are subtracted.

        Parameters
        ----------
        fitted : ResponseFit
            The fit so far.
        """
        bench = self.bench
        self.time_constant = float(np.median([1.0 / each.rate for each in fitted.taxels.values()]))
        usable = ~bench.near_force & ~self.dead
        enough = usable.sum(axis=1) >= MIN_UNTOUCHED
        step = np.diff(bench.time)
        changes, weights = np.zeros(len(step)), np.zeros(len(step))
        for taxel in self.alive:
            found = fitted.taxels[taxel]
            signal = bench.signal[:, taxel] - self.offsets[taxel]
            change = np.diff(signal) + 0.5 * (signal[1:] + signal[:-1]) * step * found.rate
            change -= np.diff(self.charge(taxel, fitted))
            used = (usable[1:, taxel] & usable[:-1, taxel]) * 1.0
            changes += used * change
            weights += used
        changes = np.where(enough[1:], changes / np.maximum(weights, 1.0), 0.0)
        self.common = np.concatenate([[0.0], np.cumsum(changes)])

    def fit_temperature(self) -> TemperatureFit | None:
        """Fit lag and pyroelectric gain; the common mode loses its drift.

        Returns
        -------
        TemperatureFit or None
            The fit; None if the temperature varies too little, or the film has no pyroelectric signal.
        """
        bench = self.bench
        if bench.sensor.device.pyroelectric_coefficient == 0.0:
            return None
        time, common = block_means(bench.time, bench.size), block_means(self.common, bench.size)
        used = ~bench.during_hold(time)
        if np.ptp(bench.block_temperature[used]) < MIN_TEMPERATURE_RANGE:
            used[:] = True
        if np.ptp(bench.block_temperature[used]) < MIN_TEMPERATURE_RANGE:
            return None
        thermal = fit_temperature(
            time[used],
            bench.block_temperature[used],
            common[used],
            self._changing(used)[used],
            bench.sensor.device.thermal_time_constant,
            bench.pressed_temperature - float(bench.temperature[0]),
            self.time_constant,
        )
        self.common = self.common - thermal.drift * bench.time
        self.newton_per_kelvin = thermal.newton_per_kelvin
        return thermal

    def find_shares(self, fitted: ResponseFit) -> None:
        """Find how strongly each taxel shows the common-mode signal while it is untouched, and its offset.

        Parameters
        ----------
        fitted : ResponseFit
            The fit so far.
        """
        bench = self.bench
        share, offset = np.ones(bench.taxels), np.zeros(bench.taxels)
        varies = np.ptp(bench.temperature) >= MIN_TEMPERATURE_RANGE
        for taxel in self.alive:
            found = fitted.taxels[taxel]
            tau = 1.0 / found.rate
            offset[taxel] = np.median(found.offsets)
            parts = [part for part in runs(~bench.near_force[:, taxel]) if part[1] - part[0] >= 50 * bench.size]
            rows, values = [], []
            for index, (begin, end) in enumerate(parts):
                time = bench.time[begin:end]
                columns = np.zeros((end - begin, 2 + len(parts)))
                columns[:, 0] = high_pass(time, self.common[begin:end], tau)
                columns[:, 1] = 1.0
                columns[:, 2 + index] = np.exp(-(time - time[0]) / tau)
                rows.append(block_means(columns, bench.size))
                known = high_pass(time, self.charge(taxel, fitted)[begin:end], tau)
                values.append(block_means(bench.signal[begin:end, taxel] - known, bench.size))
            if not rows:
                continue
            system, signal = np.concatenate(rows), np.concatenate(values)
            if not varies:
                signal, system = signal - system[:, 0], system[:, 1:]
            solved = np.linalg.lstsq(system, signal, rcond=None)[0]
            offset[taxel] = solved[1 if varies else 0]
            if varies:
                share[taxel] = solved[0]
        self.shares, self.offsets = share, offset

    def fit_warmth(self, before: ResponseFit) -> None:
        """Find time constant and saturation of the temperature rise of touched taxels, from the nominal ones.

        Parameters
        ----------
        before : ResponseFit
            The fit so far.
        """
        if self.bench.hold is None:
            return
        self.warmth_time, self.warmth_force = NOMINAL_WARMTH_TIME_CONSTANT, NOMINAL_WARMTH_FORCE
        self.warmth_steepness = 1.0
        nominal = self.fit_all(before)
        if abs(float(nominal.common[POLES])) < WARMTH_LEAST_DIFFERENCE:
            return  # no more than the taxels may differ by: what fits best is that of something else

        def fit_with(time: float, force: float) -> ResponseFit:
            self.warmth_time, self.warmth_force = time, force
            return self.fit_all(before)

        def likeliest_force(near: float) -> float:
            return self._likeliest(
                WARMTH_FORCES,
                NOMINAL_WARMTH_FORCE,
                WARMTH_FORCE_SPREAD,
                lambda each: fit_with(NOMINAL_WARMTH_TIME_CONSTANT, each),
                near,
            )

        force = likeliest_force(NOMINAL_WARMTH_FORCE)
        best, steepness = fit_with(NOMINAL_WARMTH_TIME_CONSTANT, force), self.warmth_steepness
        for steeper in WARMTH_STEEPNESSES:
            self.warmth_steepness = steeper
            found = fit_with(NOMINAL_WARMTH_TIME_CONSTANT, force)
            if np.argmin(self._improbable([best, found])) == 0:
                break
            force, steepness = likeliest_force(force), steeper
            best = fit_with(NOMINAL_WARMTH_TIME_CONSTANT, force)
        self.warmth_steepness = steepness
        time = self._likeliest(
            WARMTH_TIME_CONSTANTS,
            NOMINAL_WARMTH_TIME_CONSTANT,
            WARMTH_TIME_SPREAD,
            lambda each: fit_with(each, force),
            NOMINAL_WARMTH_TIME_CONSTANT,
        )
        self.warmth_time, self.warmth_force = time, force
        for _ in range(REFINEMENTS if self.warm_presses else 0):
            self._refine_warmth(self.fit_all(before, with_slopes=True))

    def _refine_warmth(self, found: ResponseFit) -> None:
        """Correct time constant and force of the temperature rise by the slopes of a fit."""
        changes = found.common[SLOW_SOURCES:] / found.common[POLES]
        time, force = np.exp(np.clip(changes, -LARGEST_STEP, LARGEST_STEP)).tolist()
        self.warmth_time *= time
        self.warmth_force *= force

    def fit_all(
        self,
        before: ResponseFit,
        with_crosstalk: bool = False,
        covers: Sequence[int] = (),
        with_slopes: bool = False,
    ) -> ResponseFit:
        """Fit presses and long hold jointly, common mode and bending subtracted.

        On demand with the neighbours' signals, or with what the others of these covers would change in place of the
        first one.

        Parameters
        ----------
        before : ResponseFit
            The fit so far.
        with_crosstalk : bool, default False
            Whether the neighbours' signals are the last source.
        covers : sequence of int, default ()
            Numbers of covers; the common parameters after those of the film are what is added to the shares of all but
            the first one.
        with_slopes : bool, default False
            Whether the common parameters after those of the film are what is added to the logarithms of the time
            constant and of the force of the temperature rise, times it.

        Returns
        -------
        ResponseFit
            The fit.
        """
        bench = self.bench
        near_signal = bench.near_signal if with_crosstalk else None
        start = dict(before.taxels)
        segments: list[Segment] = []
        for taxel in self.alive:
            response = before.taxels[taxel]
            intervals = bench.intervals(taxel, with_hold=True)
            common_sources = self._common_sources(taxel, self.shares[taxel] / response.gain)
            if covers and common_sources is not None:
                most, *others = (bench.parts[index, :, taxel] for index in covers)
                common_sources = np.column_stack([common_sources, *(each - most for each in others)])
            if with_slopes and common_sources is not None:
                slopes = self._slopes(taxel, self.shares[taxel] / response.gain)
                common_sources = np.column_stack([common_sources, slopes])
            bending = self._charge_of_bending(taxel, response.gain)
            for begin, end in intervals:
                time = bench.time[begin:end]
                both = np.stack([self.common, bending], axis=1)[begin:end]
                common, bent = high_pass(time, both, 1.0 / response.rate).T
                signal = bench.signal[begin:end, taxel] - self.shares[taxel] * common - bent
                part = bench.segment(taxel, begin, end, signal, common=common_sources)
                if near_signal is not None:
                    near = near_signal[begin:end, taxel] - len(bench.neighbours[taxel]) * common
                    part = replace(part, sources=np.column_stack([part.sources, near]), leaking=SOURCES)
                segments.append(part)
            zeros = np.zeros(len(intervals))
            coefficients = np.append(response.coefficients[:SOURCES], np.zeros(1 if with_crosstalk else 0))
            start[taxel] = TaxelResponse(response.rate, coefficients, zeros, zeros)
        self.segments = segments
        prior = np.array([*(SIZE_PRIOR,) * POLES, WARMTH_PRIOR, *(COVER_PRIOR,) * max(len(covers) - 1, 0)])
        if with_slopes:
            warmth = max(abs(float(before.common[POLES])), WARMTH_LEAST_DIFFERENCE)
            prior = np.array([*prior, warmth * WARMTH_TIME_SPREAD, warmth * WARMTH_FORCE_SPREAD])
        return fit_responses(
            segments,
            bench.noise,
            start,
            1.0 / bench.sensor.device.leak_time_constant,
            prior if bench.hold is not None else None,
            np.append(np.full(SLOW_SOURCES, -np.inf), -bench.cover[list(covers[1:])]) if covers else None,
        )

    def charge(self, taxel: int, fitted: ResponseFit) -> Array:
        """Return the charge of a taxel [N]: of its force with hysteresis, slow charge, and that of bending.

        Parameters
        ----------
        taxel : int
            Number of the taxel.
        fitted : ResponseFit
            The fit so far.

        Returns
        -------
        ndarray
            Shape [scans].
        """
        found = fitted.taxels[taxel]
        at_once: Array = (
            found.gain * self.bench.force[:, taxel] + found.coefficients[1:SOURCES] @ self.bench.loops[:, :, taxel]
        )
        return at_once + self._slow_charge(taxel, found.gain, fitted) + self._charge_of_bending(taxel, found.gain)

    def _charge_of_bending(self, taxel: int, gain: float) -> Array:
        charge: Array = gain * (self.bench.bending_sources.of_bending(taxel, self.profile[taxel]) @ self.bending)
        return charge

    def _slow_charge(self, taxel: int, gain: float, fitted: ResponseFit) -> Array:
        """Return the charge of a taxel that came in slowly, by relaxation and by the touch's temperature [N]."""
        sources = self._common_sources(taxel, self.shares[taxel] / gain)
        if sources is None or not len(fitted.common):
            return np.zeros(len(self.bench.time))
        slow: Array = gain * (sources @ fitted.common)
        return slow

    def _common_sources(self, taxel: int, share: float) -> Array | None:
        """Return the sources of relaxation and of the temperature rise of a touched taxel, None without a long hold."""
        bench = self.bench
        if bench.hold is None:
            return None
        force = bench.force[:, taxel]
        columns = [low_pass(bench.time, force, pole) for pole in self.poles]
        return np.stack([*columns, self._warmth_source(taxel, share)], axis=1)

    def _warmth_source(self, taxel: int, share: float, time: float = 1.0, force: float = 1.0) -> Array:
        """Return the source of the temperature rise of a touched taxel, with that many times its time and force."""
        pressed = np.maximum(self.bench.force[:, taxel], 0.0) / (force * self.warmth_force)
        touched = -np.expm1(-(pressed**self.warmth_steepness))
        source: Array = self.newton_per_kelvin * share * low_pass(self.bench.time, touched, time * self.warmth_time)
        return source

    def _slopes(self, taxel: int, share: float) -> Array:
        """Return how the signal per gain changes with the logarithms of that time and force."""
        more, less = math.exp(0.5 * SLOPE_STEP), math.exp(-0.5 * SLOPE_STEP)
        by_time = self._warmth_source(taxel, share, time=more) - self._warmth_source(taxel, share, time=less)
        by_force = self._warmth_source(taxel, share, force=more) - self._warmth_source(taxel, share, force=less)
        return np.stack([by_time, by_force], axis=1) / SLOPE_STEP

    def _changing(self, used: Mask) -> Mask:
        """Return the rest in which the temperature changes most; all that is used if it never changes enough."""
        rest = used & self.bench.untouched.all(axis=1)
        ranges = {run: float(np.ptp(self.bench.block_temperature[slice(*run)])) for run in runs(rest)}
        begin, end = max(ranges, key=ranges.__getitem__, default=(0, 0))
        if ranges.get((begin, end), 0.0) < MIN_TEMPERATURE_RANGE:
            return used
        number = np.arange(len(used))
        changing: Mask = (number >= begin) & (number < end)
        return changing

    def _likeliest(
        self,
        values: Sequence[float],
        nominal: float,
        spread: float,
        fit_with: Callable[[float], ResponseFit],
        near: float,
    ) -> float:
        """Return the value with which a fit is the likeliest, downhill from that near another one."""
        penalties = [(math.log(value / nominal) / spread) ** 2 for value in values]
        fits: dict[int, ResponseFit] = {}
        middle, least = -1, min(range(len(values)), key=lambda index: abs(math.log(values[index] / near)))
        least = min(max(least, 1), len(values) - 2)
        while middle != least and 0 < least < len(values) - 1:
            middle = least
            around = range(middle - 1, middle + 2)
            for index in around:
                fits[index] = fits.get(index) or fit_with(values[index])
            improbable = self._improbable([fits[index] for index in around])
            unlikely = [each + penalties[index] for each, index in zip(improbable, around, strict=True)]
            least = around[int(np.argmin(unlikely))]
        return least_of_parabola([values[index] for index in around], unlikely)

    def _improbable(self, fits: Sequence[ResponseFit]) -> list[float]:
        """Return the sum of squares that each of some fits leaves, over what is left by the best of them."""
        # What is left where all else fits is no noise on a real film: it says less than its number of blocks.
        variances = min((each.variances(self.bench.noise) for each in fits), key=lambda each: sum(each.values()))
        return [each.square_sum(variances) for each in fits]


def relaxation_poles(leak_time_constant: float) -> tuple[float, ...]:
    """Return the time constants of the relaxation poles of an array, a decade apart, ascending [s].

    Parameters
    ----------
    leak_time_constant : float
        Nominal time constant of the leakage [s].
    """
    slowest = math.log10(leak_time_constant) - LEAK_IN_DECADE
    slowest += math.ceil(math.log10(SLOWEST_POLE) - slowest)
    return tuple(10.0 ** (slowest - index) for index in reversed(range(POLES)))
