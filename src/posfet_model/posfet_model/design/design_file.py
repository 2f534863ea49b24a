# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Design files: YAML with one key for each number of `PosfetDesign`, in SI units or as text with a unit."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from posfet_model._lib.shown import shown
from posfet_model.amplifier.calibration import MeasuredFigureError
from posfet_model.amplifier.undetermined import NEAR_REST
from posfet_model.config import ConfigError, Section, find_file, known_instead, read_yaml
from posfet_model.design.design_fields import PARTS
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.design.sweep import MAX_DESIGNS, MAX_POINTS, Axis, Sweep
from posfet_model.design.tolerance import KEYS, MAX_SAMPLES, Limit, Tolerance
from posfet_model.device.physical_units import Plausible
from posfet_model.device.taxel_fields import POLING_VOLTAGE, FilmGeometry, plausible_fields

FOLDER: Final = Path(__file__).parent / "designs"
"""Shipped design files."""

MAX_STEPS: Final = 1000
"""Most poling voltages in a file."""

_FIELDS: Final = plausible_fields(PosfetDesign)

_MEASURED: Final = {"gain_db": Plausible("dB", 0.1, 180), "gbw_hz": Plausible("Hz", 1, 1e12)}

_SIZES_AND_BIAS: Final = frozenset(
    ["reference_current", *(f"{part}_{size}" for part in PARTS for size in ("width", "length"))]
)
"""Keys any of which says that sizes and bias are those of the measured op-amp."""

_ALSO_MEASURED: Final = {
    "bandwidth_hz": ("bandwidth", Plausible("Hz", 1, 1e12)),
    "slew_v_per_s": ("slew_rate", Plausible("V/s", 1, 1e15)),
    "falling_slew_v_per_s": ("falling_slew_rate", Plausible("V/s", 1, 1e15)),
}
"""Argument of `PosfetDesign.with_measured` and range of what may be given besides, by key."""

_KNOWN_INPUTS: Final = {
    "lowest_input_v": Plausible("V", 0, 1e3, signed=True),
    "highest_input_v": Plausible("V", 0, 1e3, signed=True),
}
"""Ends of the inputs at which a measured op-amp was stable."""

_ONLY_THE_PAPERS: Final = (
    "; without sizes and bias only the paper's op-amp is tried: give these, or another film_geometry"
)
"""What to do where figures alone are refused."""

_KEYS: Final = {"gain": "gain_db", "gain_bandwidth": "gbw_hz", "phase_margin": "phase_margin_deg"} | {
    name: key for key, (name, _) in _ALSO_MEASURED.items()
}
"""Key by argument of `PosfetDesign.with_measured`."""


@dataclass(frozen=True)
class DesignFile:
    """Content of a design file."""

    name: str
    """Name of the design, that of the file without its suffix."""
    design: PosfetDesign
    """The design, of numbers."""
    adjusted: dict[str, float]
    """Fields of the design that are adjusted to measured figures, with their values in SI; empty if none are given."""
    sweep: Sweep | None
    """Ranges to sweep, if the file has any."""
    tolerance: Tolerance | None
    """Spreads and limits for the tolerance analysis, if the file has any."""


