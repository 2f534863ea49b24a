# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Creep of a held object, before its contacts are reported as slipping: the shift of two force images."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class CreepWatch:
    """Measures how far a held object has moved past both fingertips within the last scans, by micrometres.

    The mean force image of the newest `NEW` scans is the one of the scans before, shifted and scaled: shift and scale
    are fitted by least squares (a gradient-based image registration). The shift is that of the object, so it is the
    same on both fingertips, which face each other: x is mirrored. The scale is free on each, since grip and weight
    change it. Each taxel counts by the noise that it shows from scan to scan, which depends on board, object and force;
    from it follows the covariance of the shift. Forces need not be valid: what makes them uncertain changes slowly.

    Parameters
    ----------
    pitch : tuple of float, optional
        Distance of the taxels along x and y [m]; default: that of the shipped sensor.
    """

    NEW = 4
    """Scans of the newest mean."""
    REFERENCE = 16
    """Most scans of the mean before."""
    LEAST_REFERENCE = 8
    """Least scans of it."""
    DEVIATIONS = 4.0
    """Standard deviations of the shift that noise explains."""
    MEMORY = 64
    """Scans over which the noise is averaged."""
    FIRST_NOISE = 0.5e-3
    """Standard deviation of the noise of a taxel before it is measured [N]."""
    LEAST_NOISE = 0.1e-3
    """Least standard deviation of it [N]: forces are not negative, so that an untouched taxel shows none."""

    def __init__(self, pitch: tuple[float, float] = (1.5e-3, 1.5e-3)) -> None:
        self._pitch = np.array(pitch)
        self._images: deque[FloatArray] = deque(maxlen=self.NEW + self.REFERENCE)
        self._variance: FloatArray | None = None  # of the noise of each taxel [N2], shape [2, rows, cols]

    def clear(self) -> None:
        """Take a new reference."""
        self._images.clear()

    def update(self, left: FloatArray | None, right: FloatArray | None) -> float:
        """Add the force images of a scan and return the displacement that noise does not explain [m], at least 0.

        Parameters
        ----------
        left, right : array of shape [rows, cols], or None
            Force on each taxel [N], NaN where it is unknown; None: nothing touches the fingertip.
        """
        if left is None or right is None:
            self.clear()
            return 0.0
        self._images.append(np.stack([left, right]).astype(np.float64))
        self._measure_noise()
        if len(self._images) < self.NEW + self.LEAST_REFERENCE:
            return 0.0
        shift, covariance = self.shift()
        distance = math.hypot(*shift)
        if distance == 0.0:
            return 0.0
        deviation = math.sqrt(shift @ covariance @ shift) / distance
        return max(distance - self.DEVIATIONS * deviation, 0.0)

    def shift(self) -> tuple[FloatArray, FloatArray]:
        """Return the shift of the newest images along x and y of the right fingertip [m], and its covariance [m2].

        A prior deviation of one pitch keeps it defined: an even pressure says nothing of its shift.
        """
        assert self._variance is not None
        images = np.array(self._images)
        older = len(images) - self.NEW
        reference, newest = images[:older].mean(0), images[older:].mean(0)
        along_y, along_x = gradient(reference, 1), gradient(reference, 2)
        along_x[0] *= -1.0
        change = newest - reference
        known = np.isfinite(change + along_x + along_y)
        weight = known / (self._variance * (1 / older + 1 / self.NEW))
        terms = np.where(known, np.stack([-along_x, -along_y, reference]), 0.0).reshape(3, 2, -1).transpose(1, 0, 2)
        weighted = terms * weight.reshape(2, 1, -1)
        normal = weighted @ terms.transpose(0, 2, 1)
        right_side = (weighted @ np.where(known, change, 0.0).reshape(2, -1, 1))[..., 0]
        information, sums = np.eye(2), np.zeros(2)
        for matrix, vector in zip(normal, right_side, strict=True):
            if matrix[2, 2] > 0.0:  # the scale is eliminated
                share = matrix[:2, 2] / matrix[2, 2]
                information += matrix[:2, :2] - np.outer(share, matrix[2, :2])
                sums += vector[:2] - share * vector[2]
        covariance = np.linalg.inv(information)
        return covariance @ sums * self._pitch, covariance * np.outer(self._pitch, self._pitch)

    def _measure_noise(self) -> None:
        """Average the squared second differences of each taxel, which a steady change of its force leaves out."""
        if self._variance is None:
            self._variance = np.full_like(self._images[-1], self.FIRST_NOISE**2)
        if len(self._images) < 3:
            return
        second = self._images[-1] - 2 * self._images[-2] + self._images[-3]
        known = np.isfinite(second)
        self._variance[known] += (second[known] ** 2 / 6 - self._variance[known]) / self.MEMORY
        np.maximum(self._variance, self.LEAST_NOISE**2, out=self._variance)


def gradient(images: FloatArray, axis: int) -> FloatArray:
    """Return the gradient of images along an axis, per pitch.

    It is the mean of the differences from both neighbours, or the one from the only neighbour that is there and known.
    """
    shape = list(images.shape)
    shape[axis] += 1
    steps = np.full(shape, np.nan)
    inner = [slice(None)] * images.ndim
    inner[axis] = slice(1, -1)
    steps[tuple(inner)] = np.diff(images, axis=axis)
    before, after = (steps.take(range(first, first + images.shape[axis]), axis) for first in (0, 1))
    both: FloatArray = np.where(np.isnan(before), after, np.where(np.isnan(after), before, (before + after) / 2))
    return both
