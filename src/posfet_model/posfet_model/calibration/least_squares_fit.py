# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Least-squares calibration of every taxel from a recording with known forces, in steps that do not mix up the causes.

1. *Presses alone.* Gain, hysteresis, leakage and offset of each taxel are fitted while and shortly after it is pressed
   (`response_fit`), without the chip's temperature: a drift of the film over a second is an offset there. A first fit
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

The film's hysteresis leaves residual charge when a force has gone, which a fit without it would attribute to leakage,
drift, slow poles or temperature. So the distances F - P of the force from play operators P of several half widths r
(the elementary hysteresis loop: P is dragged along, never further than r from F) are sources, too: the signal contains
``g*F + sum(w*(F - P - s*F))``. From end to end of a loop between 0 and F that was passed before, F - P changes by 2*r,
or by F if that is less: with the slope ``min(1, 2*r/F)``. That of typical forces (`TYPICAL_FORCE`) is s, so that g is
their gain. Other forces have another, which the deviation of the gains contains (`ATYPICAL`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.bending_fit import SLOW, BendingFit, BendingSources, UntouchedTaxel, fit_bending
from posfet_model.calibration.fit_checks import check_bending, check_ranges, check_responses, check_temperature
from posfet_model.calibration.leaky_response import block_means, high_pass, low_pass, play_distance
from posfet_model.calibration.response_fit import (
    WARMTH_FORCE_SPREAD,
    WARMTH_FORCES,
    WARMTH_TIME_CONSTANTS,
    WARMTH_TIME_SPREAD,
    ResponseFit,
    Segment,
    TaxelResponse,
    block_size,
    fit_responses,
    least_of_parabola,
)
from posfet_model.calibration.stuck_bits import find_stuck_bits
from posfet_model.calibration.taxel_calibration import (
    CALIBRATED_COMMON_GAIN_DEVIATION,
    CALIBRATED_COMMON_LEAK_DEVIATION,
    NOMINAL_WARMTH_DEVIATION,
    NOMINAL_WARMTH_FORCE,
    NOMINAL_WARMTH_TIME_CONSTANT,
    Calibration,
    Residuals,
)
from posfet_model.calibration.temperature_fit import TemperatureFit, fit_temperature
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import EDGE_NEIGHBOURS, neighbour_lists
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton, force_noise_rms

MIN_FORCE: Final = 0.2
"""Every taxel has to be pressed with at least this force [N]."""

MIN_TEMPERATURE_RANGE: Final = 0.5
"""The temperature has to vary by at least this much for the pyroelectric gain to be fitted [K]."""

DEAD_GAIN: Final = 0.1
"""A taxel with a smaller gain is dead [1]."""

PLAY_HALF_WIDTHS: Final = (0.005, 0.02, 0.08)
"""Half widths r of the play operators that model the film's hysteresis, relative to the maximum force [1], assumed: for
loops of small and of large forces; equally spaced in their logarithm, up to a fifth of a press of the rig."""

SOURCES: Final = 1 + len(PLAY_HALF_WIDTHS)
"""Number of sources of a taxel: force, and its distance from each play operator."""

TYPICAL_FORCE: Final = 0.06
"""The gain is that of presses of this strength, relative to the maximum force [1], assumed: hysteresis attenuates small
changes of force more than large ones, and a fingertip presses a taxel with some tenths of a newton."""

ATYPICAL: Final = 3.0
"""Forces of a third of the typical one and three times as strong are one standard deviation from it [1], assumed."""

HYSTERESIS_DOUBT: Final = 0.03
"""Standard deviation of the size of a relaxation pole, relative to the sum of the weights w of the play operators [1]:
loops of other half widths than these three leave that much, as measured on films with one to five others."""

POLES: Final = (0.1, 1.0, 10.0)
"""Time constants of the relaxation poles [s]: a spread of time constants over three decades is one pole per decade."""

SLOW_SOURCES: Final = len(POLES) + 1
"""Number of the common sources that come in slowly: relaxation, and the temperature rise of a touched taxel."""

LONG_HOLD: Final = 20.0
"""A force on a taxel for at least this long is a long hold [s]: twice the slowest pole."""

HOLD_TAIL: Final = 20.0
"""Time after the release of a long hold that is fitted [s]."""

NO_FORCE: Final = 5e-3
"""A smaller force on a taxel counts as none [N]: a rig has a millinewton of noise."""

TAIL: Final = 6.0
"""A taxel is fitted until this many nominal leakage time constants after a force: exp(-6) = 0.2 % is left [1]."""

LEAD: Final = 0.3
"""A taxel is fitted from this long before a force on [s]."""

ROUNDS: Final = 2
"""Rounds of steps 2 to 4: the first knows no slow poles, which leave charge on taxels that are no longer touched."""

SIZE_PRIOR: Final = 0.1
"""Prior standard deviation of the size of a relaxation pole [1], assumed; for sizes that are not observable."""

WARMTH_PRIOR: Final = 0.3
"""Prior standard deviation of the temperature rise of a touched taxel [K], assumed: that of a thin chip."""

COVER_SPREADS: Final = (0.5, 0.75, 1.25, 1.6, 2.4)
"""Spreads of covers, relative to that of the sensor file [1]: the cover of a board is a mixture of these with it."""

COVER_PRIOR: Final = 0.5
"""Prior standard deviation of the share that each of these has [1], assumed."""

COVER_ROUNDS: Final = 4
"""Rounds in which cover and bending are found."""

COVER_LEAVES: Final = 0.75
"""A cover is taken if it leaves no more than this share of the squares that crosstalk under the sensor file's cover
leaves [1], assumed: layer and half space leave up to 0.13, and crosstalk that a cover explains 1.7 or more."""

LEAST_SHARE: Final = 0.03
"""A cover with less is left out [1]: as much is found where there is none, with all effects of a real film."""

MIN_UNTOUCHED: Final = 3
"""Fewest untouched taxels from which the common-mode signal is known."""

MAX_WARMTH_DEVIATION: Final = 0.01
"""The temperature rise of touched taxels counts as measured with a smaller standard deviation [K]."""

LEAST_SENSOR_LAG: Final = 2e-3
"""Time constant of the lag of temperature sensors that are faster than the film [s], assumed."""

MAX_CROSSTALK: Final = 0.2
"""Largest share of a neighbour's signal that is compensated [1]."""

RESOLUTION: Final = 4e-3
"""Scans are averaged over this time before the fit [s]: a press rises within a tenth of a second."""

WARMTH_DOUBT: Final = (3e-3, 0.25)
"""Standard deviation of the temperature rise from touch to touch: absolute [K], and relative to it [1]; assumed."""

FOLDS: Final = 5
"""One stretch in this many belongs to the hold-out set."""

STRETCH: Final = 0.25
"""Length of a stretch [s]."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Scans with the forces applied; the first scan is taken at rest."""

    time: Array
    """[s], shape [scans], ascending."""
    counts: NDArray[np.uint16]
    """ADC counts, shape [scans, rows * cols]."""
    temperature: Array
    """Mean of the chip's temperature sensors [degC], shape [scans]."""
    force: Array
    """Force on each taxel [N], shape [scans, rows * cols]."""
    force_under: Callable[[float, Array], Array] | None = None
    """Force on each taxel [N] under a cover that spreads so many times as far as that of the sensor file, at times [s],
    shape [times, rows * cols]; None: the force on each taxel is known whatever the cover."""


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
    data = _Data(sensor, recording)
    nominal_rate = 1.0 / sensor.device.leak_time_constant
    total = np.broadcast_to(data.force.sum(axis=1, keepdims=True), data.force.shape)
    first = fit_responses(
        data.press_segments(total, data.near_signal), data.noise, data.start(SOURCES + 2), nominal_rate
    )
    data.compensate(_crosstalk(first))
    presses = fit_responses(data.press_segments(), data.noise, data.start(SOURCES), nominal_rate)
    dead = find_stuck_bits(recording.counts)
    dead |= np.array([presses.taxels[taxel].gain < DEAD_GAIN for taxel in range(data.taxels)])
    if dead.all():
        raise ValueError("no taxel responds to the force: nothing to calibrate")
    check_ranges(sensor, presses, dead)
    found = presses
    data.offsets = np.array([np.median(presses.taxels[taxel].offsets) for taxel in range(data.taxels)])
    for index in range(ROUNDS):
        bending = data.find_bending(found, dead)
        data.find_common_mode(found, dead)
        thermal = data.fit_temperature()
        shares = data.film_shares(found, dead)
        last = index == ROUNDS - 1
        data.fit_warmth(found, shares, dead)
        found = data.fit_all(found, shares, dead, with_crosstalk=not last)
        if not last:
            data.compensate(data.crosstalk + _crosstalk(found))
            found = data.find_cover(found, shares, dead)
    data.find_common_mode(found, dead)
    if thermal is not None:
        check_temperature(thermal, data.block_temperature)
    check_ranges(sensor, found, dead)
    check_bending(bending)
    check_responses(data.segments, found, data.noise, data.hold)
    return _calibration(sensor, data, found, bending, thermal, shares, dead, date)


@dataclass(frozen=True, eq=False)
class _Shares:
    """Response of each taxel to the common-mode signal."""

    share: Array
    """Signal per common-mode signal [1], shape [taxels]."""
    offset: Array
    """Offset of the signal [N], shape [taxels]."""


class _Data:
    """The recording as signals, and the segments of it that each step fits."""

    def __init__(self, sensor: Sensor, recording: Recording) -> None:
        self.sensor, self.taxels = sensor, sensor.layout.taxels
        inverse = InverseSignalChain(sensor)
        signal = inverse.charge(recording.counts, np.empty(recording.counts.shape)) / charge_per_newton(sensor)
        # Means over a fixed time obey the same linear equations.
        self.thinning = max(1, int(RESOLUTION / float(np.median(np.diff(recording.time))) + 1e-6))
        self.time, self.signal, self.force, self.temperature = (
            block_means(values, self.thinning)
            for values in (recording.time - recording.time[0], signal, recording.force, recording.temperature)
        )
        self._raw, self.crosstalk = self.signal, 0.0
        self._neighbours = [list(each) for each in neighbour_lists(sensor.layout, EDGE_NEIGHBOURS)]
        self.size = block_size(self.time)
        tau = sensor.device.leak_time_constant
        self.film_lag = sensor.device.thermal_time_constant
        self.hold = _long_hold(self.time, self.force)
        parts = [self.force]
        if recording.force_under is not None and self.hold is not None:
            at = self.time + recording.time[0]
            parts += [recording.force_under(ratio, at) for ratio in COVER_SPREADS]
        self._parts = np.stack(parts, dtype=np.float32, casting="same_kind")  # six times the forces
        self._follow_force()
        self.noise = self._noise()
        self.common = np.zeros(len(self.time))
        """Common-mode signal of the untouched taxels, leakage compensated [N], shape [scans]."""
        self.warmth_time = NOMINAL_WARMTH_TIME_CONSTANT
        """Time constant of the temperature rise of touched taxels [s]."""
        self.warmth_force = NOMINAL_WARMTH_FORCE
        """Force at which they have 1 - 1/e of it [N]."""
        self.newton_per_kelvin = sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)
        self.shares = np.ones(self.taxels)
        """Signal of each taxel per common-mode signal [1], of the last fit."""
        self.offsets = np.zeros(self.taxels)
        """Offset of each taxel [N], of the last fit."""
        self.segments: list[Segment] = []
        """Segments of the last fit."""
        self.time_constant = tau
        """Median time constant of the leakage [s], of the last fit."""
        self.bending = np.zeros(4)
        """Bending of the chip [1], of the last fit."""
        self.cover = np.eye(len(self._parts))[0]
        """Shares of the sensor file's cover and of those of `COVER_SPREADS` in that of the board [1]."""

    def _follow_force(self) -> None:
        """Find what follows from the forces on the taxels."""
        self.loops = _hysteresis_sources(self.sensor, self.force)
        touched, tail = self.force > NO_FORCE, TAIL * self.sensor.device.leak_time_constant
        self.near_force = np.stack(
            [_dilated(self.time, touched[:, taxel], LEAD, tail) for taxel in range(self.taxels)], axis=1
        )
        if self.hold is not None:
            held = touched[(self.time >= self.hold[0]) & (self.time <= self.hold[1])].any(axis=0)
            self.near_force |= self._during_hold(self.time)[:, None] & held
        self._bending_sources = BendingSources(self.sensor.layout, self.time, self.force, self.film_lag)

    def find_cover(self, found: ResponseFit, shares: _Shares, dead: Mask) -> ResponseFit:
        """Find how the cover spreads the forces, jointly with what a fit without it has found; return the last fit.

        Crosstalk and a cover that spreads more than the sensor file says look alike: only one of them is taken, the
        cover if it leaves clearly less. Bending looks like the tail of a cover, so each follows the other. What has
        hardly a share is left out.
        """
        if len(self.cover) == 1:
            return found
        without, crosstalk = self.fit_all(found, shares, dead), self.crosstalk
        self.compensate(0.0)
        kept = weak = list(range(len(self.cover)))
        while weak and len(kept) > 1:
            for _ in range(COVER_ROUNDS):
                most = int(np.argmax(self.cover))
                others = [index for index in kept if index != most]
                fitted = self.fit_all(found, shares, dead, covers=(most, *others))
                found, change = fitted.without_common(SLOW_SOURCES), fitted.common[SLOW_SOURCES:]
                cover = self.cover.copy()
                cover[others] += change
                cover[most] -= change.sum()
                self._spread(cover)
                self.find_bending(found, dead)
                self.find_common_mode(found, dead)
                if np.abs(change).max() < 0.1 * LEAST_SHARE:
                    break
            weak = [index for index in kept if self.cover[index] < LEAST_SHARE]
            kept = [index for index in kept if index not in weak]
            if weak:
                self._spread(np.where(self.cover < LEAST_SHARE, 0.0, self.cover))
        if kept != [0]:
            found, equal = self.fit_all(found, shares, dead), dict.fromkeys(without.taxels, 1.0)
            if found.square_sum(equal) < COVER_LEAVES * without.square_sum(equal):
                return found
        self._spread(np.eye(len(self.cover))[0])
        self.compensate(crosstalk)
        return without

    def _spread(self, cover: Array) -> None:
        """Spread the forces as a cover does in which the parts have these shares, up to a factor."""
        self.cover = np.maximum(cover, 0.0) / np.maximum(cover, 0.0).sum()
        self.force = np.einsum("i,ijk->jk", self.cover, self._parts)
        self._follow_force()

    def _during_hold(self, time: Array) -> Mask:
        """Return which times [s] are in the long hold or in its tail."""
        if self.hold is None:
            return np.zeros(len(time), np.bool_)
        during: Mask = (time >= self.hold[0] - LEAD) & (time <= self.hold[1] + HOLD_TAIL)
        return during

    def _noise(self) -> Array:
        """Return the standard deviation of a block mean of each taxel [N], from differences of blocks without force."""
        least = force_noise_rms(self.sensor) / np.sqrt(self.size)
        quiet = block_means(self.near_force.astype(np.float64), self.size) == 0.0
        means = block_means(self.signal, self.size)
        noise = np.full(self.taxels, least)
        for taxel in range(self.taxels):
            steps = np.abs(np.diff(means[:, taxel]))[quiet[1:, taxel] & quiet[:-1, taxel]]
            if len(steps):
                # The median of |a - b| of two normal values is 0.954 standard deviations.
                noise[taxel] = max(least, float(np.median(steps)) / 0.954)
        return noise

    def start(self, sources: int) -> dict[int, TaxelResponse]:
        """Return the nominal parameters, with which a fit starts."""
        rate = 1.0 / self.sensor.device.leak_time_constant
        coefficients = np.zeros(sources)
        coefficients[0] = 1.0
        return {
            taxel: TaxelResponse(rate, coefficients, np.zeros(count), np.zeros(count))
            for taxel in range(self.taxels)
            if (count := len(self._intervals(taxel, with_hold=False)))
        }

    def _intervals(self, taxel: int, with_hold: bool) -> list[tuple[int, int]]:
        """Return the scans (first, last + 1) of each segment of a taxel."""
        mask = self.near_force[:, taxel]
        if not with_hold:
            mask = mask & ~self._during_hold(self.time)
        return [(begin, end) for begin, end in _runs(mask) if end - begin >= 10 * self.size]

    def press_segments(self, *further: Array) -> list[Segment]:
        """Return the presses, with further sources [N] of shape [scans, taxels]: one that leaks, then signals."""
        return [
            self._segment(taxel, begin, end, self.signal[begin:end, taxel], further)
            for taxel in range(self.taxels)
            for begin, end in self._intervals(taxel, with_hold=False)
        ]

    def _segment(
        self,
        taxel: int,
        begin: int,
        end: int,
        signal: Array,
        further: Sequence[Array] = (),
        common: Array | None = None,
    ) -> Segment:
        scans = slice(begin, end)
        sources = [self.force[scans, taxel], *self.loops[:, scans, taxel]]
        sources += [each[scans, taxel] for each in further]
        time = self.time[scans]
        return Segment(
            taxel=taxel,
            time=time,
            signal=signal,
            sources=np.stack(sources, axis=1),
            common_sources=np.zeros((end - begin, 0)) if common is None else common[scans],
            leaking=SOURCES + 1 if further else None,
            fitted=_fitted(block_means(time, self.size)),
        )

    @property
    def near_signal(self) -> Array:
        """Sum of the signals of the four neighbours of each taxel [N], shape [scans, taxels]."""
        return np.stack([self.signal[:, near].sum(axis=1) for near in self._neighbours], axis=1)

    def compensate(self, crosstalk: float) -> None:
        """Compensate the signals for crosstalk."""
        self.crosstalk = min(max(crosstalk, 0.0), MAX_CROSSTALK)
        compensator = CrosstalkCompensator(self.sensor.layout, self.crosstalk)
        matrix = np.stack([compensator.apply(row).copy() for row in np.eye(self.taxels)])
        self.signal = self._raw @ matrix

    def find_common_mode(self, fitted: ResponseFit, dead: Mask) -> None:
        """Find what the untouched taxels have in common, as the mean of their changes with leakage compensated.

        Bending, weak forces, and what an earlier touch still brings in by the slow poles, are subtracted.
        """
        self.time_constant = float(np.median([1.0 / each.rate for each in fitted.taxels.values()]))
        usable = ~self.near_force & ~dead
        enough = usable.sum(axis=1) >= MIN_UNTOUCHED
        step = np.diff(self.time)
        changes, weights = np.zeros(len(step)), np.zeros(len(step))
        for taxel in np.flatnonzero(~dead):
            found = fitted.taxels[int(taxel)]
            signal = self.signal[:, taxel] - self.offsets[taxel]
            change = np.diff(signal) + 0.5 * (signal[1:] + signal[:-1]) * step * found.rate
            change -= np.diff(self.charge(int(taxel), fitted))
            used = (usable[1:, taxel] & usable[:-1, taxel]) * 1.0
            changes += used * change
            weights += used
        changes = np.where(enough[1:], changes / np.maximum(weights, 1.0), 0.0)
        self.common = np.concatenate([[0.0], np.cumsum(changes)])

    def find_bending(self, fitted: ResponseFit, dead: Mask) -> BendingFit:
        """Find the bending of the chip from what untouched taxels show."""
        untouched = block_means(self.near_force.astype(np.float64), self.size) == 0.0
        pressed = block_means(self.force.sum(axis=1), self.size) > NO_FORCE
        taxels = []
        for taxel in np.flatnonzero(~dead).tolist():
            found = fitted.taxels[taxel]
            charge = _compensated(self.time, self.signal[:, taxel] - self.offsets[taxel], 1.0 / found.rate)
            charge = (charge - self._slow_charge(taxel, found.gain, fitted)) / found.gain - self.force[:, taxel]
            near = self.force[:, self._neighbours[taxel]].sum(axis=1)
            per_kelvin = self.newton_per_kelvin * self.shares[taxel] / found.gain
            taxels.append(
                UntouchedTaxel(
                    charge=block_means(charge, self.size),
                    sources=block_means(self._bending_sources.of_all(taxel, per_kelvin, near), self.size),
                    used=untouched[:, taxel] & pressed,
                    noise=self.noise[taxel] / found.gain,
                )
            )
        bending = fit_bending(taxels)
        self.bending = bending.sizes
        return bending

    @property
    def pressed_temperature(self) -> float:
        """Mean temperature of the chip's sensors while a force is applied [degC]."""
        return float(self.temperature[self.near_force.any(axis=1)].mean())

    @property
    def block_temperature(self) -> Array:
        """Temperature of the chip's sensors relative to the start [K], shape [blocks]."""
        return block_means(self.temperature - self.temperature[0], self.size)

    def charge(self, taxel: int, fitted: ResponseFit) -> Array:
        """Return the charge of a taxel [N]: of its force with hysteresis, slow charge, and that of bending."""
        found = fitted.taxels[taxel]
        at_once: Array = found.gain * self.force[:, taxel] + found.coefficients[1:SOURCES] @ self.loops[:, :, taxel]
        return at_once + self._slow_charge(taxel, found.gain, fitted) + self._charge_of_bending(taxel, found.gain)

    def _charge_of_bending(self, taxel: int, gain: float) -> Array:
        charge: Array = gain * (self._bending_sources.of_bending(taxel) @ self.bending)
        return charge

    def _slow_charge(self, taxel: int, gain: float, fitted: ResponseFit) -> Array:
        """Return the charge of a taxel that came in slowly, by relaxation and by the touch's temperature [N]."""
        sources = self._common_sources(taxel, self.shares[taxel] / gain)
        if sources is None or not len(fitted.common):
            return np.zeros(len(self.time))
        slow: Array = gain * (sources @ fitted.common)
        return slow

    def fit_temperature(self) -> TemperatureFit | None:
        """Fit lag and pyroelectric gain, None if the temperature varies too little; the common mode loses its drift."""
        time, common = block_means(self.time, self.size), block_means(self.common, self.size)
        used = ~self._during_hold(time)
        if np.ptp(self.block_temperature[used]) < MIN_TEMPERATURE_RANGE:
            used[:] = True
        if np.ptp(self.block_temperature[used]) < MIN_TEMPERATURE_RANGE:
            return None
        thermal = fit_temperature(
            time[used],
            self.block_temperature[used],
            common[used],
            self._changing(used)[used],
            self.film_lag,
            self.pressed_temperature - float(self.temperature[0]),
            self.time_constant,
        )
        self.common = self.common - thermal.drift * self.time
        self.newton_per_kelvin = thermal.newton_per_kelvin
        return thermal

    def _changing(self, used: Mask) -> Mask:
        """Return the rest in which the temperature changes most; all that is used if it never changes enough."""
        rest = used & (block_means(self.near_force.astype(np.float64), self.size) == 0.0).all(axis=1)
        ranges = {run: float(np.ptp(self.block_temperature[slice(*run)])) for run in _runs(rest)}
        begin, end = max(ranges, key=ranges.__getitem__, default=(0, 0))
        if ranges.get((begin, end), 0.0) < MIN_TEMPERATURE_RANGE:
            return used
        number = np.arange(len(used))
        changing: Mask = (number >= begin) & (number < end)
        return changing

    def film_shares(self, fitted: ResponseFit, dead: Mask) -> _Shares:
        """Return how strongly each taxel shows the common-mode signal while it is untouched, and its offset."""
        share, offset = np.ones(self.taxels), np.zeros(self.taxels)
        varies = np.ptp(self.temperature) >= MIN_TEMPERATURE_RANGE
        for taxel in np.flatnonzero(~dead):
            found = fitted.taxels[int(taxel)]
            tau = 1.0 / found.rate
            offset[taxel] = np.median(found.offsets)
            parts = [part for part in _runs(~self.near_force[:, taxel]) if part[1] - part[0] >= 50 * self.size]
            rows, values = [], []
            for index, (begin, end) in enumerate(parts):
                time = self.time[begin:end]
                columns = np.zeros((end - begin, 2 + len(parts)))
                columns[:, 0] = high_pass(time, self.common[begin:end], tau)
                columns[:, 1] = 1.0
                columns[:, 2 + index] = np.exp(-(time - time[0]) / tau)
                rows.append(block_means(columns, self.size))
                known = high_pass(time, self.charge(int(taxel), fitted)[begin:end], tau)
                values.append(block_means(self.signal[begin:end, taxel] - known, self.size))
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
        return _Shares(share, offset)

    def fit_warmth(self, before: ResponseFit, shares: _Shares, dead: Mask) -> None:
        """Find time constant and saturation of the temperature rise of touched taxels, from the nominal ones."""
        if self.hold is None:
            return
        nominal = self.fit_all(before, shares, dead)
        if abs(float(nominal.common[len(POLES)])) < WARMTH_DOUBT[0]:
            return  # no more than the taxels may differ by: what fits best is that of something else

        def fit_with(time: float, force: float) -> ResponseFit:
            self.warmth_time, self.warmth_force = time, force
            return self.fit_all(before, shares, dead)

        force = self._likeliest(
            WARMTH_FORCES,
            NOMINAL_WARMTH_FORCE,
            WARMTH_FORCE_SPREAD,
            lambda each: fit_with(NOMINAL_WARMTH_TIME_CONSTANT, each),
        )
        time = self._likeliest(
            WARMTH_TIME_CONSTANTS,
            NOMINAL_WARMTH_TIME_CONSTANT,
            WARMTH_TIME_SPREAD,
            lambda each: fit_with(each, force),
        )
        self.warmth_time, self.warmth_force = time, force

    def _likeliest(
        self, values: Sequence[float], nominal: float, spread: float, fit_with: Callable[[float], ResponseFit]
    ) -> float:
        """Return the value with which a fit is the likeliest, downhill from the nominal one."""
        doubts = [(math.log(value / nominal) / spread) ** 2 for value in values]
        fits: dict[int, ResponseFit] = {}
        middle, least = -1, int(np.argmin(doubts))
        while middle != least and 0 < least < len(values) - 1:
            middle = least
            near = range(middle - 1, middle + 2)
            for index in near:
                fits[index] = fits.get(index) or fit_with(values[index])
            # What is left where all else fits is no noise on a real film: it says less than its number of blocks.
            variances = min((fits[index].variances(self.noise) for index in near), key=lambda each: sum(each.values()))
            unlikely = [fits[index].square_sum(variances) + doubts[index] for index in near]
            least = near[int(np.argmin(unlikely))]
        return least_of_parabola([values[index] for index in near], unlikely)

    def fit_all(
        self,
        before: ResponseFit,
        shares: _Shares,
        dead: Mask,
        with_crosstalk: bool = False,
        covers: Sequence[int] = (),
    ) -> ResponseFit:
        """Fit presses and long hold jointly, common mode and bending subtracted.

        On demand with the neighbours' signals, or with what the others of these covers would change in place of the
        first one.
        """
        near_signal = self.near_signal if with_crosstalk else None
        start = dict(before.taxels)
        segments: list[Segment] = []
        for taxel in np.flatnonzero(~dead).tolist():
            response = before.taxels[taxel]
            intervals = self._intervals(taxel, with_hold=True)
            common_sources = self._common_sources(taxel, shares.share[taxel] / response.gain)
            if covers and common_sources is not None:
                most, *others = (self._parts[index, :, taxel] for index in covers)
                common_sources = np.column_stack([common_sources, *(each - most for each in others)])
            bending = self._charge_of_bending(taxel, response.gain)
            for begin, end in intervals:
                time = self.time[begin:end]
                both = np.stack([self.common, bending], axis=1)[begin:end]
                common, bent = high_pass(time, both, 1.0 / response.rate).T
                signal = self.signal[begin:end, taxel] - shares.share[taxel] * common - bent
                part = self._segment(taxel, begin, end, signal, common=common_sources)
                if near_signal is not None:
                    near = near_signal[begin:end, taxel] - len(self._neighbours[taxel]) * common
                    part = replace(part, sources=np.column_stack([part.sources, near]), leaking=SOURCES)
                segments.append(part)
            zeros = np.zeros(len(intervals))
            coefficients = np.append(response.coefficients[:SOURCES], np.zeros(1 if with_crosstalk else 0))
            start[taxel] = TaxelResponse(response.rate, coefficients, zeros, zeros)
        self.segments = segments
        prior = np.array([*(SIZE_PRIOR,) * len(POLES), WARMTH_PRIOR, *(COVER_PRIOR,) * max(len(covers) - 1, 0)])
        return fit_responses(
            segments,
            self.noise,
            start,
            1.0 / self.sensor.device.leak_time_constant,
            prior if self.hold is not None else None,
            np.append(np.full(SLOW_SOURCES, -np.inf), -self.cover[list(covers[1:])]) if covers else None,
        )

    def _common_sources(self, taxel: int, share: float) -> Array | None:
        """Return the sources of relaxation and of the temperature rise of a touched taxel, None without a long hold."""
        if self.hold is None:
            return None
        force = self.force[:, taxel]
        columns = [low_pass(self.time, force, pole) for pole in POLES]
        touched = -np.expm1(-np.maximum(force, 0.0) / self.warmth_force)
        columns.append(self.newton_per_kelvin * share * low_pass(self.time, touched, self.warmth_time))
        return np.stack(columns, axis=1)