def shipped() -> list[str]:
    """Return the names of the shipped design files."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def load_design(name: str) -> DesignFile:
    """Return the content of a design file.

    Parameters
    ----------
    name : str
        Path of a file, or the name of a shipped one.

    Returns
    -------
    DesignFile
        The design, with its sweep and tolerances.

    Raises
    ------
    ConfigError
        The file cannot be read or used; one line with file and key.
    """
    path = find_file(name, FOLDER, "design", "listed by posfet design --list")
    section = read_yaml(path, may_be_empty=True)
    chosen: dict[str, Any] = {}
    for key, plausible in _FIELDS.items():
        if key in section:
            chosen[key] = read_number(section, key, plausible, section.value(key, "a number"))
    if "stages" in section:
        chosen["stages"] = section.whole("stages", 1, 2)
    if "film_geometry" in section:
        choices = [geometry.value for geometry in FilmGeometry]
        chosen["film_geometry"] = FilmGeometry(section.text("film_geometry", choices))
    if "poling_voltages" in section:
        chosen["poling_voltages"] = _poling(section, section.value("poling_voltages", "a list of voltages"))
    measured = None
    if "measured" in section:
        measured, known = _measured(section.section("measured"), alone=_SIZES_AND_BIAS.isdisjoint(chosen))
        chosen |= known
    sweep = _sweep(section) if "sweep" in section else None
    tolerance = None
    if "tolerance" in section:
        tolerance, mismatch = _tolerance(section.section("tolerance"))
        twice = [key for key in mismatch if key in chosen]
        if twice:
            raise section.error(f"tolerance.{twice[0]}", "must be given once: it is a key of the design, too")
        chosen |= mismatch
    section.end()
    try:
        design = PosfetDesign(**chosen)
    except ValueError as error:
        raise section.error("", str(error)) from None
    adjusted = {}
    if measured is not None:
        try:
            changed = design.with_measured(**measured)
        except MeasuredFigureError as error:
            remedy = "" if design.poles_known else _ONLY_THE_PAPERS
            raise section.error("measured", f"{error.named(error.template, _KEYS)}{remedy}") from None
        except ValueError as error:
            raise section.error("measured", str(error)) from None
        fields = ((key, float(getattr(changed, key))) for key in _FIELDS)
        adjusted = {key: value for key, value in fields if value != getattr(design, key)}
        design = changed
    return DesignFile(path.stem, design, adjusted, sweep, tolerance)


def read_number(section: Section, key: str, plausible: Plausible, value: object) -> float:
    """Return a plausible number in SI, from a number or a text with a unit.

    Parameters
    ----------
    section : Section
        Section of the file, for the error.
    key : str
        Its key.
    plausible : Plausible
        Unit and range.
    value : object
        What YAML gives.

    Returns
    -------
    float
        The number.

    Raises
    ------
    ConfigError
        It is no number, of another unit, or not plausible.
    """
    unit = "" if plausible.unit == "1" else f" in {plausible.unit}, or with a unit such as {_example(plausible)}"
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise section.error(key, f"must be a number{unit}, got {shown(value)}")
    try:
        number = plausible.parse(value) if isinstance(value, str) else float(value)
        return float(plausible.array("", number))
    except (ValueError, OverflowError) as error:
        raise section.error(key, str(error).strip()) from None


def _measured(section: Section, *, alone: bool) -> tuple[dict[str, float], dict[str, Any]]:
    """Return the arguments of `PosfetDesign.with_measured`, and what the design has to know of figures alone."""
    inputs = _known_inputs(section, alone=alone)
    decibels, hertz = (
        read_number(section, key, plausible, section.value(key, f"a number in {plausible.unit}"))
        for key, plausible in _MEASURED.items()
    )
    found = {
        "gain": 10 ** (decibels / 20),
        "gain_bandwidth": hertz,
        "phase_margin": section.number("phase_margin_deg", -85, 179),
    }
    for key, (name, plausible) in _ALSO_MEASURED.items():
        value = section.value(key, f"a number in {plausible.unit}", default=None)
        if value is not None:
            found[name] = read_number(section, key, plausible, value)
    section.end()
    known = {"poles_known": False, "slew_rate_known": "slew_rate" in found, "known_inputs": inputs}
    return found, known if alone else {}


def _known_inputs(section: Section, *, alone: bool) -> tuple[float, float]:
    """Return the inputs at which a measured op-amp was stable; refused with sizes and bias, from which they follow."""
    ends = []
    for (key, plausible), default in zip(_KNOWN_INPUTS.items(), NEAR_REST, strict=True):
        value = section.value(key, f"a number in {plausible.unit}", default=None)
        if value is not None and not alone:
            raise section.error(key, "must be left out with sizes and bias, from which the range of inputs follows")
        ends.append(default if value is None else read_number(section, key, plausible, value))
    if not ends[0] <= 0 <= ends[1]:
        wrong = next(iter(_KNOWN_INPUTS)) if ends[0] > 0 else list(_KNOWN_INPUTS)[1]
        raise section.error(wrong, "must not exclude 0 V, at which gain, unity crossing and margin are measured")
    return ends[0], ends[1]


def _example(plausible: Plausible) -> str:
    examples = {"m": "2.5 um", "m2": "1 mm2", "F": "46.2 pF", "ohm": "10 Gohm", "A": "200 uA", "V/m": "160 kV/cm"}
    return examples.get(plausible.unit, f"1 {plausible.unit}")


def _poling(section: Section, value: object) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) > MAX_STEPS:
        raise section.error("poling_voltages", f"must be a list of at most {MAX_STEPS} voltages, got {shown(value)}")
    return tuple(read_number(section, "poling_voltages", POLING_VOLTAGE, volt) for volt in value)


def _sweep(section: Section) -> Sweep:
    raw = section.value("sweep", "a range or a list of ranges")
    parts = raw if isinstance(raw, list) else [raw]
    axes = [_axis(Section(section.source, f"sweep[{i}]", part)) for i, part in enumerate(parts)]
    names = [axis.field for axis in axes]
    if not axes or len(set(names)) != len(names):
        raise section.error("sweep", f"must be ranges of different fields, got {', '.join(names) or 'none'}")
    sweep = Sweep(tuple(axes))
    if sweep.designs > MAX_DESIGNS:
        raise section.error("sweep", f"must be at most {MAX_DESIGNS} designs together, got {sweep.designs}")
    return sweep


def _axis(section: Section) -> Axis:
    field = section.text("field")
    if field not in _FIELDS:
        raise unknown(section, "field", field, _FIELDS)
    plausible = _FIELDS[field]
    ends = [read_number(section, key, plausible, section.value(key, "a number")) for key in ("from", "to")]
    points = section.whole("points", 2, MAX_POINTS)
    log = section.flag("log", default=False)
    section.end()
    if ends[0] == ends[1]:
        raise section.error("to", f"must differ from 'from', got {ends[1]:g} for both")
    if log and not min(ends) > 0 and not max(ends) < 0:
        raise section.error("log", f"must be false for a range that contains 0, got {ends[0]:g} to {ends[1]:g}")
    return Axis(field, ends[0], ends[1], points, log)


def _tolerance(section: Section) -> tuple[Tolerance, dict[str, float]]:
    """Return the spreads and limits, and the fields of the design about mismatch, which may be given here, too."""
    fields = {}
    if "spread" in section:
        spread = section.section("spread")
        for name in spread.names():
            if name not in _FIELDS:
                raise unknown(spread, name, name, _FIELDS)
            fields[name] = read_number(spread, name, Plausible("1", 0, 1), spread.value(name, "a number"))
        spread.end()
    limits = []
    if "limits" in section:
        named = section.section("limits")
        for key in named.names():
            if key not in KEYS:
                raise unknown(named, key, key, KEYS)
            limits.append(_limit(named, key))
    usual = Tolerance()
    tolerance = Tolerance(
        samples=section.whole("samples", 1, MAX_SAMPLES, default=usual.samples),
        seed=section.whole("seed", 0, 2**32 - 1, default=usual.seed),
        spread=tuple(fields.items()),
        limits=tuple(limits),
    )
    mismatch = {
        key: read_number(section, key, _FIELDS[key], section.value(key, "a number"))
        for key in ("threshold_mismatch", "gain_mismatch")
        if key in section
    }
    section.end()
    return tolerance, mismatch


def _limit(section: Section, key: str) -> Limit:
    value = section.value(key, "")
    if not isinstance(value, dict) or not value:
        raise section.error(key, f"must be {{min: ..., max: ...}} or one of them, got {shown(value)}")
    ends = Section(section.source, f"{section.key}.{key}", value)
    low = ends.number("min") if "min" in ends else -math.inf
    high = ends.number("max") if "max" in ends else math.inf
    ends.end()
    if low > high:
        raise section.error(key, f"must have a max above its min, got {high:g} and {low:g}")
    return Limit(key, low, high)


def unknown(section: Section, key: str, name: str, known: Iterable[str]) -> ConfigError:
    """Return the error for a name in a file that is none of the known ones, with the most similar one.

    Parameters
    ----------
    section : Section
        Section of the file.
    key : str
        Key of the section at which the name is.
    name : str
        The name.
    known : iterable of str
        Names that are known.
    """
    return section.error(key, f"no such name {shown(name)}, {known_instead(name, known)}")
