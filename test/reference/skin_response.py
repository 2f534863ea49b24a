# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of what the elastomer skin lets the neighbours of a pressed taxel feel, in NumPy."""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import neighbour_table
from posfet_model.sensor.skin_response import LEAST_SPREAD, neighbour_share

CLEAR_SHARE: Final = 0.5
"""Share of what the skin must let the neighbours feel below which they contradict a touch [1]: the rest is for gains
and crosstalk that differ from their description."""


class SkinResponse:
    """Tests whether the neighbours of taxels feel what the skin must let them feel of a touch.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    """

    def __init__(self, sensor: Sensor) -> None:
        layout, spread = sensor.layout, sensor.device.contact_spread
        self._axes = [
            (neighbour_table(layout, steps), neighbour_share(pitch, spread))
            for steps, pitch in ((((0, -1), (0, 1)), layout.pitch_x), (((-1, 0), (1, 0)), layout.pitch_y))
            if spread >= LEAST_SPREAD * pitch
        ]
        self._values = np.zeros((3, layout.taxels + 1))

    def contradicts(
        self, force: Array, variance: Array, sound: Mask, certainty: float, one_sided: bool = False
    ) -> tuple[Mask, Mask]:
        """Return where the neighbours contradict a touch, and where they could.

        Parameters
        ----------
        force : ndarray of float64, shape [rows * cols]
            Forces, or their changes, of either sign, in any unit.
        variance : ndarray of float64, shape [rows * cols]
            Variance of each, in that unit squared.
        sound : ndarray of bool, shape [rows * cols]
            Taxels whose forces are known. Along an axis on which a neighbour is not, nothing is tested.
        certainty : float
            Standard deviations by which the neighbours must miss what they had to feel [1].
        one_sided : bool, optional
            Whether a single neighbour along an axis counts, too: for loads up to the centre of an outermost cell.

        Returns
        -------
        contradicted : ndarray of bool, shape [rows * cols]
            Along some axis the neighbours feel clearly less than they must.
        testable : ndarray of bool, shape [rows * cols]
            There are neighbours enough along some axis.
        """
        values = self._values
        values[0, :-1] = np.where(sound, force, 0.0)
        values[1, :-1] = np.where(sound, variance, 0.0)
        values[2, :-1] = sound
        sign = np.sign(force)
        contradicted, testable = np.zeros((2, len(force)), np.bool_)
        for table, share in self._axes:
            felt, uncertain, count = values[:, table].sum(axis=2)
            informative = (count == (table < len(force)).sum(axis=1)) & (count >= (1 if one_sided else 2))
            least = share * count * np.abs(force)
            deviation = np.sqrt(uncertain + (share * count) ** 2 * variance)
            missing = (sign * felt < CLEAR_SHARE * least) & (least - sign * felt > certainty * deviation)
            contradicted |= informative & missing
            testable |= informative
        return contradicted, testable
