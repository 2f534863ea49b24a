# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Finds the adapter: the channel may be a pattern, and a reconnected adapter is detected before the next attempt."""

from __future__ import annotations

import glob
import os
from dataclasses import replace
from typing import Final

import can

from posfet_driver.bus import can_interface
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.frame import BoardFrames
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import PLAIN_SLCAN, SLCAN, BusSettings, open_bus

WILDCARDS: Final = "*?["
_SERIAL: Final = {SLCAN, PLAIN_SLCAN}


class BusOpener:
    """Opens a bus; with wildcards in the channel, the next of the ports that match.

    An adapter that is unplugged and reconnected often has another name: `/dev/ttyACM*` finds it again.

    Parameters
    ----------
    settings : BusSettings
        The bus.
    board : BoardFrames, optional
        The only board that the bus is read for; by default every frame is received.
    """

    def __init__(self, settings: BusSettings, board: BoardFrames | None = None) -> None:
        self.settings = settings
        self._board = board
        self.channel = settings.channel
        """Channel that was opened last."""

    def __call__(self) -> FrameBus:
        """Open the next port that can be opened.

        Returns
        -------
        FrameBus
            The open bus.

        Raises
        ------
        can.CanError
            When none can be opened now; one line.
        ConfigError
            When none can ever be opened.
        """
        ports = self.ports()
        if not ports:
            raise can.CanInitializationError(f"{self.settings.interface}: no port matches {self.settings.channel}")
        # Begin after the last one: the board did not respond there, or the adapter was disconnected.
        start = ports.index(self.channel) + 1 if self.channel in ports else 0
        reasons = []
        for port in ports[start:] + ports[:start]:
            try:
                bus = open_bus(replace(self.settings, channel=port), self._board)
            except can.CanError as error:
                reasons.append(one_line(error))
                continue
            self.channel = port
            return bus
        raise can.CanInitializationError("; ".join(reasons))

    def ports(self) -> list[str]:
        """Return the channels that match the settings now."""
        channel = self.settings.channel
        if self.settings.interface in _SERIAL and any(letter in channel for letter in WILDCARDS):
            return sorted(glob.glob(channel))
        return [channel]

    def presence(self) -> object:
        """Return a value that changes when an adapter is connected, removed or switched: a reason to retry at once."""
        if self.settings.interface in _SERIAL:
            return tuple(_identity(port) for port in self.ports())
        return can_interface.presence(self.settings.channel)


def _identity(port: str) -> tuple[int, ...]:
    try:
        link, target = os.lstat(port), os.stat(port)
    except OSError:
        return ()
    return link.st_ino, link.st_ctime_ns, target.st_ino, target.st_rdev
