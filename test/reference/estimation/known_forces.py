# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""When a force is known: policies of the zero-force updates, each for one situation.

A taxel's force is known while nothing touches it, while it is beside a contact but not in it, and after a release. It
is never known during motion: a filter that may explain motion by nuisance states does.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_model._lib.types import Array, Mask
from reference.estimation.rest_detector import STILL
from reference.estimation.zero_refutation import SURPRISING
from reference.reductions import median

GATE: Final = 5.0
"""Deviations from which on a residual is no error that the filter expects [1]."""

PERSISTENT_BLOCKS: Final = 16
"""Blocks over which residuals are averaged [1]: what errors leave of them in the filter is white."""

PERSISTENT: Final = GATE / (2 * PERSISTENT_BLOCKS - 1) ** 0.5
"""Mean from which on they are no error that the filter expects [1]: as many deviations of that mean."""

NEGATIVE_TIME: Final = 0.2
"""A negative force that lasts for this long is an error of the baseline [s]: no object pulls."""

UNEXPLAINED_TIME: Final = 2.0
"""A small positive force that is steady for this long, without a contact, is an error of the baseline [s]."""

SMALL: Final = 0.25
"""Such a force is small below this share of the contact threshold [1]."""

STILL_BLOCKS: Final = 5
"""Blocks over which all is still once it counts as such [1]: 0.1 s."""

RELEASED_BLOCKS: Final = 3
"""Blocks for which a contact must look released."""

RELEASED_SHARE: Final = 0.3
"""A released contact has less than this share of its recent peak left [1]."""

RELEASED_DEVIATIONS: Final = 3.09
"""Deviations by which the squares of a released contact's forces may exceed their mean [1]: zero forces do so once in a
thousand times. Each time a contact stays that nothing touches."""

RESIDUAL_MOTION: Final = 0.01
"""Share of its recent peak by which a released contact may still move [1]: the film creeps back."""

PEAK_DECAY: Final = 0.999
"""Decay of the recent peak [1] in"""

PEAK_TIME: Final = 0.02
"""this time [s], a block: 20 s."""

RISEN_SHARE: Final = 0.9
"""Share of its force by which the signal of a contact that has just come has risen in the last blocks [1]."""


class UnexplainedResiduals:
    """Taxels whose residual no state explains: they are left out until they are explained, or known to be errors.

    State variables: for how long each taxel has been below zero, and steady above it, both [s], shapes [taxels].

    Parameters
    ----------
    taxels : int
        Number of taxels.
    threshold : float
        Contact threshold [N].
    """

    def __init__(self, taxels: int, threshold: float) -> None:
        self.rising = np.zeros(taxels, np.bool_)
        """Taxels with a positive residual: a touch may begin there."""
        self.below = np.zeros(taxels)
        """Time for which each taxel has been below zero [s]."""
        self._steady = np.zeros(taxels)
        self._level = np.zeros(taxels)
        self._mean = np.zeros(taxels)
        self._small = SMALL * threshold

    def persistent(self, where: Mask, residual: Array) -> Mask:
        """Process a block; return the mask of the taxels whose residuals have been positive in too many blocks.

        A slow press raises each of them by less than the noise.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels whose residuals count.
        residual : ndarray of float64, shape [taxels]
            Residuals in units of their expected deviations [1].
        """
        self._mean = np.where(where, self._mean + (residual - self._mean) / PERSISTENT_BLOCKS, 0.0)
        return self._mean > PERSISTENT

    def update(self, odd: Mask, residual: Array, mean: Array, noise: Array, duration: float) -> Mask | None:
        """Process a block; return the mask of the taxels whose residual is an error of the baseline, None without one.

        Parameters
        ----------
        odd : ndarray of bool, shape [taxels]
            Taxels whose residual is unexplained.
        residual : ndarray of float64, shape [taxels]
            Residuals [N].
        mean : ndarray of float64, shape [taxels]
            Uncorrected forces of the block [N].
        noise : ndarray of float64, shape [taxels]
            Standard deviation of these means [N].
        duration : float
            Duration of the block [s].
        """
        if not odd.any():
            if self.rising.any() or self.below.any():
                self.rising[:] = False
                self.below[:] = self._steady[:] = 0.0
            return None
        up = residual > 0.0
        self.rising = odd & up
        self.below = np.where(odd & ~up, self.below + duration, 0.0)
        moved = ~self.rising | (np.abs(mean - self._level) > STILL * noise)
        self._level = np.where(moved, mean, self._level)
        self._steady = np.where(moved, 0.0, self._steady + duration)
        errors: Mask = self.below >= NEGATIVE_TIME
        errors |= (self._steady >= UNEXPLAINED_TIME) & (residual < self._small)
        self.below[errors] = self._steady[errors] = 0.0
        return errors

    def reset(self) -> None:
        """Forget what is rising and below zero; averages stay."""
        self.rising[:] = False
        self.below[:] = self._steady[:] = 0.0


