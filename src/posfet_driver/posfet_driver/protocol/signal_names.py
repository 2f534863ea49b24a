# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The messages and signals of a DBC file, found by the names in a sensor file; errors are one line."""

from __future__ import annotations

import difflib
import importlib
from dataclasses import dataclass
from typing import Any, Final

from posfet_model._lib.shown import one_line
from posfet_model.config import ConfigError
from posfet_model.files import read_bytes
from posfet_model.sensor.frame_mapping import FrameMapping

MAX_FILE: Final = 8_000_000
"""Largest size of a DBC file [byte]."""


@dataclass(frozen=True)
class Found:
    """A signal in its message, both of cantools."""

    message: Any
    signal: Any

    @property
    def name(self) -> str:
        """Full name."""
        return f"{self.message.name}.{self.signal.name}"


class SignalNames:
    """The DBC file of a mapping.

    Parameters
    ----------
    mapping : FrameMapping
        The section of the sensor file.

    Raises
    ------
    ConfigError
        When cantools is not installed, or the file cannot be read or is not a valid DBC. Every method raises it for a
        name that the file has not, or that is ambiguous.
    """

    def __init__(self, mapping: FrameMapping) -> None:
        self._mapping = mapping
        self._messages = {message.name: message for message in _load(mapping).messages}
        self._found: dict[str, list[Found]] = {}
        for message in self._messages.values():
            for signal in message.signals:
                self._found.setdefault(signal.name, []).append(Found(message, signal))

    def message(self, key: str, name: str) -> Any:
        """Return the message of a name.

        Parameters
        ----------
        key : str
            Key of the mapping, for error messages.
        name : str
            Name of the message.
        """
        if name not in self._messages:
            raise self._unknown(key, "message", name, self._messages)
        return self._messages[name]

    def all(self, key: str, name: str) -> list[Found]:
        """Return the signals of a name, one in each message that has it; with `Message.Signal` the one.

        Parameters
        ----------
        key : str
            Key of the mapping, for error messages.
        name : str
            Name of the signal.
        """
        message, _, signal = name.rpartition(".")
        found = self._found.get(signal, [])
        if message:
            self.message(key, message)
            found = [item for item in found if item.message.name == message]
        if not found:
            raise self._unknown(key, "signal", name, self._found)
        return found

    def one(self, key: str, name: str) -> Found:
        """Return the signal of a name that only one message has.

        Parameters
        ----------
        key : str
            Key of the mapping, for error messages.
        name : str
            Name of the signal.
        """
        found = self.all(key, name)
        if len(found) > 1:
            names = ", ".join(item.name for item in found[:4])
            raise self._mapping.error(key, f"signal '{name}' is in several messages, write one of {names}")
        return found[0]

    def _unknown(self, key: str, kind: str, name: str, known: Any) -> ConfigError:
        close = difflib.get_close_matches(name.rpartition(".")[2], known, 1)
        hint = f"; did you mean '{close[0]}'?" if close else ""
        return self._mapping.error(key, f"{self._mapping.dbc.name} has no {kind} '{name}'{hint}")


def _load(mapping: FrameMapping) -> Any:
    path = mapping.dbc
    try:
        database = importlib.import_module("cantools.database")
    except ImportError as error:
        raise mapping.error("dbc", "needs the package cantools: pip install cantools") from error
    try:
        content = read_bytes(path, MAX_FILE)
    except OSError as error:
        raise mapping.error("dbc", f"{path} cannot be read: {error.strerror}") from error
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")  # as most tools write it
    try:
        return database.load_string(text, "dbc")
    except Exception as error:  # cantools raises KeyError, ValueError and its own for a file that is no DBC
        reason = one_line(str(error)) or type(error).__name__
        raise mapping.error("dbc", f"{path.name} is not a valid DBC file: {reason}") from error
