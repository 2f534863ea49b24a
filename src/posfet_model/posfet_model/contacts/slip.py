"""The fast channel beside the slow one: vibration of each taxel, and slip of each contact as it begins.

It is the change of force from scan to scan through a high pass of one pole, so that no error of a zero is left in it.

A contact slips when its centre moves faster than a hand would move it. With y the high-passed force of a taxel at x, a
centre c and time constant T of the high pass, a distribution F that moves at v gives ``sum((x - c)*y) = F*v*T``. A
press or a vibration changes F, but hardly its shape: there the same sum is next to nothing beside ``sum(y)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.contacts.detection import Region
from posfet_model.contacts.tracker import Contact, ContactState
from posfet_model.sensor.description import Layout

CORNER: Final = 50.0
"""Corner of the high pass [Hz]."""

MEMORY: Final = 0.01
"""Time constant with which the power of a vibration is averaged [s]."""

SLIP_SPEED: Final = 10e-3
"""A contact slips from this speed on [m/s], assumed."""

STILL_SPEED: Final = 5e-3
"""It slips no more below this speed [m/s], assumed."""

SLIP_ENDS: Final = 0.01
"""Once it has been still for this long [s]."""

SLIP_GUARD: Final = 6.0
"""Standard deviations of noise that are no slip [1]."""

LEVER: Final = 0.5
"""Least distance between the centre of what changes and that of the contact [pitch]: a press changes about it."""

LANDS: Final = 0.15
"""A contact whose high-passed force is more than this share of its force lands or lifts, and does not slip [1]."""


@dataclass(slots=True)
class Motion:
    """What the fast channel knows of one contact."""

    power: float = 0.0
    """Mean square of its high-passed force [N2]."""
    slipping: bool = False
    still: float = 0.0
    """For how long it has not been slipping [s]."""
    taxels: NDArray[np.intp] | None = None
    """Its taxels, as long as they stay the same object."""
    plane: NDArray[np.float64] | None = None
    """What is known of where they are."""

    @property
    def vibration(self) -> float:
        """Root mean square of the contact's force above the corner [N]."""
        return math.sqrt(self.power)


class FastChannel:
    """High-passed force of every taxel, while `advance` is called scan by scan; begins anew after a `pause`."""

    def __init__(self, layout: Layout, noise: float) -> None:
        """Take the array and the noise of a reading [N]."""
        x, y = layout.positions.T
        self._plane = np.stack([np.ones(layout.taxels), x, y], axis=1)
        self._lever = LEVER * max(layout.pitch_x, layout.pitch_y)
        self._noise = noise
        self._passed = np.zeros(layout.taxels)
        self._square = np.zeros(layout.taxels)
        self._running = False
        self._motions: dict[int, Motion] = {}
        self.fast = np.zeros(layout.taxels)
        """High-passed force of each taxel [N], shape [rows * cols]."""
        self.power = np.zeros(layout.taxels)
        """Mean square of it [N2], as far as `average` was called."""

    def pause(self) -> None:
        """Take note that scans are left out from here on."""
        if self._running:
            self._running = False
            self.fast[:] = 0.0
            self.power[:] = 0.0
            self._motions.clear()

    def advance(self, change: NDArray[np.float64], step: float) -> None:
        """Take by how much each force changed [N] in a step [s], shape [rows * cols]; the first one is left out."""
        if self._running:
            decay, share = _high_pass(step)
            fast = self.fast
            fast *= decay
            fast += np.multiply(change, share, out=self._passed)
        self._running = True

    def average(self, step: float) -> None:
        """Let the power of each taxel follow its vibration over a step [s]."""
        np.multiply(self.fast, self.fast, out=self._square)
        self._square -= self.power
        self._square *= -math.expm1(-step / MEMORY)
        self.power += self._square

    def follow(self, contacts: Sequence[Contact], force: NDArray[np.float64], step: float) -> dict[int, Motion]:
        """Return the motion of each contact by its id; those that were released have none.

        force [N] is that of all taxels, shape [rows * cols].
        """
        motions: dict[int, Motion] = {}
        for contact in contacts:
            if contact.state is not ContactState.RELEASED:
                motions[contact.id] = self._of(contact.region, force, self._motions.get(contact.id) or Motion(), step)
        self._motions = motions
        return motions

    def _of(self, region: Region, force: NDArray[np.float64], motion: Motion, step: float) -> Motion:
        taxels = region.taxels
        if motion.plane is None or motion.taxels is not taxels:
            motion.taxels, motion.plane = taxels, self._plane.take(taxels, axis=0)
        plane = motion.plane
        change, fast_x, fast_y = self.fast[taxels].dot(plane).tolist()
        total, slow_x, slow_y = force[taxels].dot(plane).tolist()
        total = total if total > 1e-9 else 1e-9
        motion.power += -math.expm1(-step / MEMORY) * (change * change - motion.power)
        # The centre is that of these taxels alone, without what else is known of the contact.
        share = change / total
        moment = math.hypot(fast_x - share * slow_x, fast_y - share * slow_y)
        per_speed = total / (2.0 * math.pi * CORNER)
        if (
            moment > SLIP_SPEED * per_speed
            and moment > self._lever * abs(change)
            and abs(share) < LANDS
            and moment > self._noise_of(region)
        ):
            motion.slipping, motion.still = True, 0.0
        elif motion.slipping and moment < max(STILL_SPEED * per_speed, 0.5 * self._noise_of(region)):
            motion.still += step
            motion.slipping = motion.still < SLIP_ENDS
        return motion

    def _noise_of(self, region: Region) -> float:
        """Return up to what moment [N m] noise is no slip of a contact."""
        reach = math.hypot(*region.major_axis) + math.hypot(*region.minor_axis)
        return SLIP_GUARD * self._noise * reach * math.sqrt(len(region.taxels))


@lru_cache(maxsize=64)
def _high_pass(step: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return which share of the last value is left after a step [s], and of a change that came evenly during it.

    Kept, as a board repeats few different steps, and as arrays, which cost less than numbers beside other arrays.
    """
    passed = 2.0 * math.pi * CORNER * step
    decay = math.exp(-passed)
    return np.array(decay), np.array((1.0 - decay) / passed)
