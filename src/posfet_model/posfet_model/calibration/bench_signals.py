# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Signals and forces of a bench recording: what was measured, what pressed, and which scans of it each taxel fits.

The film's hysteresis leaves residual charge when a force has gone, which a fit without it would attribute to leakage,
drift, slow poles or temperature. So the distances F - P of the force from play operators P of several half widths r
(the elementary hysteresis loop: P is dragged along, never further than r from F) are sources, too: the signal contains
``g*F + sum(w*(F - P - s*F))``. From end to end of a loop between 0 and F that was passed before, F - P changes by 2*r,
or by F if that is less: with the slope ``min(1, 2*r/F)``. That of typical forces (`TYPICAL_FORCE`) is s, so that g is
their gain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.bending_fit import BendingSources
from posfet_model.calibration.leaky_response import block_means, play_distance
from posfet_model.calibration.response_fit import Segment, TaxelResponse, block_size
from posfet_model.calibration.taxel_calibration import COVER_SPREADS, PLAY_HALF_WIDTHS
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import EDGE_NEIGHBOURS, neighbour_lists
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton, force_noise_rms

MIN_FORCE: Final = 0.2
"""Every taxel has to be pressed with at least this force [N]."""

SOURCES: Final = 1 + len(PLAY_HALF_WIDTHS)
"""Number of sources of a taxel: force, and its distance from each play operator."""

TYPICAL_FORCE: Final = 0.06
"""The gain is that of presses of this strength, relative to the maximum force [1], assumed: hysteresis attenuates small
changes of force more than large ones, and a fingertip presses a taxel with some tenths of a newton."""

LONG_HOLD: Final = 20.0
"""A force on a taxel for at least this long is a long hold [s]: twice the slowest pole of the shipped sensor."""

HOLD_TAIL: Final = 20.0
"""Time after the release of a long hold that is fitted [s]."""

NO_FORCE: Final = 5e-3
"""A smaller force on a taxel counts as none [N]: a rig has a millinewton of noise."""

TAIL: Final = 6.0
"""A taxel is fitted until this many nominal leakage time constants after a force: exp(-6) = 0.2 % is left [1]."""

LEAD: Final = 0.3
"""A taxel is fitted from this long before a force on [s]."""

MAX_CROSSTALK: Final = 0.2
"""Largest share of a neighbour's signal that is compensated [1]."""

RESOLUTION: Final = 4e-3
"""Scans are averaged over this time before the fit [s]: a press rises within a tenth of a second."""

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
    applied: Array | None = None
    """Force of all that presses, also beside the array [N], shape [scans]; None: that on the taxels."""
    force_under: Callable[[float, Array], Array] | None = None
    """Force on each taxel [N] under a cover that spreads so many times as far as that of the sensor file, at times [s],
    shape [times, rows * cols]; None: the force on each taxel is known whatever the cover."""


