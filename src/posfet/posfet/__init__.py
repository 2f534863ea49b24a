# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""POSFET tactile arrays in Python: a simulated board, a real one or a recording as forces and contacts; no ROS needed.

>>> import posfet
>>> session = posfet.simulate("press_slide_lift")  # or posfet.open("slcan:/dev/ttyACM0"), posfet.replay("grasp.mcap")
>>> image = next(session.images())
>>> image.force.shape
(5, 5)

`posfet.gym` is a gymnasium environment of a grasp. The command `posfet` is in `posfet.cli`. Everything is imported on
first use, so that ``import posfet`` itself loads nothing else.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from posfet.sessions.arrays import Arrays
    from posfet.sessions.frames import Contact, Contacts, Frame, GroundTruth, Image, Wrench
    from posfet.sessions.session import Session
    from posfet.sessions.start import load, replay, simulate
    from posfet.sessions.start import open_board as open
    from posfet_driver.board.scan_source import SourceError
    from posfet_model import ConfigError, __version__
    from posfet_model.contacts.tracker import ContactState

__all__ = [
    "Arrays",
    "ConfigError",
    "Contact",
    "ContactState",
    "Contacts",
    "Frame",
    "GroundTruth",
    "Image",
    "Session",
    "SourceError",
    "Wrench",
    "__version__",
    "load",
    "open",
    "replay",
    "simulate",
]

_HOME: Final = {
    "Arrays": "posfet.sessions.arrays",
    "ConfigError": "posfet_model.config",
    "Contact": "posfet.sessions.frames",
    "ContactState": "posfet_model.contacts.tracker",
    "Contacts": "posfet.sessions.frames",
    "Frame": "posfet.sessions.frames",
    "GroundTruth": "posfet.sessions.frames",
    "Image": "posfet.sessions.frames",
    "Session": "posfet.sessions.session",
    "SourceError": "posfet_driver.board.scan_source",
    "Wrench": "posfet.sessions.frames",
    "__version__": "posfet_model",
    "load": "posfet.sessions.start",
    "open": "posfet.sessions.start",
    "replay": "posfet.sessions.start",
    "simulate": "posfet.sessions.start",
}
"""Module in which each name is defined."""
_RENAMED: Final = {"open": "open_board"}
"""Names of what would hide a built-in function in its module."""


def __getattr__(name: str) -> Any:
    """Import a name on first use. Raises AttributeError for any other name."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), _RENAMED.get(name, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