def _calibration(
    sensor: Sensor,
    data: _Data,
    found: ResponseFit,
    bending: BendingFit,
    thermal: TemperatureFit | None,
    shares: _Shares,
    dead: Mask,
    date: str,
) -> Calibration:
    """Return the calibration that a fit has found."""
    nominal_tau = sensor.device.leak_time_constant
    gain, tau = np.full(data.taxels, np.nan), np.full(data.taxels, nominal_tau)
    gain_deviation, leak_deviation = np.zeros(data.taxels), np.zeros(data.taxels)
    for taxel in np.flatnonzero(~dead).tolist():
        each = found.taxels[taxel]
        gain[taxel] = each.gain
        tau[taxel] = 1.0 / each.rate
        gain_deviation[taxel] = each.deviations[0] / each.gain
        leak_deviation[taxel] = each.deviations[-1] / each.rate
    nominal = sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)
    pyroelectric = np.ones(data.taxels)
    if thermal is not None and nominal:
        pyroelectric = np.where(dead, 1.0, shares.share * thermal.newton_per_kelvin / nominal)
    poles = len(POLES) if data.hold is not None else 0
    weights = np.median([each.coefficients[1:] / each.gain for each in found.taxels.values()], axis=0)
    atypical = _loop_slopes(TYPICAL_FORCE / ATYPICAL) - _loop_slopes(TYPICAL_FORCE * ATYPICAL)
    doubt = HYSTERESIS_DOUBT * np.abs(weights).sum()
    deviations = np.hypot(np.sqrt(np.diag(found.common_covariance)[:poles]), doubt)
    warmth, warmth_deviation = 0.0, NOMINAL_WARMTH_DEVIATION
    deviation = math.sqrt(float(found.common_covariance[poles, poles])) if poles else math.inf
    if deviation < MAX_WARMTH_DEVIATION:
        warmth = float(found.common[poles])
        warmth_deviation = math.hypot(deviation, WARMTH_DOUBT[0] + WARMTH_DOUBT[1] * abs(warmth))
    spreads = np.array((1.0, *COVER_SPREADS) if len(data.cover) > 1 else ()) * sensor.device.contact_spread
    film_lag, sensor_lag = data.film_lag, 0.0
    leak: dict[str, float] = {}
    if thermal is not None:
        leak["leak_per_kelvin"] = thermal.leak_per_kelvin
        leak["leak_per_kelvin_deviation"] = thermal.leak_per_kelvin_deviation
        film_lag = thermal.lag + LEAST_SENSOR_LAG if thermal.lag >= 0.0 else data.film_lag
        sensor_lag = film_lag - thermal.lag
    return Calibration(
        gain=gain,
        pyroelectric_gain=pyroelectric,
        leak_time_constant=tau,
        offset=np.where(dead, 0.0, shares.offset) * sensor.volts_per_newton,
        gain_deviation=gain_deviation,
        leak_deviation=leak_deviation,
        crosstalk=data.crosstalk,
        common_gain_deviation=math.hypot(CALIBRATED_COMMON_GAIN_DEVIATION, 0.5 * float(weights @ atypical)),
        common_leak_deviation=CALIBRATED_COMMON_LEAK_DEVIATION,
        thermal_time_constant=film_lag,
        date=date,
        residuals=_residuals(sensor, data, found, shares, dead),
        relaxation_time_constants=np.array(POLES[:poles]),
        relaxation_sizes=found.common[:poles],
        relaxation_deviations=deviations,
        hysteresis_half_widths=np.array(PLAY_HALF_WIDTHS) * sensor.device.force_max,
        hysteresis_weights=weights,
        hysteresis_slope=float(weights @ _loop_slopes(TYPICAL_FORCE)),
        warmth=warmth,
        warmth_deviation=warmth_deviation,
        warmth_time_constant=data.warmth_time,
        warmth_force=data.warmth_force,
        bending=bending.sizes,
        bending_deviation=bending.deviations,
        cover_spreads=spreads,
        cover_shares=data.cover[: len(spreads)],
        chip_warming_time_constants=np.array(SLOW),
        chip_warming=bending.warming,
        temperature_sensor_lag=sensor_lag,
        temperature=data.pressed_temperature,
        **leak,
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


def _long_hold(time: Array, force: Array) -> tuple[float, float] | None:
    """Return begin and end [s] of the longest time for which one taxel is held with `MIN_FORCE`, None if too short."""
    best: tuple[float, float] | None = None
    for taxel in range(force.shape[1]):
        for begin, end in _runs(force[:, taxel] >= MIN_FORCE):
            span = float(time[begin]), float(time[end - 1])
            if span[1] - span[0] >= LONG_HOLD and (best is None or span[1] - span[0] > best[1] - best[0]):
                best = span
    return best


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """Return where each run of true begins, and where it has ended."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _dilated(time: Array, mask: Mask, before: float, after: float) -> Mask:
    """Return the mask with each run extended by times [s] before and after it."""
    wide = np.zeros_like(mask)
    for begin, end in _runs(mask):
        first, last = np.searchsorted(time, (time[begin] - before, time[end - 1] + after))
        wide[first:last] = True
    return wide


def _fitted(time: Array) -> Mask:
    """Return which blocks are fitted; the others are the hold-out set."""
    mask: Mask = (time / STRETCH).astype(np.intp) % FOLDS != FOLDS - 1
    return mask


def _loop_slopes(force: float) -> Array:
    """Return the slope of F - P from end to end of loops of a force relative to the maximum [1], shape [operators]."""
    return np.minimum(1.0, 2.0 * np.array(PLAY_HALF_WIDTHS) / force)


def _hysteresis_sources(sensor: Sensor, force: Array) -> Array:
    """Return what hysteresis adds to forces [N] per weight, shape [operators, scans, taxels]."""
    distances = [play_distance(force, width * sensor.device.force_max) for width in PLAY_HALF_WIDTHS]
    return np.stack(distances) - _loop_slopes(TYPICAL_FORCE)[:, None, None] * force


def _crosstalk(found: ResponseFit) -> float:
    """Return the share of each neighbour's signal that a taxel picks up: the median over the taxels."""
    shares = [float(each.coefficients[-1]) for each in found.taxels.values() if each.gain >= DEAD_GAIN]
    return float(np.median(shares)) if shares else 0.0


def _residuals(sensor: Sensor, data: _Data, found: ResponseFit, shares: _Shares, dead: Mask) -> Residuals:
    """Return the prediction error on the hold-out set as forces, with the fit and with nominal parameters.

    Forces with the leakage compensated from the first scan on, 20 ms means; the film's temperature is that of the
    untouched taxels. Start and offset, of which the latter is a slope here, are those of the training set in both: an
    uncalibrated model learns its baselines, too.
    """

    def error(compensated: Array) -> Array:
        fitted = block_means(compensated, data.size)
        line = np.polynomial.Polynomial.fit(time[~held_out], fitted[~held_out], 1)
        difference: Array = (fitted - line(time))[held_out]
        return difference

    time = block_means(data.time, data.size)
    held_out = ~_fitted(time)
    nominal_tau = sensor.device.leak_time_constant
    after, before, samples = np.zeros(held_out.sum()), np.zeros(held_out.sum()), 0
    for taxel in np.flatnonzero(~dead).tolist():
        each = found.taxels[taxel]
        force, signal = data.force[:, taxel], data.signal[:, taxel]
        source = data.charge(taxel, found) + shares.share[taxel] * data.common
        fitted = error(_compensated(data.time, signal, 1.0 / each.rate) - source) / each.gain
        nominal = error(_compensated(data.time, signal, nominal_tau) - force - data.common)
        after, before = after + fitted**2, before + nominal**2
        samples += len(fitted)
    alive = max(int((~dead).sum()), 1)
    stretch = (time[held_out] / STRETCH).astype(np.intp)
    starts, index, counts = np.unique(stretch, return_inverse=True, return_counts=True)
    over_time = [np.sqrt(np.bincount(index, weights=each) / counts / alive) for each in (after, before)]
    return Residuals(
        force_rms=float(np.sqrt(after.sum() / max(samples, 1))),
        force_rms_before=float(np.sqrt(before.sum() / max(samples, 1))),
        samples=samples * data.size * data.thinning,
        time=starts.astype(np.float64) * STRETCH,
        force_rms_over_time=over_time[0],
        force_rms_before_over_time=over_time[1],
    )


def _compensated(time: Array, signal: Array, time_constant: float) -> Array:
    """Return the signal with the leakage compensated since the first scan [N], shape [scans]."""
    lost = 0.5 * (signal[1:] + signal[:-1]) * np.diff(time) / time_constant
    compensated: Array = signal + np.concatenate([[0.0], np.cumsum(lost)])
    return compensated
