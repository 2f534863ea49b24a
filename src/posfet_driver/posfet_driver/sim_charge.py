"""Charge at the gates of the simulated taxels, moved on only where there is any.

Between two calls of `advance` force and temperature move in a straight line, and the leak is exact for that, whatever
the step: ``sigma1 = sigma0*exp(-h/tau) + (q1 - q0)*(1 - exp(-h/tau))/(h/tau)`` with ``q = force*d33/A + p*dT``
(`posfet_model.charge`, first-order hold), each taxel with its own coefficients. Taxels that were never loaded, and
those whose charge has leaked out, are *asleep*: they keep their state and cost nothing. The awake ones are held side by
side in small arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.loads import Patch
from posfet_driver.sim_spread import TaxelSpread
from posfet_model.sensor import Sensor

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
        """Take the taxels and the width of the film's loop [1]; with `full` no taxel ever sleeps."""
        layout = sensor.layout
        self.updates = 0
        """How many times a taxel's charge was moved on so far."""
        self.awake = np.arange(layout.taxels if full else 0)
        """Numbers of the taxels that are awake, ascending."""
        self.charge: Float64Array = np.zeros(0)
        """Charge density [C/m2] of those that are awake."""
        self._spread = spread
        self._full = full
        self._least = LEAKED_OUT * sensor.device.force_max * float(np.abs(spread.charge_per_newton).max(initial=0.0))
        self._force: Float64Array = np.zeros((layout.rows, layout.cols))
        self._patches: tuple[Patch, ...] = ()
        self._is_awake = np.zeros((layout.rows, layout.cols), np.bool_)
        self._warmth = 0.0  # temperature of the film above that at the start [K]
        self._weight = hysteresis / (2 * sum(PLAY_WIDTHS))
        reach = np.array(PLAY_WIDTHS if hysteresis else ())[:, None]
        self._reach: Float64Array = reach * sensor.device.force_max
        self._play_weights = np.full(len(reach), self._weight)
        self._all_charge: Float64Array = np.zeros(layout.taxels)
        self._all_source = np.zeros(layout.taxels)
        self._all_plays = np.zeros((len(self._reach), layout.taxels))
        self._steps = 0
        # Of those awake: source and play so far, coefficients, and the step that the weights are for.
        self._source: Float64Array
        self._plays: Float64Array
        self._rate: Float64Array
        self._step: float
        self._weights: tuple[Float64Array, Float64Array]
        self._wake_up(np.full((layout.rows, layout.cols), full, np.bool_))

    @property
    def force(self) -> Float64Array:
        """Force on each taxel [N], shape [rows, cols]; never written to again."""
        return self._force

    def all_charge(self) -> Float64Array:
        """Return the charge density of every taxel [C/m2], shape [rows * cols]."""
        self._all_charge[self.awake] = self.charge
        result: Float64Array = self._all_charge.copy()
        return result

    def load(self, patches: Sequence[Patch]) -> bool:
        """Take the forces at the end of the next step; return whether another set of taxels is awake now."""
        force = np.zeros_like(self._force)  # not in place: a ground truth may hold the last ones
        for patch in patches:
            force[patch.rows, patch.cols] += patch.force
        force.flags.writeable = False
        self._force = force
        changed, self._patches = (*self._patches, *patches), tuple(patches)
        woken = self.awake.size < force.size and not all(
            self._is_awake[patch.rows, patch.cols].all() for patch in changed
        )
        if woken:
            wake = self._is_awake.copy()
            for patch in changed:
                wake[_with_neighbours(patch.rows, wake.shape[0]), _with_neighbours(patch.cols, wake.shape[1])] = True
            self._wake_up(wake)
        return woken

    def warm(self, warmth: float) -> bool:
        """Take the film's temperature above the start's [K] at the end of the next step; return as `load` does."""
        if warmth == self._warmth:
            return False
        self._warmth = warmth
        if self._is_awake.all() or not self._spread.charge_per_kelvin.any():
            return False
        self._wake_up(np.ones_like(self._is_awake))
        return True

    def advance(self, step: float, *, resting: bool = False) -> bool:
        """Move on by `step` [s] to what `load` and `warm` gave; return as `load` does.

        With `resting` nothing was given since the last step.
        """
        if not self.awake.size:
            return False
        decay, mean = self._step_weights(step)
        self.charge = self.charge * decay
        if not resting:
            source = self._sources()
            self.charge += mean * (source - self._source)
            self._source = source
        self.updates += self.awake.size
        self._steps += 1
        return not self._full and self._steps % BEDTIME == 0 and self._go_to_sleep()

    def _step_weights(self, step: float) -> tuple[Float64Array, Float64Array]:
        if step != self._step:
            exponent = step * self._rate
            lost = np.expm1(exponent)
            self._step, self._weights = step, (1 + lost, lost / exponent)
        return self._weights

    def _sources(self) -> Float64Array:
        """Return the charge that force and temperature give, before any leaks, of those awake."""
        force = self._force.ravel() if self.awake.size == self._force.size else self._force.take(self.awake)
        if self._reach.size:
            np.maximum(self._plays, force - self._reach, out=self._plays)
            np.minimum(self._plays, force + self._reach, out=self._plays)
            force = (1 - self._weight * len(self._reach)) * force + self._play_weights @ self._plays
        source = force * self._per_newton
        if self._warmth:
            source += self._warmth * self._per_kelvin
        return source

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
        self._step, self._weights = -1.0, (self.charge, self.charge)

    def _go_to_sleep(self) -> bool:
        """Let those sleep that have no charge and no neighbour with any; return whether there was one."""
        charged = np.zeros_like(self._is_awake)
        charged.flat[self.awake] = np.abs(self.charge) > self._least
        near = charged.copy()
        near[1:] |= charged[:-1]
        near[:-1] |= charged[1:]
        near[:, 1:] |= charged[:, :-1]
        near[:, :-1] |= charged[:, 1:]
        near &= self._is_awake
        if near.sum() > 3 * self.awake.size // 4:  # not worth the while
            return False
        self._wake_up(near)
        self._all_charge[~near.ravel()] = 0.0
        return True


def _with_neighbours(part: slice, size: int) -> slice:
    return slice(max(part.start - 1, 0), min(part.stop + 1, size))
