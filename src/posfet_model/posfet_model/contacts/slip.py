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

Compiled: `posfet_core`, slip.hpp.
"""

from __future__ import annotations

from typing import Final

from posfet_core import scan_path
from posfet_core.contact import Motion
from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import compiled_layout

__all__ = ["CORNER_FREQUENCY", "POWER_TIME_CONSTANT", "SLIP_END_SPEED", "SLIP_SPEED", "DynamicChannel", "Motion"]

CORNER_FREQUENCY: Final = scan_path.CORNER_FREQUENCY
"""Corner frequency of the high-pass [Hz]."""

POWER_TIME_CONSTANT: Final = scan_path.POWER_TIME_CONSTANT
"""Time constant of the average of a vibration's power [s]."""

SLIP_SPEED: Final = scan_path.SLIP_SPEED
"""A contact slips from this speed on [m/s], assumed."""

SLIP_END_SPEED: Final = scan_path.SLIP_END_SPEED
"""A slip ends below this speed [m/s], assumed."""


class DynamicChannel(scan_path.DynamicChannel):
    """High-passed force of every taxel, updated by `advance` for each scan; restarts after a `pause`.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    noise : float
        Standard deviation of a reading [N].
    """

    def __init__(self, layout: Layout, noise: float) -> None:
        super().__init__(compiled_layout(layout), noise)
