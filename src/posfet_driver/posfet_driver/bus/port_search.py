"""Finds the adapter: a channel may be a pattern, and an adapter that comes back is noticed before the next attempt."""

from __future__ import annotations

import glob
import os
from dataclasses import replace
from typing import Final

import can

from posfet_driver.bus import socketcan_bus
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import PLAIN_SLCAN, SLCAN, BusSettings, one_line, open_bus

WILDCARDS: Final = "*?["
_SERIAL: Final = {SLCAN, PLAIN_SLCAN}


class BusOpener:
    """Opens the bus that settings describe; with wildcards in the channel, the ports that match, one after the other.

    An adapter that is unplugged and comes back often has another name: `/dev/ttyACM*` finds it again.
    """

    def __init__(self, settings: BusSettings) -> None:
        self.settings = settings
        self.channel = settings.channel
        """The channel that was opened last."""

    def __call__(self) -> FrameBus:
        """Open the next port that can be opened.

        Raises can.CanError, one line, when none can be opened now; ConfigError when none ever can.
        """
        ports = self.ports()
        if not ports:
            raise can.CanInitializationError(f"{self.settings.interface}: no port matches {self.settings.channel}")
        # The one after the last first: the board did not answer there, or it is gone.
        start = ports.index(self.channel) + 1 if self.channel in ports else 0
        reasons = []
        for port in ports[start:] + ports[:start]:
            try:
                bus = open_bus(replace(self.settings, channel=port))
            except can.CanError as error:
                reasons.append(one_line(error))
                continue
            self.channel = port
            return bus
        raise can.CanInitializationError("; ".join(reasons))

    def ports(self) -> list[str]:
        """Return the channels that the settings name now."""
        channel = self.settings.channel
        if self.settings.interface in _SERIAL and any(letter in channel for letter in WILDCARDS):
            return sorted(glob.glob(channel))
        return [channel]

    def presence(self) -> object:
        """Return something that differs when an adapter came, went or was switched: reason to try at once."""
        if self.settings.interface in _SERIAL:
            return tuple(_identity(port) for port in self.ports())
        return socketcan_bus.presence(self.settings.channel)


def _identity(port: str) -> tuple[int, ...]:
    try:
        link, target = os.lstat(port), os.stat(port)
    except OSError:
        return ()
    return link.st_ino, link.st_ctime_ns, target.st_ino, target.st_rdev
