# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""How the signals of a DBC file map to scans: the section `protocol` of a sensor file, for boards with own frames."""

from __future__ import annotations

import re
import string
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from posfet_model.config import ConfigError, Section
from posfet_model.sensor.scan import TEMPERATURE_SENSORS, ScanStatus

TIME_UNITS: Final = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
"""Units of a board's time [ns]."""
FLAGS: Final = {
    flag.name.lower(): flag
    for flag in (ScanStatus.SUPPLY_LOW, ScanStatus.ADC_FAULT, ScanStatus.OVERTEMPERATURE, ScanStatus.SCAN_OVERRUN)
    if flag.name
}
"""Flags that a status signal can set."""

_WIDTH: Final = re.compile(r"0?[0-9]?")  # of a number in a pattern
_NAME: Final = re.compile(r"\w+(\.\w+)?")


@dataclass(frozen=True)
class FrameMapping:
    """Messages and signals of a board.

    A signal is named `Signal` or, where several messages have it, `Message.Signal`.
    """

    source: str
    """Sensor file, for error messages."""
    dbc: Path
    """DBC file."""
    counts: tuple[str, ...]
    """Signal of each taxel, row by row; with `block` that of each place in a frame."""
    block: str
    """Signal that numbers the frames of a scan: taxel = block * len(counts) + place; '': none."""
    sequence: tuple[str, ...]
    """Signals that count scans; empty: none."""
    time: tuple[str, ...]
    """Signals with the time of acquisition on the board's clock; empty: none."""
    time_unit: str
    """Key of TIME_UNITS; '': as in the DBC."""
    temperatures: tuple[str, ...]
    """Signals of the chip's temperature sensors [degC]."""
    status: tuple[tuple[str, ScanStatus], ...]
    """Signals that set a flag when they are not 0."""
    order: tuple[str, ...]
    """Messages of a scan in the order of sending; empty: in the order of their taxels."""

    def error(self, key: str, reason: str) -> ConfigError:
        """Return the error for a key of the section `protocol`, in one line.

        Parameters
        ----------
        key : str
            The key.
        reason : str
            What is wrong.
        """
        return ConfigError(f"{self.source}: protocol.{key}: {reason}")


def read_mapping(section: Section, rows: int, cols: int) -> FrameMapping:
    """Return the mapping of the section `protocol` of a sensor file.

    Parameters
    ----------
    section : Section
        The section.
    rows : int
        Number of rows of the array.
    cols : int
        Number of columns.

    Raises
    ------
    ConfigError
        For a key that is missing, unknown, or not as described in docs/own-frames.md. Whether the signals exist is
        known when the DBC file is read, by the driver.
    """
    dbc = Path(section.text("dbc")).expanduser()
    block = _name(section, "block", section.text("block", default=""))
    first = section.whole("numbered_from", 0, 1, default=0)
    mapping = FrameMapping(
        source=section.source,
        dbc=Path(section.source).parent / dbc,
        counts=_counts(section, rows, cols, first, bool(block)),
        block=block,
        sequence=_names(section, "sequence"),
        time=_names(section, "time"),
        time_unit=section.text("time_unit", tuple(TIME_UNITS)) if "time_unit" in section else "",
        temperatures=_names(section, "temperatures"),
        status=_status(section),
        order=_names(section, "order"),
    )
    section.end()
    if len(mapping.temperatures) > TEMPERATURE_SENSORS:
        raise section.error("temperatures", f"must name at most {TEMPERATURE_SENSORS} signals")
    return mapping


def _names(section: Section, key: str) -> tuple[str, ...]:
    return tuple(_name(section, key, name) for name in (section.texts(key) if key in section else ()))


def _name(section: Section, key: str, name: str) -> str:
    if name and not _NAME.fullmatch(name):
        raise section.error(key, f"must name a signal as Signal or Message.Signal, got '{name}'")
    return name


def _status(section: Section) -> tuple[tuple[str, ScanStatus], ...]:
    if "status" not in section:
        return ()
    flags = section.section("status")
    return tuple((_name(flags, name, name), FLAGS[flags.text(name, tuple(FLAGS))]) for name in flags.names())


def _counts(section: Section, rows: int, cols: int, first: int, blocks: bool) -> tuple[str, ...]:
    """Return the names of the count signals; those of one frame when the frames are numbered by a signal."""
    texts = section.texts("counts")
    if len(texts) > 1 or "{" not in texts[0]:
        if not blocks and len(texts) != rows * cols:
            raise section.error("counts", f"must name {rows} x {cols} = {rows * cols} signals, got {len(texts)}")
        return tuple(_name(section, "counts", text) for text in texts)
    if blocks:
        count = section.whole("counts_per_frame", 1, 64)
        numbers = [{"place": first + place} for place in range(count)]
    else:
        numbers = [
            {"row": first + taxel // cols, "col": first + taxel % cols, "taxel": first + taxel}
            for taxel in range(rows * cols)
        ]
    return tuple(_name(section, "counts", _filled(section, texts[0], fields)) for fields in numbers)


def _filled(section: Section, pattern: str, fields: Mapping[str, int]) -> str:
    """Return a pattern with its fields filled in; nothing but numbers can be in it."""
    known = ", ".join(f"{{{name}}}" for name in fields)
    try:
        for _, field, width, conversion in string.Formatter().parse(pattern):
            if field is not None and (field not in fields or conversion or not _WIDTH.fullmatch(width or "")):
                raise ValueError(field)
        return pattern.format(**fields)
    except ValueError as error:
        raise section.error(
            "counts", f"must be a pattern with {known}, such as T{{row}}_{{col:02}}, got '{pattern}'"
        ) from error
