# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from __future__ import annotations

import pytest

from posfet.arguments import ARGUMENTS, defaults, describe, parse
from posfet_model.config import ConfigError


def test_defaults_are_valid() -> None:
    assert parse([]) == defaults()


def test_given_values_override_defaults() -> None:
    arguments = parse(["source:=emulator", "namespace:=hand/thumb"])
    assert arguments["source"] == "emulator"
    assert arguments["namespace"] == "hand/thumb"
    assert arguments["scene"] == defaults()["scene"]


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("sourse:=sim", "sourse: unknown argument, did you mean source? posfet bringup -s lists all"),
        ("source=sim", "source=sim: must be an argument name:=value"),
        ("source:=usb", "source: must be one of sim, can, emulator, replay, got 'usb'"),
        ("composed:=yes", "composed: must be true or false, got 'yes'"),
        ("can_bitrate:=1000001", "can_bitrate: must be a whole number in [0, 1000000] bit/s, got '1000001'"),
        ("can_bitrate:=1e6", "can_bitrate: must be a whole number in [0, 1000000] bit/s, got '1e6'"),
    ],
)
def test_invalid_arguments_are_rejected_in_one_line(word: str, reason: str) -> None:
    with pytest.raises(ConfigError) as refused:
        parse([word])
    assert str(refused.value).startswith(reason)
    assert "\n" not in str(refused.value)


def test_an_argument_given_twice_is_rejected() -> None:
    with pytest.raises(ConfigError, match="scene: is given twice"):
        parse(["scene:=hold", "scene:=idle"])


def test_every_argument_is_described() -> None:
    text = describe()
    for argument in ARGUMENTS:
        assert argument.name in text
        assert argument.summary in text


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["can_channel:=/dev/ttyACM0", "can_interface:=slcan"], "source:=can"),
        (["can_bitrate:=500000"], "source:=can or source:=emulator"),
        (["replay_file:=grasp.mcap"], "source:=replay"),
        (["bus_channel:=can0"], "source:=emulator"),
        (["source:=can", "scene:=hold"], "source:=sim or source:=emulator"),
        (["source:=replay", "imperfections:=none"], "source:=sim or source:=emulator"),
        (["source:=emulator", "can_interface:=slcan"], "source:=can"),
    ],
)
def test_an_argument_of_another_source_is_refused_in_one_line(words: list[str], wanted: str) -> None:
    with pytest.raises(ConfigError, match=rf": needs {wanted}; leave it out with source:=\w+$"):
        parse(words)


def test_a_default_is_an_argument_of_every_source() -> None:
    """As the launch file gives all arguments to the process, also those that were not given to itself."""
    words = [f"{name}:={value}" for name, value in defaults().items() if name != "source"]
    for source in ("sim", "can", "emulator", "replay"):
        assert parse([*words, f"source:={source}"])["source"] == source
    assert parse(["source:=can", "replay_rate:=1"])["replay_rate"] == "1"
