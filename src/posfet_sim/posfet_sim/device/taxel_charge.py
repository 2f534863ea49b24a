"""Charge at the gates of the simulated taxels, moved on only where there is any.

From scan to scan force and temperature move in a straight line, and the leak is exact for that, whatever the step:
``sigma1 = sigma0*exp(-h/tau) + (q1 - q0)*(1 - exp(-h/tau))/(h/tau)`` with ``q = force*d33/A + p*dT``
(`posfet_model.device.charge`, first-order hold), each taxel with its own coefficients. Taxels that were never loaded,
and those whose charge has leaked out, are *asleep*: they keep their state and cost nothing. The awake ones are kept
side by side in small arrays, and moved on over several scans in one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import EDGE_NEIGHBOURS, dilate, neighbour_table
from posfet_sim.device.taxel_variation import TaxelSpread
from posfet_sim.loads import Patch

LEAKED_OUT: Final = 1e-13
"""Charge taken as none, as a share of that of the greatest force."""
BEDTIME: Final = 256
"""Every so many steps, taxels whose charge has leaked out fall asleep."""
PLAY_WIDTHS: Final = (0.05, 0.10, 0.20)
"""Half widths of the film's elementary loops, as shares of the greatest force; assumed."""

Float64Array = NDArray[np.float64]


