# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Dynamic (high-pass) channel: vibration of each taxel, and slip detection for each contact.

The change of force from scan to scan passes a first-order high-pass filter, which removes errors of the baseline.

A contact slips when its centre moves faster than a hand would move it. With y the high-passed force of a taxel at x, a
centre c and time constant T of the high-pass, a force distribution F that moves at v gives ``sum((x - c)*y) = F*v*T``.
A press or a vibration changes F, but hardly its shape: then the same sum is negligible compared with ``sum(y)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_core.contact import Contact, ContactState
from posfet_model.sensor.description import Layout
from reference.contacts.detection import Region

CORNER_FREQUENCY: Final = 50.0
"""Corner frequency of the high-pass [Hz]."""

POWER_TIME_CONSTANT: Final = 0.01
"""Time constant of the average of a vibration's power [s]."""

SLIP_SPEED: Final = 10e-3
"""A contact slips from this speed on [m/s], assumed."""

SLIP_END_SPEED: Final = 5e-3
"""A slip ends below this speed [m/s], assumed."""

SLIP_END_TIME: Final = 0.01
"""Time below that speed after which a slip ends [s]."""

SLIP_NOISE_DEVIATIONS: Final = 6.0
"""Standard deviations of the noise below which nothing counts as slip [1]."""

LEVER: Final = 0.5
"""Least distance between the centre of the changing force and that of the contact [pitch]: a press changes the force
about the contact's centre."""

ONSET_SHARE: Final = 0.15
"""A contact whose high-passed force exceeds this share of its force is in onset or release, and does not slip [1]."""


@dataclass(slots=True)
class Motion:
    """Vibration and slip state of one contact."""

    power: float = 0.0
    """Mean square of its high-passed force [N2]."""
    slipping: bool = False
    """Whether the contact slips."""
    still: float = 0.0
    """Time below the end speed of a slip [s]."""
    taxels: NDArray[np.intp] | None = None
    """Taxels of the contact in the last scan."""
    plane: NDArray[np.float64] | None = None
    """1, x and y [1, m, m] of these taxels, shape [taxels, 3]; cached."""

    @property
    def vibration(self) -> float:
        """Root mean square of the contact's force above the corner frequency [N]."""
        return math.sqrt(self.power)


class DynamicChannel:
    """High-passed force of every taxel, updated by `advance` for each scan; restarts after a `pause`.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    noise : float
        Standard deviation of a reading [N].
    """

    def __init__(self, layout: Layout, noise: float) -> None:
        x, y = layout.positions.T
        self._plane = np.stack([np.ones(layout.taxels), x, y], axis=1)
        self._lever = LEVER * max(layout.pitch_x, layout.pitch_y)
        self._noise = noise
        self._passed = np.zeros(layout.taxels)
        self._square = np.zeros(layout.taxels)
        self._running = False
        self._motions: dict[int, Motion] = {}
        self.high_passed = np.zeros(layout.taxels)
        """High-passed force of each taxel [N], shape [rows * cols]."""
        self.power = np.zeros(layout.taxels)
        """Mean square of the high-passed force [N2], shape [rows * cols]; updated by `update_power`."""

    def pause(self) -> None:
        """Stop the filter: the scans from here on are not passed to `advance`."""
        if self._running:
            self._running = False
            self.high_passed[:] = 0.0
            self.power[:] = 0.0
            self._motions.clear()

    def advance(self, change: NDArray[np.float64], step: float) -> None:
        """Filter the force changes of a scan; the first call after a pause only starts the filter.

        Parameters
        ----------
        change : ndarray of float64, shape [rows * cols]
            Change of each force since the previous scan [N].
        step : float
            Time since the previous scan [s].
        """
        if self._running:
            decay, share = _high_pass(step)
            high_passed = self.high_passed
            high_passed *= decay
            high_passed += np.multiply(change, share, out=self._passed)
        self._running = True

    def update_power(self, step: float) -> None:
        """Update the mean square of each taxel's high-passed force over a step [s]."""
        np.multiply(self.high_passed, self.high_passed, out=self._square)
        self._square -= self.power
        self._square *= -math.expm1(-step / POWER_TIME_CONSTANT)
        self.power += self._square

    def update(self, contacts: Sequence[Contact], force: NDArray[np.float64], step: float) -> dict[int, Motion]:
        """Update vibration and slip of each contact.

        Parameters
        ----------
        contacts : sequence of Contact
            Contacts of the scan.
        force : ndarray of float64, shape [rows * cols]
            Forces of all taxels [N].
        step : float
            Time since the previous scan [s].

        Returns
        -------
        dict of int to Motion
            State of each contact that is not released, by its id.
        """
        motions: dict[int, Motion] = {}
        for contact in contacts:
            if contact.state is not ContactState.RELEASED:
                motion = self._motions.get(contact.id) or Motion()
                motions[contact.id] = self._update_motion(contact.region, force, motion, step)
        self._motions = motions
        return motions

    def _update_motion(self, region: Region, force: NDArray[np.float64], motion: Motion, step: float) -> Motion:
        taxels = region.taxels
        if motion.plane is None or motion.taxels is not taxels:
            motion.taxels, motion.plane = taxels, self._plane.take(taxels, axis=0)
        plane = motion.plane
        change, fast_x, fast_y = self.high_passed[taxels].dot(plane).tolist()
        total, slow_x, slow_y = force[taxels].dot(plane).tolist()
        total = total if total > 1e-9 else 1e-9
        motion.power += -math.expm1(-step / POWER_TIME_CONSTANT) * (change * change - motion.power)
        # The centre is that of these taxels alone, not the contact's centre of pressure.
        share = change / total
        moment = math.hypot(fast_x - share * slow_x, fast_y - share * slow_y)
        per_speed = total / (2.0 * math.pi * CORNER_FREQUENCY)
        if (
            moment > SLIP_SPEED * per_speed
            and moment > self._lever * abs(change)
            and abs(share) < ONSET_SHARE
            and moment > self._noise_moment(region)
        ):
            motion.slipping, motion.still = True, 0.0
        elif motion.slipping and moment < max(SLIP_END_SPEED * per_speed, 0.5 * self._noise_moment(region)):
            motion.still += step
            motion.slipping = motion.still < SLIP_END_TIME
        return motion

    def _noise_moment(self, region: Region) -> float:
        """Return the moment of a contact that noise may cause [N m]."""
        extent = math.hypot(*region.major_axis) + math.hypot(*region.minor_axis)
        return SLIP_NOISE_DEVIATIONS * self._noise * extent * math.sqrt(len(region.taxels))


def _high_pass(step: float) -> tuple[float, float]:
    """Return the high-pass factors of the last value and of a change at a constant rate over a step [s]."""
    passed = 2.0 * math.pi * CORNER_FREQUENCY * step
    decay = math.exp(-passed)
    return decay, (1.0 - decay) / passed
