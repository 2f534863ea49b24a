"""YAML files with checked keys: a missing, unknown or invalid key gives an error of one line that names it."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import yaml

from posfet_model._lib.validation import interval


class ConfigError(ValueError):
    """Raised for a file or parameter that cannot be used.

    The message is one line with the source, the key, what is allowed and what was found.
    """


# The parser in C takes a tenth of the time, which saves 20 ms at start-up; not every build of PyYAML has it.
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _UniqueKeyLoader(_SafeLoader):  # type: ignore[misc]  # known at run time only
    """SafeLoader that raises an error for a repeated key instead of keeping the last value."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[object] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.MarkedYAMLError(problem=f"key {key!r} is not text", problem_mark=key_node.start_mark)
            if key in seen:
                raise yaml.MarkedYAMLError(problem=f"key '{key}' is given twice", problem_mark=key_node.start_mark)
            seen.add(key)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


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
            raise self.error("", f"must be a mapping of keys to values, got {_shown(value)}")
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
        return ConfigError(f"{self.source}: {path}: {reason}" if path else f"{self.source}: {reason}")

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
            raise self.error(name, f"must be {expected}, got {_shown(value)}")
        return tuple(self._checked_number(name, item, low, high, False, expected) for item in value)

    def _checked_number(
        self, name: str, value: object, low: float, high: float, exclusive: bool, expected: str
    ) -> float:
        if isinstance(value, str) and _reads_as_number(value):
            raise self.error(name, f"must be {expected}, got the text '{value}' (YAML wants a point: 1.0e-3)")
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= sys.float_info.max:
            raise self.error(name, f"must be {expected}, got {_shown(value)}")
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
            raise self.error(name, f"must be {expected}, got {_shown(value)}")
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
            raise self.error(name, f"must be {expected}, got {_shown(value)}")
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
            raise self.error(name, f"must be true or false, got {_shown(value)}")
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
            raise self.error(name, f"must be {expected}, got {_shown(value)}")
        if not value.strip().isprintable():
            raise self.error(name, f"must be one line of plain text, got {_shown(value)}")
        return value.strip()

    def section(self, name: str) -> Section:
        """Return a mapping."""
        value = self._take(name, _REQUIRED, "a mapping of keys to values")
        return Section(self.source, ".".join(part for part in (self.key, name) if part), value)

    def sections(self, name: str) -> list[Section]:
        """Return a list of mappings."""
        value = self._take(name, _REQUIRED, "a list of mappings")
        if not isinstance(value, list):
            raise self.error(name, f"must be a list of mappings, got {_shown(value)}")
        prefix = f"{self.key}." if self.key else ""
        return [Section(self.source, f"{prefix}{name}[{index}]", item) for index, item in enumerate(value)]

    def end(self) -> None:
        """Raise ConfigError if a key has not been read."""
        if self._values:
            name = sorted(self._values)[0]
            raise self.error(name, f"unknown key, known here are {', '.join(self._known)}")


def _shown(value: object) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _reads_as_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_yaml(path: str | Path) -> Section:
    """Return the top-level mapping of a YAML file.

    Parameters
    ----------
    path : str or Path
        Path of the file.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not valid YAML, or has a repeated key.
    """
    if Path(path).is_char_device() or Path(path).is_fifo():  # reading these may never end
        raise ConfigError(f"{path}: cannot be read: not a regular file")
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise ConfigError(f"{Path(path)}: cannot be read: {reason}") from error
    try:
        value = yaml.load(text, _UniqueKeyLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        raise ConfigError(f"{path}: is not valid YAML: {error.problem}{place}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # an impossible date, a bad tag, recursive nesting
        raise ConfigError(f"{path}: is not valid YAML: {' '.join(str(error).split())}") from error
    return Section(str(path), "", value)


def find_file(name: str, folder: Path, kind: str) -> Path:
    """Return the path of a YAML file.

    Parameters
    ----------
    name : str
        Path of a file, or bare name of a shipped one.
    folder : Path
        Folder of the shipped files.
    kind : str
        What the file describes, for the error message.

    Raises
    ------
    ConfigError
        If there is no such file; the message lists the shipped ones.
    """
    path = Path(name).expanduser()
    if path.suffix or path.parent != Path():
        if not path.is_file():
            raise ConfigError(f"{name}: no such {kind} file")
        return path
    shipped = folder / f"{name}.yaml"
    if not shipped.is_file():
        names = ", ".join(sorted(entry.stem for entry in folder.glob("*.yaml")))
        raise ConfigError(f"{name}: no such {kind}; give the path of a YAML file or one of {names}")
    return shipped