class TaxelCharge:
    """Charge of each taxel from forces and film temperature; starts without either, all charge leaked.

    Hysteresis follows Prandtl and Ishlinskii (A. Visintin, Differential Models of Hysteresis, 1994, ch. III): the force
    counts as ``F - w*sum(F - p_k)``, where the play p_k is dragged along at the distance r_k at most. It knows no rate,
    so a force at rest changes nothing. With r_k as in `PLAY_WIDTHS`, w is 1/0.7 of the loop's width as a share of the
    greatest force; as in Rayleigh's law small changes of force count less than great ones, by up to 3*w.
    """

    def __init__(self, sensor: Sensor, spread: TaxelSpread, hysteresis: float, full: bool) -> None:
        """Take the taxels and the width of the film's loop [1]; with `full` no taxel ever sleeps.

        The float width of `spread` is what is computed in.
        """
        layout, kind = sensor.layout, spread.charge_per_newton.dtype
        self.updates = 0
        """How many times a taxel's charge was moved on so far."""
        self.awake = np.arange(layout.taxels if full else 0)
        """Numbers of the taxels that are awake, ascending."""
        self.charge: Float64Array = np.zeros(0, kind)
        """Charge density [C/m2] of those that are awake."""
        self._spread = spread
        self._full = full
        self._least = LEAKED_OUT * sensor.device.force_max * float(np.abs(spread.charge_per_newton).max(initial=0.0))
        self._patches: tuple[Patch, ...] = ()
        self._is_awake = np.zeros((layout.rows, layout.cols), np.bool_)
        self._neighbours = neighbour_table(layout, EDGE_NEIGHBOURS)
        self._weight = hysteresis / (2 * sum(PLAY_WIDTHS))
        reach = np.array(PLAY_WIDTHS if hysteresis else (), kind)[:, None]
        self._reach: Float64Array = reach * sensor.device.force_max
        self._all_charge: Float64Array = np.zeros(layout.taxels, kind)
        self._all_source = np.zeros(layout.taxels, kind)
        self._all_plays = np.zeros((len(self._reach), layout.taxels), kind)
        self._steps = 0
        # Of those awake: source and play so far, and coefficients.
        self._source: Float64Array
        self._plays: Float64Array
        self._rate: Float64Array
        self._wake_up(np.full((layout.rows, layout.cols), full, np.bool_))

    def wake(self, patches: Sequence[Patch]) -> None:
        """Wake the taxels that something is about to press on, or did until now, and their neighbours."""
        changed, self._patches = (*self._patches, *patches), tuple(patches)
        if self.awake.size == self._is_awake.size or all(
            self._is_awake[patch.rows, patch.cols].all() for patch in changed
        ):
            return
        wake = self._is_awake.copy()
        for patch in changed:
            wake[_with_neighbours(patch.rows, wake.shape[0]), _with_neighbours(patch.cols, wake.shape[1])] = True
        self._wake_up(wake)

    def wake_all(self) -> None:
        """Wake every taxel that temperature charges: all or none of them."""
        if self.awake.size < self._is_awake.size and self._spread.charge_per_kelvin.any():
            self._wake_up(np.ones_like(self._is_awake))

    def advance(self, force: Float64Array, warmth: Float64Array, steps: Float64Array) -> Float64Array:
        """Move on by some scans and return the charge before them and at each, shape [scans + 1, awake].

        Takes the force on every taxel [N], shape [scans, rows * cols], the film's temperature above that at the start
        [K] and the time [s] from the scan before, both of shape [scans].
        """
        if force.shape[1] > self.awake.size:
            force = force[:, self.awake]
        kind = self.charge.dtype
        force, steps = force.astype(kind, copy=False), steps.astype(kind, copy=False)
        sources = np.empty((len(steps) + 1, self.awake.size), kind)
        sources[0] = self._source
        sources[1:] = self._counted(force)
        sources[1:] *= self._per_newton
        if warmth.any():
            sources[1:] += np.multiply.outer(warmth.astype(kind, copy=False), self._per_kelvin)
        same = steps.min() == steps.max()
        exponent = np.multiply.outer(steps[:1] if same else steps, self._rate)
        lost = np.expm1(exponent)
        decay = np.broadcast_to(1 + lost, (len(steps), self.awake.size))
        charge = np.empty_like(sources)
        charge[0] = self.charge
        np.multiply(lost / exponent, np.diff(sources, axis=0), out=charge[1:])
        for before, after, left in zip(charge[:-1], charge[1:], decay, strict=True):
            np.add(after, before * left, out=after)
        self._source = sources[-1]
        return self._end_at(charge)

    def rest(self, times: Float64Array) -> Float64Array:
        """Move on while nothing changes: return the charge some times [s] after the last scan, shape [times, awake]."""
        times = times.astype(self.charge.dtype, copy=False)
        return self._end_at(np.exp(np.multiply.outer(times, self._rate)) * self.charge)

    def sleep(self) -> bool:
        """Let those sleep that have no charge and no neighbour with any, now and then; return whether there was one."""
        if self._full or self._steps < BEDTIME:
            return False
        self._steps = 0
        return self._go_to_sleep()

    def _end_at(self, charge: Float64Array) -> Float64Array:
        self.charge = charge[-1]
        self.updates += (len(charge) - 1) * self.awake.size
        self._steps += len(charge) - 1
        return charge

    def _counted(self, force: Float64Array) -> Float64Array:
        """Return what forces [N] count as behind the film's hysteresis, shape [scans, awake]."""
        if not self._reach.size:
            return force
        least, most = force[:, None] - self._reach, force[:, None] + self._reach
        plays = np.empty_like(least)
        before = self._plays
        for low, high, after in zip(least, most, plays, strict=True):
            np.maximum(before, low, out=after)
            np.minimum(after, high, out=after)
            before = after
        self._plays = plays[-1]
        counted: Float64Array = force * (1 - self._weight * len(self._reach))
        counted += self._weight * plays.sum(axis=1)
        return counted

    def _wake_up(self, wake: NDArray[np.bool_]) -> None:
        """Let those and no others be awake."""
        if self.charge.size:
            self._all_charge[self.awake] = self.charge
            self._all_source[self.awake] = self._source
            self._all_plays[:, self.awake] = self._plays
        self._is_awake = wake
        self.awake = np.flatnonzero(wake)
        self.charge = self._all_charge[self.awake]
        self._source = self._all_source[self.awake]
        self._plays = self._all_plays[:, self.awake]
        self._per_newton = self._spread.charge_per_newton[self.awake]
        self._per_kelvin = self._spread.charge_per_kelvin[self.awake]
        self._rate = -1 / self._spread.leak_time_constant[self.awake]

    def _go_to_sleep(self) -> bool:
        """Let those sleep that have no charge and no neighbour with any; return whether there was one."""
        charged = np.zeros_like(self._is_awake)
        charged.flat[self.awake] = np.abs(self.charge) > self._least
        near = dilate(charged.ravel(), self._neighbours).reshape(charged.shape) & self._is_awake
        if near.sum() > 3 * self.awake.size // 4:  # not worth the while
            return False
        self._wake_up(near)
        self._all_charge[~near.ravel()] = 0.0
        return True


def _with_neighbours(part: slice, size: int) -> slice:
    return slice(max(part.start - 1, 0), min(part.stop + 1, size))
