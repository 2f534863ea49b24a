"""The leak undone scan by scan: by how much forces changed, from charges that leak, each taxel at its own rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posfet_model._lib.first_order import mean_decay
from posfet_model._lib.types import Array


@dataclass(frozen=True)
class LeakCoefficients:
    """Coefficients of a time step h, of each taxel; not to be written to."""

    ratio: Array
    """h/tau, what an offset is multiplied with."""
    now: Array
    before: Array
    """And the charges at the end and at the start of the step [N m2/C]."""


class LeakInverse:
    """With signals s = k*sigma a step h brings the force ``(s1 - s0)/mean + h/tau*(s0 - offset)``.

    mean is (1 - exp(-h/tau))/(h/tau), as in `charge.invert_first_order_hold`.
    """

    MOST = 64
    """Different steps whose coefficients are kept."""

    def __init__(self, time_constant: Array, newton_per_charge: Array) -> None:
        """Take the time constants [s], shape [taxels], and k [N m2/C]."""
        self._time_constant = time_constant
        self._newton_per_charge = newton_per_charge
        self._known: dict[float, LeakCoefficients] = {}
        self._charge, self._offset_leaks = np.zeros((2, len(time_constant)))
        self._used: LeakCoefficients | None = None  # for `_offset_leaks`

    @property
    def signal(self) -> Array:
        """Charges of the last scan as forces [N], what leaked not put back, shape [taxels]."""
        signal: Array = self._charge * self._newton_per_charge
        return signal

    def begin(self, charge: Array) -> None:
        """Take the charge densities [C/m2] of a scan that has none before it."""
        self._charge[...] = charge

    def advance(self, charge: Array, offset: Array, step: float, out: Array) -> LeakCoefficients:
        """Take charge densities [C/m2] a step [s] later; by how much forces changed [N] is in `out`."""
        leak = self._known.get(step) or self._learn(step)
        if leak is not self._used:
            np.multiply(offset, leak.ratio, out=self._offset_leaks)
            self._used = leak
        last = self._charge
        np.multiply(charge, leak.now, out=out)
        last *= leak.before
        out += last
        out -= self._offset_leaks
        last[...] = charge
        return leak

    def forget_offset(self) -> None:
        """Take note that the offset was changed in place."""
        self._used = None

    def forget(self) -> None:
        """Take note that the time constants were changed in place."""
        self._known.clear()

    def _learn(self, step: float) -> LeakCoefficients:
        if len(self._known) >= self.MOST:
            self._known.clear()
        ratio = step / self._time_constant
        now = self._newton_per_charge / mean_decay(ratio)
        leak = self._known[step] = LeakCoefficients(ratio, now, self._newton_per_charge * ratio - now)
        return leak