class BenchSignals:
    """The recording as signals and forces, and the segments of it that a fit takes.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.
    recording : Recording
        Scans and forces.

    Attributes
    ----------
    sensor : Sensor
        The sensor file.
    taxels : int
        Number of taxels.
    thinning : int
        Number of scans that are averaged before the fit.
    size : int
        Number of these averages in a block.
    time : ndarray
        Times since the first scan [s], shape [scans].
    temperature : ndarray
        Mean of the chip's temperature sensors [degC], shape [scans].
    signal : ndarray
        Charge as a nominal force, compensated for crosstalk [N], shape [scans, taxels].
    crosstalk : float
        Share of each neighbour's signal for which it is compensated [1].
    force : ndarray
        Force on each taxel under the cover so far [N], shape [scans, taxels].
    loops : ndarray
        What hysteresis adds to it per weight [N], shape [operators, scans, taxels].
    near_force : ndarray of bool
        Where a taxel is touched, or was until a short time ago, shape [scans, taxels].
    cover : ndarray
        Shares of the sensor file's cover and of those of `COVER_SPREADS` in that of the board [1].
    parts : ndarray
        Force on each taxel under each of these [N], shape [covers, scans, taxels].
    bending_sources : BendingSources
        The forces as sources of bending.
    hold : tuple of float, optional
        Begin and end of the long hold [s]; None: there is none.
    noise : ndarray
        Standard deviation of a block mean of each taxel [N], shape [taxels].
    neighbours : list of list of int
        The four neighbours of each taxel, as far as it has them.
    """

    def __init__(self, sensor: Sensor, recording: Recording) -> None:
        self.sensor, self.taxels = sensor, sensor.layout.taxels
        inverse = InverseSignalChain(sensor)
        signal = inverse.charge(recording.counts, np.empty(recording.counts.shape)) / charge_per_newton(sensor)
        # Means over a fixed time obey the same linear equations.
        self.thinning = max(1, int(RESOLUTION / float(np.median(np.diff(recording.time))) + 1e-6))
        self.time, self._raw, force, self.temperature = (
            block_means(values, self.thinning)
            for values in (recording.time - recording.time[0], signal, recording.force, recording.temperature)
        )
        self.size = block_size(self.time)
        self._applied = None if recording.applied is None else block_means(recording.applied, self.thinning)
        self.neighbours = [list(each) for each in neighbour_lists(sensor.layout, EDGE_NEIGHBOURS)]
        self.hold = _long_hold(self.time, force)
        parts = [force]
        if recording.force_under is not None and self.hold is not None:
            at = self.time + recording.time[0]
            parts += [recording.force_under(ratio, at) for ratio in COVER_SPREADS]
        self.parts = np.stack(parts, dtype=np.float32, casting="same_kind")  # six times the forces
        self.compensate(0.0)
        self._take_force(np.eye(len(parts))[0], force)
        self.noise = self._noise()

    def spread(self, cover: Array) -> None:
        """Spread the forces as a cover does in which the parts have these shares, up to a factor.

        Parameters
        ----------
        cover : ndarray
            Shares of the parts [1], shape [covers]; negative ones count as none.
        """
        shares = np.maximum(cover, 0.0)
        shares /= shares.sum()
        self._take_force(shares, np.einsum("i,ijk->jk", shares, self.parts))

    def _take_force(self, cover: Array, force: Array) -> None:
        """Take the forces under a cover, and what follows from them."""
        self.cover, self.force = cover, force
        self.loops = _hysteresis_sources(self.sensor, force)
        touched, tail = force > NO_FORCE, TAIL * self.sensor.device.leak_time_constant
        self.near_force = np.stack(
            [_dilated(self.time, touched[:, taxel], LEAD, tail) for taxel in range(self.taxels)], axis=1
        )
        if self.hold is not None:
            held = touched[(self.time >= self.hold[0]) & (self.time <= self.hold[1])].any(axis=0)
            self.near_force |= self.during_hold(self.time)[:, None] & held
        total = force.sum(axis=1)
        beside = np.maximum((total if self._applied is None else self._applied) - total, 0.0)
        lag = self.sensor.device.thermal_time_constant
        self.bending_sources = BendingSources(self.sensor.layout, self.time, force, beside, lag)

    def compensate(self, crosstalk: float) -> None:
        """Compensate the signals for crosstalk.

        Parameters
        ----------
        crosstalk : float
            Share of each neighbour's signal [1]; what is not between 0 and `MAX_CROSSTALK` counts as the nearer one.
        """
        self.crosstalk = min(max(crosstalk, 0.0), MAX_CROSSTALK)
        compensator = CrosstalkCompensator(self.sensor.layout, self.crosstalk)
        matrix = np.stack([compensator.apply(row).copy() for row in np.eye(self.taxels)])
        self.signal = self._raw @ matrix

    @property
    def near_signal(self) -> Array:
        """Sum of the signals of the four neighbours of each taxel [N], shape [scans, taxels]."""
        return np.stack([self.signal[:, near].sum(axis=1) for near in self.neighbours], axis=1)

    @property
    def untouched(self) -> Mask:
        """Blocks in which no force is on a taxel, nor was until a short time ago, shape [blocks, taxels]."""
        untouched: Mask = block_means(self.near_force.astype(np.float64), self.size) == 0.0
        return untouched

    @property
    def pressed_temperature(self) -> float:
        """Mean temperature of the chip's sensors while a force is applied [degC]."""
        return float(self.temperature[self.near_force.any(axis=1)].mean())

    @property
    def block_temperature(self) -> Array:
        """Temperature of the chip's sensors relative to the start [K], shape [blocks]."""
        return block_means(self.temperature - self.temperature[0], self.size)

    def during_hold(self, time: Array) -> Mask:
        """Return which times are in the long hold or in its tail.

        Parameters
        ----------
        time : ndarray
            [s], shape [times].
        """
        if self.hold is None:
            return np.zeros(len(time), np.bool_)
        during: Mask = (time >= self.hold[0] - LEAD) & (time <= self.hold[1] + HOLD_TAIL)
        return during

    def intervals(self, taxel: int, with_hold: bool) -> list[tuple[int, int]]:
        """Return the scans (first, last + 1) of each segment of a taxel.

        Parameters
        ----------
        taxel : int
            Number of the taxel.
        with_hold : bool
            Whether those in the long hold count.
        """
        mask = self.near_force[:, taxel]
        if not with_hold:
            mask = mask & ~self.during_hold(self.time)
        return [(begin, end) for begin, end in runs(mask) if end - begin >= 10 * self.size]

    def start(self, sources: int) -> dict[int, TaxelResponse]:
        """Return the nominal parameters of the taxels that are pressed, with which a fit starts.

        Parameters
        ----------
        sources : int
            Number of sources of each taxel.
        """
        rate = 1.0 / self.sensor.device.leak_time_constant
        coefficients = np.zeros(sources)
        coefficients[0] = 1.0
        return {
            taxel: TaxelResponse(rate, coefficients, np.zeros(count), np.zeros(count))
            for taxel in range(self.taxels)
            if (count := len(self.intervals(taxel, with_hold=False)))
        }

    def segment(
        self,
        taxel: int,
        begin: int,
        end: int,
        signal: Array,
        further: Sequence[Array] = (),
        common: Array | None = None,
    ) -> Segment:
        """Return consecutive scans of a taxel.

        Parameters
        ----------
        taxel : int
            Number of the taxel.
        begin : int
            First scan.
        end : int
            Last scan, and one more.
        signal : ndarray
            What is to be explained [N], shape [end - begin].
        further : sequence of ndarray, default ()
            Further sources [N], shape [scans, taxels]: one that leaks, then signals.
        common : ndarray, optional
            Sources per gain and common parameter, shape [scans, parameters]; None: there are none.
        """
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
            fitted=fitted_blocks(block_means(time, self.size)),
        )

    def _noise(self) -> Array:
        """Return the standard deviation of a block mean of each taxel [N], from differences of blocks without force."""
        least = force_noise_rms(self.sensor) / np.sqrt(self.size)
        quiet = self.untouched
        means = block_means(self.signal, self.size)
        noise = np.full(self.taxels, least)
        for taxel in range(self.taxels):
            steps = np.abs(np.diff(means[:, taxel]))[quiet[1:, taxel] & quiet[:-1, taxel]]
            if len(steps):
                # The median of |a - b| of two normal values is 0.954 standard deviations.
                noise[taxel] = max(least, float(np.median(steps)) / 0.954)
        return noise


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Return where each run of true begins, and where it has ended.

    Parameters
    ----------
    mask : ndarray of bool
        Shape [scans].
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def fitted_blocks(time: Array) -> Mask:
    """Return which blocks are fitted; the others are the hold-out set.

    Parameters
    ----------
    time : ndarray
        Times of the blocks [s], shape [blocks].
    """
    mask: Mask = (time / STRETCH).astype(np.intp) % FOLDS != FOLDS - 1
    return mask