def _mean_square(count: int) -> float:
    """Return the mean of so many squares that zero forces exceed as rarely as `RELEASED_DEVIATIONS`.

    Quantile of the chi-square distribution after Wilson and Hilferty, PNAS 17, 684, 1931.
    """
    spread = 2.0 / (9.0 * count)
    return (1.0 - spread + RELEASED_DEVIATIONS * math.sqrt(spread)) ** 3


def _total(forces: Array) -> float:
    """Return a sum in the order of the taxels [N]."""
    return float(np.cumsum(forces)[-1])


class ReleaseDetector:
    """Finds contacts that are still listed, as their forces are above the threshold, but were released.

    A contact was released when its forces are jointly within their uncertainty, small against its recent peak, and
    still; without the last, the end of a slow release would become zero too early.

    State variables: recent peak of each taxel's force and of the total force of the contact it was in [N], the means of
    the last blocks, and the number of blocks for which each contact has looked released.

    Parameters
    ----------
    taxels : int
        Number of taxels.
    """

    def __init__(self, taxels: int) -> None:
        self._peak, self._object = np.zeros(taxels), np.zeros(taxels)
        self._means: deque[Array] = deque(maxlen=STILL_BLOCKS + 1)
        self._blocks, self._touched_for = np.zeros((2, taxels), np.intp)

    def update(
        self,
        contacts: Sequence[NDArray[np.intp]],
        mean: Array,
        course: Array,
        rise: Array,
        touched: Mask,
        variance: Array,
        noise: Array,
        duration: float,
    ) -> Mask | None:
        """Process a block; return the mask of the taxels of released contacts, None without one.

        Parameters
        ----------
        contacts : sequence of ndarray of int
            Taxels of each contact.
        mean : ndarray of float64, shape [taxels]
            Mean forces [N].
        course : ndarray of float64, shape [taxels]
            The same with the charge of bending, which moves as the forces do [N].
        rise : ndarray of float64, shape [taxels]
            Rise of the signals in the last blocks, as many as `STILL_BLOCKS`, whatever was corrected since [N].
        touched : ndarray of bool, shape [taxels]
            Touched taxels.
        variance : ndarray of float64, shape [taxels]
            Their variances [N2].
        noise : ndarray of float64, shape [taxels]
            Variances of the noise of a mean [N2].
        duration : float
            Duration of the block [s].
        """
        kept = PEAK_DECAY ** (duration / PEAK_TIME)
        self._peak *= kept
        self._object *= kept
        self._touched_for = np.where(touched, self._touched_for + 1, 0)
        np.maximum(self._peak, np.where(touched, mean, 0.0), out=self._peak)
        self._means.append(course)
        for contact in contacts:
            strongest, total = contact[int(np.argmax(mean[contact]))], _total(mean[contact])
            # One object: what is left at its edge was its, too. What an earlier one has left there is not.
            came = total < RELEASED_SHARE * self._object[strongest] and self._has_just_come(contact, total, rise)
            self._peak[contact] = mean[strongest] if came else self._peak[strongest]
            self._object[contact] = total if came else max(float(self._object[strongest]), total)
        if not contacts:
            self._blocks[:] = 0
            return None
        looks = np.zeros(len(mean), np.bool_)
        if len(self._means) > STILL_BLOCKS:
            before = self._means[0]
            for contact in contacts:
                peak = float(self._peak[contact].max())
                force = mean[contact]
                motion = float((np.abs(course[contact] - before[contact]) - GATE * np.sqrt(noise[contact])).max())
                looks[contact] = (
                    _total(force) < RELEASED_SHARE * float(self._object[contact].max())
                    and motion < RESIDUAL_MOTION * peak
                    and float(np.mean(force * force / variance[contact])) < _mean_square(len(contact))
                )
        self._blocks = np.where(looks, self._blocks + 1, 0)
        released: Mask = self._blocks >= RELEASED_BLOCKS
        return released if released.any() else None

    def _has_just_come(self, contact: NDArray[np.intp], total: float, rise: Array) -> bool:
        """Return whether a contact has risen in the last blocks: what a released one leaves is slow."""
        rested = not (self._touched_for[contact] > STILL_BLOCKS).any()
        return rested and float(rise[contact].sum()) > RISEN_SHARE * total

    def restart(self) -> None:
        """Forget the last blocks: an unknown time has passed since."""
        self._means.clear()

    def left(self, mean: Array, noise: Array) -> Mask:
        """Return the mask of taxels that nothing touches, of those that were touched and are in no contact.

        Their force has hardly changed in the last blocks, or is below zero in the next one, as no object pulls.

        Parameters
        ----------
        mean : ndarray of float64, shape [taxels]
            Mean forces in the block that comes next [N].
        noise : ndarray of float64, shape [taxels]
            Standard deviations of a mean [N].
        """
        if len(self._means) <= STILL_BLOCKS:
            return np.ones(len(self._peak), np.bool_)
        moved = np.abs(self._means[-1] - self._means[-1 - RELEASED_BLOCKS])
        left: Mask = (mean < -GATE * noise) | (moved < GATE * noise + RESIDUAL_MOTION * self._peak)
        return left


