# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""YAML files with checked keys: a missing, unknown or invalid key gives an error of one line that names it."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final

from posfet_model import files
from posfet_model._lib.shown import interval, one_line, shown
from posfet_model.plain_yaml import YamlError, parse


class ConfigError(ValueError):
    """Raised for a file or parameter that cannot be used.

    The message is one line with the source, the key, what is allowed and what was found.
    """


MAX_FILE: Final = 256_000
"""Largest size of a sensor, scene, trajectory or parameter file [byte]; a calibration grows with the array."""

MAX_TEXT: Final = 1000
"""Largest length of a text in a file."""

MAX_KNOWN: Final = 14
"""Most keys that an error lists."""

MAX_KEY: Final = 200
"""Largest length of a key in an error, with those of the sections that it is in."""

_REQUIRED: Final = object()


class Section:
    """One mapping of a YAML file, read key by key.

    Each method removes its key; `end` then raises an error if a key is left.

    Parameters
    ----------
    source : str
        File name for error messages.
    key : str
        Path of the mapping in the file, '' for the top level.
    value : object
        The mapping as YAML gives it.

    Raises
    ------
    ConfigError
        If `value` is not a mapping. Every method raises it for a missing key without a default, and for a value that is
        not allowed.
    """

    def __init__(self, source: str, key: str, value: object) -> None:
        self.source = source
        self.key = key
        if not isinstance(value, dict):
            raise self.error("", f"must be a mapping of keys to values, got {shown(value)}")
        self._values: dict[str, object] = dict(value)
        self._known: dict[str, None] = {}  # in order

    def error(self, name: str, reason: str) -> ConfigError:
        """Return the error for the key `name` of this section, '' for the section itself.

        Parameters
        ----------
        name : str
            Key, or '' for the section itself.
        reason : str
            What is wrong.
        """
        path = ".".join(part for part in (self.key, name) if part)
        return ConfigError(": ".join(part for part in (one_line(self.source), one_line(path, MAX_KEY), reason) if part))

    def __contains__(self, name: str) -> bool:
        self._known[name] = None
        return name in self._values

    def names(self) -> list[str]:
        """Return the keys that have not been read yet."""
        return list(self._values)

    def _take(self, name: str, default: object, expected: str) -> object:
        self._known[name] = None
        if name in self._values:
            return self._values.pop(name)
        if default is _REQUIRED:
            raise self.error(name, f"missing, must be {expected}")
        return default

    def value(self, name: str, expected: str, *, default: object = _REQUIRED) -> object:
        """Return what YAML gives for a key, for a reader that checks it.

        Parameters
        ----------
        name : str
            Key of the section.
        expected : str
            What it must be, for the error of a missing key.
        default : object, optional
            Value of a missing key; default: the key is required.
        """
        return self._take(name, default, expected)

    def number(
        self,
        name: str,
        low: float = -math.inf,
        high: float = math.inf,
        *,
        exclusive: bool = False,
        default: object = _REQUIRED,
    ) -> float:
        """Return a finite number in [low, high], or in (low, high) with `exclusive`.

        Parameters
        ----------
        name : str
            Key of the section.
        low : float, optional
            Lower end of the range.
        high : float, optional
            Upper end of the range.
        exclusive : bool, optional
            Whether the ends are excluded.
        default : object, optional
            Value of a missing key; default: the key is required.
        """
        expected = f"a number in {interval(low, high, exclusive)}"
        return self._checked_number(name, self._take(name, default, expected), low, high, exclusive, expected)

    def numbers(self, name: str, count: int, low: float = -math.inf, high: float = math.inf) -> tuple[float, ...]:
        """Return a list of `count` finite numbers, each in [low, high].

        Parameters
        ----------
        name : str
            Key of the section.
        count : int
            Length of the list.
        low : float, optional
            Lower end of the range.
        high : float, optional
            Upper end of the range.
        """
        expected = f"a list of {count} numbers in {interval(low, high)}"
        value = self._take(name, _REQUIRED, expected)
        if not isinstance(value, list) or len(value) != count:
            raise self.error(name, f"must be {expected}, got {shown(value)}")
        return tuple(self._checked_number(name, item, low, high, False, expected) for item in value)

    def _checked_number(
        self, name: str, value: object, low: float, high: float, exclusive: bool, expected: str
    ) -> float:
        if isinstance(value, str) and _reads_as_number(value):
            raise self.error(name, f"must be {expected}, got the text {shown(value)} (YAML wants a point: 1.0e-3)")
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= sys.float_info.max:
            raise self.error(name, f"must be {expected}, got {shown(value)}")
        if not (low < value < high if exclusive else low <= value <= high):
            raise self.error(name, f"must be {expected}, got {value:g}")
        return float(value)

    def whole(self, name: str, low: int, high: int, *, default: object = _REQUIRED) -> int:
        """Return a whole number in [low, high].

        Parameters
        ----------
        name : str
            Key of the section.
        low : int
            Lower end of the range.
        high : int
            Upper end of the range.
        default : object, optional
            Value of a missing key; default: the key is required.
        """
        expected = f"a whole number in [{low}, {high}]"
        value = self._take(name, default, expected)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.error(name, f"must be {expected}, got {shown(value)}")
        return value

    def wholes(self, name: str, low: int, high: int) -> list[int]:
        """Return a list of any length of whole numbers, each in [low, high].

        Parameters
        ----------
        name : str
            Key of the section.
        low : int
            Lower end of the range.
        high : int
            Upper end of the range.
        """
        expected = f"a list of whole numbers in {interval(low, high)}"
        value = self._take(name, _REQUIRED, expected)
        if not isinstance(value, list) or any(
            isinstance(item, bool) or not isinstance(item, int) or not low <= item <= high for item in value
        ):
            raise self.error(name, f"must be {expected}, got {shown(value)}")
        return list(value)

    def flag(self, name: str, *, default: object = _REQUIRED) -> bool:
        """Return true or false.

        Parameters
        ----------
        name : str
            Key of the section.
        default : object, optional
            Value of a missing key; default: the key is required.
        """
        value = self._take(name, default, "true or false")
        if not isinstance(value, bool):
            raise self.error(name, f"must be true or false, got {shown(value)}")
        return value

    def text(self, name: str, choices: Sequence[str] = (), *, default: object = _REQUIRED) -> str:
        """Return a text of one line without surrounding spaces; one of `choices` if any are given.

        Parameters
        ----------
        name : str
            Key of the section.
        choices : sequence of str, optional
            Allowed values; none: any text.
        default : object, optional
            Value of a missing key; default: the key is required.
        """
        expected = f"one of {', '.join(choices)}" if choices else "text"
        value = self._take(name, default, expected)
        if not isinstance(value, str) or (choices and value not in choices):
            raise self.error(name, f"must be {expected}, got {shown(value)}")
        if not value.strip().isprintable():
            raise self.error(name, f"must be one line of plain text, got {shown(value)}")
        if len(value) > MAX_TEXT:
            raise self.error(name, f"must be a text of at most {MAX_TEXT} characters, got {len(value)}")
        return value.strip()

    def texts(self, name: str) -> tuple[str, ...]:
        """Return one or several texts: a list of texts that are not empty, or a text in place of a list of one."""
        expected = "a text or a list of texts"
        value = self._take(name, _REQUIRED, expected)
        items = value if isinstance(value, list) else [value]
        if not items or not all(isinstance(item, str) and item.strip() and item.isprintable() for item in items):
            raise self.error(name, f"must be {expected}, each of one line and not empty")
        return tuple(item.strip() for item in items if isinstance(item, str))

    def is_mapping(self, name: str) -> bool:
        """Return whether the value of a key is a mapping; False without the key."""
        return isinstance(self._values.get(name), dict)

    def section(self, name: str) -> Section:
        """Return a mapping."""
        value = self._take(name, _REQUIRED, "a mapping of keys to values")
        return Section(self.source, ".".join(part for part in (self.key, name) if part), value)

    def sections(self, name: str) -> list[Section]:
        """Return a list of mappings."""
        value = self._take(name, _REQUIRED, "a list of mappings")
        if not isinstance(value, list):
            raise self.error(name, f"must be a list of mappings, got {shown(value)}")
        prefix = f"{self.key}." if self.key else ""
        return [Section(self.source, f"{prefix}{name}[{index}]", item) for index, item in enumerate(value)]

    def end(self) -> None:
        """Raise ConfigError if a key has not been read."""
        if self._values:
            name = sorted(self._values)[0]
            raise self.error(name, f"unknown key, {known_instead(name, self._known)}")


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the question for the most similar of known names, with a space at the end; '' if none is similar."""
    from difflib import get_close_matches  # noqa: PLC0415  # good input needs it never

    close = get_close_matches(name, list(known), n=1, cutoff=0.7)
    return f"did you mean {close[0]}? " if close else ""


def known_instead(name: str, known: Iterable[str]) -> str:
    """Return what an error says about a name that is not known: the most similar one, and a few of all.

    Parameters
    ----------
    name : str
        The name.
    known : iterable of str
        Names that are known.
    """
    names = list(known)
    meant = did_you_mean(name, names)
    others = len(names) - MAX_KNOWN
    return f"{meant}known here are {', '.join(names[:MAX_KNOWN])}" + (f" and {others} others" if others > 0 else "")


def _reads_as_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_text(path: str | Path, limit: int = MAX_FILE) -> str:
    """Return the text of a regular file in UTF-8.

    Parameters
    ----------
    path : str or Path
        Path of the file.
    limit : int, optional
        Largest size [byte].

    Raises
    ------
    ConfigError
        If the file cannot be read, is not regular, is larger, or is not UTF-8 text.
    """
    try:
        return files.read_text(path, limit)
    except OSError as error:
        raise ConfigError(f"{one_line(str(path))}: cannot be read: {error.strerror}") from error


def write_text(path: str | Path, text: str) -> None:
    """Write a file in UTF-8 that is complete or not there.

    Parameters
    ----------
    path : str or Path
        Path of the file; an existing one is replaced.
    text : str
        Content.

    Raises
    ------
    ConfigError
        If the file cannot be written; an existing one is then unchanged.
    """
    try:
        files.write_text(path, text)
    except OSError as error:
        raise ConfigError(f"{one_line(str(path))}: cannot be written: {error.strerror}") from error


def read_yaml(path: str | Path, limit: int = MAX_FILE, *, may_be_empty: bool = False) -> Section:
    """Return the top-level mapping of a YAML file.

    Parameters
    ----------
    path : str or Path
        Path of the file.
    limit : int, optional
        Largest size [byte].
    may_be_empty : bool, default False
        Whether a file without a key is a mapping without one; otherwise it is refused.

    Raises
    ------
    ConfigError
        If the file cannot be read, or `plain_yaml.parse` refuses it.
    """
    text = read_text(path, limit)
    try:
        value = _parsed(text)
    except YamlError as error:
        raise ConfigError(f"{one_line(str(path))}: is not valid YAML: {one_line(str(error))}") from error
    return Section(str(path), "", {} if value is None and may_be_empty else value)


@lru_cache(maxsize=4)
def _parsed(text: str) -> object:
    """Return the value of a YAML text, which nobody may change: the nodes of one process read the same files."""
    return parse(text)


def find_file(name: str, folder: Path, kind: str, listed: str = "") -> Path:
    """Return the path of a YAML file.

    Parameters
    ----------
    name : str
        Path of a file, or bare name of a shipped one.
    folder : Path
        Folder of the shipped files.
    kind : str
        What the file describes, for the error message.
    listed : str
        Where the shipped ones are listed, for the error message; '': it lists them itself.

    Raises
    ------
    ConfigError
        If there is no such file; the message names a similar one, and lists the shipped ones or says where they are
        listed.
    """
    path = expanded(name)
    if path.suffix or path.parent != Path():
        if not is_there(path):
            raise ConfigError(f"{one_line(name)}: no such {kind} file")
        return path
    shipped = folder / f"{name}.yaml"
    if not is_there(shipped):
        names = sorted(entry.stem for entry in folder.glob("*.yaml"))
        meant = did_you_mean(name, names)
        shown = f"a shipped {kind} ({listed})" if listed else f"one of {', '.join(names)}"
        raise ConfigError(f"{one_line(name)}: no such {kind}; {meant}give the path of a YAML file or {shown}")
    return shipped


def expanded(path: str) -> Path:
    """Return a path with ~ replaced by the home of its user. Raises ConfigError if there is no such user."""
    try:
        return Path(path).expanduser()
    except RuntimeError as error:
        raise ConfigError(f"{one_line(path)}: there is no such home folder") from error


def is_there(path: Path) -> bool:
    """Return whether there is a file, or what `read_text` refuses with a better reason; False for a folder."""
    try:
        return path.exists() and not path.is_dir()
    except OSError:  # such as a name that is too long
        return False