def loop_slopes(force: float) -> Array:
    """Return the slope of F - P from end to end of loops of a force.

    Parameters
    ----------
    force : float
        The force, relative to the maximum [1].

    Returns
    -------
    ndarray
        Slopes [1], shape [operators].
    """
    return np.minimum(1.0, 2.0 * np.array(PLAY_HALF_WIDTHS) / force)


def _hysteresis_sources(sensor: Sensor, force: Array) -> Array:
    """Return what hysteresis adds to forces [N] per weight, shape [operators, scans, taxels]."""
    distances = [play_distance(force, width * sensor.device.force_max) for width in PLAY_HALF_WIDTHS]
    return np.stack(distances) - loop_slopes(TYPICAL_FORCE)[:, None, None] * force


def _long_hold(time: Array, force: Array) -> tuple[float, float] | None:
    """Return begin and end [s] of the longest time for which one taxel is held with `MIN_FORCE`, None if too short."""
    best: tuple[float, float] | None = None
    for taxel in range(force.shape[1]):
        for begin, end in runs(force[:, taxel] >= MIN_FORCE):
            span = float(time[begin]), float(time[end - 1])
            if span[1] - span[0] >= LONG_HOLD and (best is None or span[1] - span[0] > best[1] - best[0]):
                best = span
    return best


def _dilated(time: Array, mask: Mask, before: float, after: float) -> Mask:
    """Return the mask with each run extended by times [s] before and after it."""
    wide = np.zeros_like(mask)
    for begin, end in runs(mask):
        first, last = np.searchsorted(time, (time[begin] - before, time[end - 1] + after))
        wide[first:last] = True
    return wide