class UniformChange:
    """Hypothesis that all taxels changed because the film's temperature did, faster than the filter expects.

    A press on the whole array looks the same at first. What distinguishes it is its pattern, as warming acts on every
    taxel by its pyroelectric response; its rate; and, after `CONFIRMATION`, what the sensors show.

    State variables: since when the hypothesis has been open [s], and for how long it must not be made again [s].

    Parameters
    ----------
    newton_per_kelvin : ndarray of float64, shape [taxels]
        Pyroelectric signal of each taxel [N/K].
    spread : float
        Relative standard deviation of these signals [1].
    """

    FEWEST: Final = scan_path.FEWEST_FOR_UNIFORM
    """With fewer taxels a uniform change is no evidence: a fingertip presses them all."""
    FASTEST: Final = 3.0
    """Greatest rate of a temperature [K/s], assumed."""
    MISFITS: Final = 0.2
    """Share of the taxels that may not fit the pattern [1]."""
    CONFIRMATION: Final = 0.3
    """Time after which the chip's sensors must show the change, and twice their lag [s]: three readings."""
    INTERVAL: Final = 0.15
    """A new reading is awaited for this long [s]; a reading that did not change until then is a new one, too."""
    CONFIRMED: Final = 0.3
    """Share of it that they must show [1]."""
    DISTINCT: Final = 4.0
    """Least change that the sensors resolve, in deviations of what they show [1]; a smaller one is no contact."""
    PAUSE: Final = 1.0
    """Time for which a refused hypothesis is not made again [s]."""

    def __init__(self, newton_per_kelvin: Array, spread: float) -> None:
        self._per_kelvin = newton_per_kelvin
        self._spread = spread
        self.pause = 0.0
        """Time for which the hypothesis must not be made [s]."""
        self._open = math.nan
        self.observable = len(newton_per_kelvin) >= self.FEWEST and bool((newton_per_kelvin != 0.0).all())
        """Whether the pattern is informative."""

    @property
    def open(self) -> bool:
        """Whether the hypothesis is open for a rise of the forces."""
        return not math.isnan(self._open)

    def temperature(
        self, residual: Array, where: Mask, deviation: Array, own: Array, duration: float, noticed: bool = False
    ) -> float:
        """Return the temperature change that explains the residuals of a block [K]; 0: there is none.

        Parameters
        ----------
        residual : ndarray of float64, shape [taxels]
            Residuals [N].
        where : ndarray of bool, shape [taxels]
            Taxels with a known force.
        deviation : ndarray of float64, shape [taxels]
            Their expected deviations [N].
        own : ndarray of float64, shape [taxels]
            Those of what the taxels do not share [N], which averages out.
        duration : float
            Duration of the block [s].
        noticed : bool, optional
            Whether one of the residuals alone is not expected.
        """
        if not self.observable or np.count_nonzero(where) < self.FEWEST:
            return 0.0
        response = self._per_kelvin[where]
        change = residual[where]
        kelvin = median(change / response)
        force = kelvin * response
        single, alone = median(deviation[where]), median(own[where])
        least = (SURPRISING if noticed else GATE) * math.sqrt(max(single**2 - alone**2, 0.0) + alone**2 / len(change))
        if abs(float(force.mean())) < least:
            return 0.0
        if float(force.mean()) < 0.0:
            return kelvin  # no object pulls at the whole array
        misfit = np.abs(change - force) > SURPRISING * (self._spread * np.abs(force) + own[where])
        fits = np.count_nonzero(misfit) <= self.MISFITS * len(change) and abs(kelvin) <= self.FASTEST * duration
        return kelvin if fits and self.pause <= 0.0 else 0.0

    def begin(self) -> None:
        """Open the hypothesis that the forces rise with the film's temperature."""
        if not self.open:
            self._open = 0.0

    def is_refused(
        self,
        odd: Mask,
        where: Mask,
        claimed: float,
        shown: float,
        deviation: float,
        negligible: float,
        wait: float,
        duration: float,
    ) -> bool:
        """Process a block; return whether the open hypothesis is wrong.

        It stays open while what it claims matters, and the sensors cannot decide.

        Parameters
        ----------
        odd : ndarray of bool, shape [taxels]
            Taxels that do not fit the pattern.
        where : ndarray of bool, shape [taxels]
            Taxels with a known force.
        claimed : float
            Change of the film's temperature according to the hypothesis [K].
        shown : float
            The change of the film according to the sensors [K]; NaN without a hypothesis.
        deviation : float
            Standard deviation of that change [K].
        negligible : float
            Difference of both that makes no difference to the forces [K].
        wait : float
            Time after which the sensors show most of a change of the film [s].
        duration : float
            Duration of the block [s].
        """
        if where.any():
            self.pause = max(self.pause - duration, 0.0)
        if not self.open:
            return False
        self._open += duration
        wrong = np.count_nonzero(odd & where) > self.MISFITS * np.count_nonzero(where)
        if self._open >= wait:
            much = shown * claimed >= self.CONFIRMED * claimed * claimed
            resolved = math.isfinite(shown) and abs(claimed - shown) > self.DISTINCT * deviation
            wrong |= resolved and not much and abs(claimed) >= abs(shown)
            confirmed = much and abs(shown) > self.DISTINCT * deviation
            if resolved or confirmed or abs(claimed - shown) <= negligible:
                self.close()
        return bool(wrong)

    def refuse(self) -> None:
        """Close the hypothesis as wrong."""
        self.close()
        self.pause = self.PAUSE

    def close(self) -> None:
        """Close the hypothesis, wrong or not."""
        self._open = math.nan
