# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A hand of several sensors, as one YAML file: the arguments of a bring-up for each of them."""

from __future__ import annotations

import zlib
from collections import Counter
from pathlib import Path
from typing import Final

from posfet.arguments import ARGUMENTS, NAMESPACE, PARAMS_NAMESPACES, SIMULATED, SOURCES_OF, check, defaults, written_as
from posfet_model._lib.shown import shown
from posfet_model.command_line import checked_namespace
from posfet_model.config import ConfigError, Section, is_there, read_yaml
from posfet_sim.defaults import SEED_MAX
from posfet_sim.parameters import SEED

_FILES: Final = ("sensor_file", "calibration_file", "params_file", "scene", "imperfections", "replay_file")
"""Arguments that may be paths, relative to the folder of the hand file."""
_OWN: Final = ("namespace", "serial", "calibration_file", "frame_id")
"""Arguments that no two sensors may share."""


def read_hand(path: str | Path) -> list[dict[str, str]]:
    """Return the arguments of each sensor of a hand, as `posfet.arguments.check` returns them.

    Parameters
    ----------
    path : str or Path
        YAML file: `name`, the namespace of the hand; `common`, arguments of all sensors; `sensors`, a list with the
        `name` of each, which is its namespace below that of the hand, and with arguments of its own. A simulated
        board without a `seed` gets one by its namespace.

    Returns
    -------
    list of dict
        Arguments by name for each sensor, complete with defaults; paths of files are absolute.

    Raises
    ------
    ConfigError
        One line, if the file cannot be used, an argument is not allowed, or two sensors share a namespace, frame,
        serial number or calibration.
    """
    top = read_yaml(path)
    hand = top.text("name", default="")
    folder = Path(path).absolute().parent
    common = _arguments(top.section("common"), folder) if "common" in top else {}
    sensors = []
    for section in top.sections("sensors"):
        name = section.text("name")
        own = _arguments(section, folder)
        try:
            namespace = checked_namespace("/".join(filter(None, (hand, name))))
            source = {**defaults(), **common, **own}["source"]
            shared = {key: value for key, value in common.items() if source in SOURCES_OF.get(key, (source,))}
            for key in common.keys() - shared.keys():  # of other sensors
                check({**defaults(), "source": SOURCES_OF[key][0], key: common[key]})
            values = {**defaults(), **shared, **own, NAMESPACE.name: namespace}
            if source in SIMULATED and SEED.name not in {*common, *own}:
                values[SEED.name] = str(seed_of(namespace))
            sensors.append(check(values))
        except ConfigError as error:
            raise section.error("", f"'{name}': {error}") from error
    top.end()
    if not sensors:
        raise top.error("sensors", "must be a list of at least one sensor")
    for argument in _OWN:
        counts = Counter(values[argument] for values in sensors if values[argument])
        for value, count in counts.items():
            if count > 1:
                raise top.error("sensors", f"{count} of them have the {argument} '{value}': each needs its own")
    names = [values[NAMESPACE.name] for values in sensors]
    given = (values[PARAMS_NAMESPACES.name] for values in sensors)
    all_named = (",".join(filter(None, (text, *names))) for text in given)
    return [{**values, PARAMS_NAMESPACES.name: text} for values, text in zip(sensors, all_named, strict=True)]


def seed_of(namespace: str) -> int:
    """Return the seed of the simulated board of a namespace: no two sensors of a hand are the same board."""
    return zlib.crc32(namespace.encode()) % (SEED_MAX + 1)


def _arguments(section: Section, folder: Path) -> dict[str, str]:
    """Return the arguments in a section as texts, those of files beside the hand file as absolute paths."""
    found = {}
    for argument in ARGUMENTS:
        if argument is NAMESPACE or argument.name not in section:
            continue
        value = section.value(argument.name, argument.allowed)
        if type(value) not in written_as(argument):  # without quotes 0712 is 458 in YAML, and on is true
            raise section.error(argument.name, f"must be {argument.allowed}, got {shown(value)} without quotes")
        text = str(value).lower() if isinstance(value, bool) else str(value)
        beside = folder / text
        found[argument.name] = str(beside) if argument.name in _FILES and text and is_there(beside) else text
    section.end()
    return found
