"""The leak's time constants, found while the sensor is used.

The observer takes tau' for the true tau, and so F' for the force F. As its F' is the charge x that is left and tau/tau'
times what truly leaked,

    F' = x + (tau/tau')*(F - x) = (1 - b)*F + b*x,    b = 1 - tau/tau'

While a force is held, or moves evenly, F' follows the decay of x with the slope b, which a straight line of time beside
it does not take up. So means over blocks, in windows of about one time constant, are fitted by ``F' = a + c*t + b*x``.
Windows that leave more than noise are not believed, nor taxels that contradict the others.

Taxels share an error of the description (temperature of the bias resistors, say), and have each one of its own. With
theta = ln(tau/tau described), what was found on one taxel tells of the others as far as the error is shared.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import upper_median
from posfet_model._lib.types import Array, Mask

POINTS: Final = 24
"""Blocks of a window, at most."""

LEAST_POINTS: Final = 8
"""Fewer blocks are no window."""

HOP: Final = 0.25
"""Windows begin so much of a window apart [1]."""

MISFIT: Final = 2.0
"""Mean square of what a fit leaves, in the variance of its points, above which it is not believed [1]."""

ROUGH: Final = 2e-3
"""What a fit may leave besides, as a share of what the charge moved [1]."""

EVEN: Final = 0.015
"""A force that moved by more than this share of it in a window, evenly, may have moved otherwise, too [1]."""

TELLING: Final = 0.03
"""A fit that knows b to no better than this tells nothing [1]."""

FARTHEST: Final = 0.4
"""A |b| above this has another cause [1]."""

CREEP: Final = 0.02
"""What forces that creep make of b, at most and on all taxels alike: standard deviation [1], assumed."""

LONELY: Final = 0.05
"""What a force that moves makes of b where few taxels tell: standard deviation, over their number [1], assumed."""

APART: Final = 3.0
"""Standard deviations by which a taxel may differ from what is known of it, and from the others in its window [1]."""

REMEMBERED: Final = 4.0
"""Windows that are remembered, if each knows b to no better than `CREEP` [1]."""


class LeakWatch:
    """Finds theta of all taxels, shape [taxels]; `time_constant` is kept up with it."""

    def __init__(self, time_constant: Array, noise_variance: Array, shared: float, own: float) -> None:
        """Take the described time constants [s], and the variance of a reading of each taxel [N2].

        shared is the standard deviation of what the taxels' theta have in common, own that of each by itself [1].
        """
        taxels = len(time_constant)
        self.time_constant = time_constant.copy()
        """[s]; changed in place by `learn`."""
        self.own_deviation = np.full(taxels, own)
        """Standard deviation of theta that each taxel has alone [1]."""
        self.shared_deviation = shared
        """Standard deviation of theta that all taxels share [1]."""
        self.variance = np.zeros(taxels)
        """What is not known of theta makes of each force [N2], the shared part included."""
        self.shared_error = np.zeros(taxels)
        """What a standard deviation of the shared part makes of each force [N]."""
        self._leaked = np.zeros(taxels)
        self._base = np.zeros(taxels)
        self._described = time_constant
        self._shared = shared
        self._own = own
        self._noise_variance = noise_variance
        self._theta = np.zeros(taxels)
        self._weight = np.zeros(taxels)
        self._weighted = np.zeros(taxels)
        self._typical = upper_median(time_constant)
        self._force = np.zeros((POINTS, taxels))
        self._charge = np.zeros((POINTS, taxels))
        self._durations = np.zeros(POINTS)
        self._touched = np.zeros(taxels, np.intp)  # for how many blocks
        self._next = 0
        self._since = 0.0
        self._fresh = False

    @property
    def doubt(self) -> float:
        """Standard deviation of the mean theta [1]."""
        return math.hypot(self.shared_deviation, float(self.own_deviation.mean()))

    def forget(self) -> None:
        """Begin a new window."""
        self._touched[:] = 0

    def begin(self, where: Mask, leaked: Array) -> None:
        """Take note that the masked taxels begin to be touched, with what leaked of their charge so far [N]."""
        self._base[where] = leaked[where]

    def rest(self) -> None:
        """Take note that nothing touches."""
        self.variance[:] = self.shared_error[:] = 0.0

    def take(self, duration: float, scans: int, force: Array, leaked: Array, touched: Mask) -> None:
        """Take a block of `duration` [s]: its mean force and what leaked up to its end [N], and what touched all along.

        `leaked` is all the charge that leaked, as a force, but for a constant.
        """
        self._force[self._next] = force
        # The charge leaks with the time constant, so that what leaked tells the mean of what was there.
        np.multiply(leaked - self._leaked, self.time_constant / duration, out=self._charge[self._next])
        self._leaked = leaked
        self._durations[self._next] = duration
        self._next = (self._next + 1) % POINTS
        self._touched += 1
        self._touched *= touched
        self._since += duration
        points = min(max(math.ceil(self._typical / duration), LEAST_POINTS), POINTS)
        if self._since >= HOP * points * duration:
            through = self._touched >= points
            if through.any():
                self._since = 0.0
                self._fit(through.nonzero()[0], points, scans)

    def learn(self, touched: Mask, told: Array) -> Array | None:
        """Take what was found into the time constants, and set the doubt that is left of the forces that touch.

        told is what leaked [N] since each touch began and is known otherwise but for what each taxel has alone.
        Return by what the forces change [N], as what leaked was counted with other time constants; None: nothing new.
        """
        change = self._learn(touched) if self._fresh else None
        leaked = np.where(touched, self._leaked - self._base, 0.0)
        np.multiply(np.where(touched, leaked - told, 0.0), self.shared_deviation, out=self.shared_error)
        np.multiply(leaked, self.own_deviation, out=self.variance)
        self.variance *= self.variance
        self.variance += self.shared_error**2
        return change

    def _learn(self, touched: Mask) -> Array:
        self._fresh = False
        own, shared = self._own**2, self._shared**2
        seen = self._weight > 0.0
        trust = 1.0 / (own + 1.0 / self._weight[seen])
        total = 1.0 / shared + trust.sum()
        common = float((trust * self._weighted[seen] / self._weight[seen]).sum()) / total
        theta = (common / own + self._weighted) / (1.0 / own + self._weight)
        self.shared_deviation = math.sqrt(1.0 / total)
        np.sqrt(1.0 / (1.0 / own + self._weight), out=self.own_deviation)
        change: Array = np.where(touched, (self._leaked - self._base) * np.expm1(self._theta - theta), 0.0)
        self._theta = theta
        np.multiply(self._described, np.exp(theta), out=self.time_constant)
        self._leaked = self._leaked + change
        self.forget()
        return change

    def _fit(self, taxels: NDArray[np.intp], points: int, scans: int) -> None:
        """Fit the last points, means over `scans` each, of some taxels."""
        rows = np.arange(self._next - points, self._next) % POINTS
        durations = self._durations[rows]
        time = np.cumsum(durations) - 0.5 * durations
        time -= time.mean()
        noise = self._noise_variance[taxels] / scans
        window = self._charge[np.ix_(rows, taxels)]
        charge, charge_rate = _without_line(time, window)
        # Means of force and charge have the same noise, which would make a slope of 1 by itself.
        square = np.einsum("ij,ij->j", charge, charge) - (points - 2) * noise
        telling = square > noise / TELLING**2
        if not telling.any():
            return
        taxels, noise, square = taxels[telling], noise[telling], square[telling]
        charge, charge_rate = charge[:, telling], charge_rate[telling]
        window = self._force[np.ix_(rows, taxels)]
        force, force_rate = _without_line(time, window)
        slope = (np.einsum("ij,ij->j", charge, force) - (points - 2) * noise) / square
        left = np.square(force - slope * charge).sum(axis=0) / (points - 3)
        good = left <= MISFIT * noise * (1.0 - slope) ** 2 + (ROUGH**2 / points) * square
        moved = np.abs(force_rate - slope * charge_rate) * durations.sum()
        good &= (np.abs(slope) < FARTHEST) & (moved <= EVEN * window.mean(axis=0))
        if good.any():
            self._note(taxels[good], slope[good], (noise / square)[good])

    def _note(self, taxels: NDArray[np.intp], slope: Array, variance: Array) -> None:
        """Take note of the slopes b of some taxels, with the variance that their noise gives."""
        count = len(taxels)
        variance = variance + count * CREEP**2 + (LONELY / count) ** 2
        found = self._theta[taxels] + np.log1p(-slope)
        middle = upper_median(found)
        alike = np.abs(found - middle) <= APART * np.sqrt(variance + self._own**2)
        expected = variance + self.own_deviation[taxels] ** 2 + self.shared_deviation**2
        alike &= np.abs(found - self._theta[taxels]) <= APART * np.sqrt(expected)
        if 2 * np.count_nonzero(alike) <= count:
            return
        # Neighbouring windows have most of their blocks in common.
        taxels, found, weight = taxels[alike], found[alike], HOP / variance[alike]
        # No more counts than a few windows, so that a slow change is followed.
        kept = np.minimum(1.0, REMEMBERED / (CREEP**2 * np.maximum(self._weight[taxels], 1.0)))
        self._weight[taxels] = kept * self._weight[taxels] + weight
        self._weighted[taxels] = kept * self._weighted[taxels] + weight * found
        self._fresh = True


def _without_line(time: Array, values: Array) -> tuple[Array, Array]:
    """Return values, shape [points, n], less the straight line of time [s] that fits best, and its slopes, shape [n].

    The mean of time is 0.
    """
    slope = time @ values / (time @ time)
    rest: Array = values - values.mean(axis=0) - time[:, None] * slope
    return rest, slope
