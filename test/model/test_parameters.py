# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Parameters as data: valid values, conversion from text, help texts."""

from __future__ import annotations

import argparse
import math
from typing import Any

import pytest

from posfet_model.parameters import MAX_RELATIVE, MODEL_NODE, Parameter

WHOLE = Parameter("bitrate", 0, "Bitrate", unit="bit/s", low=0, high=1_000_000)
RATE = Parameter("rate", 1000.0, "Scan rate", unit="Hz", low=1.0, high=4000.0)
SWITCH = Parameter("on", True, "Whether it is on")
CHOICE = Parameter("frames", "auto", "Frames", choices=("auto", "true"))
NAME = Parameter("name", "tactile", "Name")
FILE = Parameter("file", "", "File", empty="none")
LIST = Parameter("options", [""], "Options")


@pytest.mark.parametrize(
    ("parameter", "value", "reason"),
    [
        (WHOLE, 500_000, ""),
        (WHOLE, 1_000_001, "must be a whole number in [0, 1000000] bit/s, got 1000001"),
        (WHOLE, -1, "must be a whole number in [0, 1000000] bit/s, got -1"),
        (WHOLE, 5.0, "must be a whole number in [0, 1000000] bit/s, got 5.0"),
        (WHOLE, True, "must be a whole number in [0, 1000000] bit/s, got True"),
        (RATE, 1.0, ""),
        (RATE, math.nan, "must be a number with a decimal point in [1, 4000] Hz, got nan"),
        (RATE, math.inf, "must be a number with a decimal point in [1, 4000] Hz, got inf"),
        (RATE, 1, "must be a number with a decimal point in [1, 4000] Hz, got 1"),
        (SWITCH, False, ""),
        (SWITCH, 0, "must be true or false, got 0"),
        (CHOICE, "true", ""),
        (CHOICE, True, "must be one of auto, true, got True"),
        (NAME, "", "must be text, got ''"),
        (NAME, None, "must be text, got None"),
        (FILE, "", ""),
        (LIST, ["a=1", "b=2"], ""),
        (LIST, ["a=1", 2], "must be a list of texts, got ['a=1', 2]"),
    ],
)
def test_an_invalid_value_is_reported_with_the_reason(parameter: Parameter, value: Any, reason: str) -> None:
    assert parameter.check(value) == reason


@pytest.mark.parametrize(
    ("parameter", "text", "value"),
    [
        (WHOLE, "250000", 250_000),
        (RATE, "50", 50.0),
        (SWITCH, "false", False),
        (CHOICE, "true", "true"),
        (FILE, "", ""),
    ],
)
def test_a_text_is_read_with_the_type_of_the_default(parameter: Parameter, text: str, value: Any) -> None:
    parsed = parameter.parse(text)
    assert parsed == value
    assert type(parsed) is type(parameter.default)


@pytest.mark.parametrize(
    ("parameter", "text"), [(WHOLE, "1e3"), (WHOLE, ""), (RATE, "nan"), (SWITCH, "True"), (CHOICE, "no"), (LIST, "a")]
)
def test_an_invalid_text_is_rejected(parameter: Parameter, text: str) -> None:
    with pytest.raises(ValueError, match=f"^must be .*, got '{text}'$"):
        parameter.parse(text)


def test_an_invalid_default_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^rate: the default must be a number .* in \[1, 10\], got 0.0$"):
        Parameter("rate", 0.0, "Scan rate", low=1.0, high=10.0)


def test_help_has_description_unit_and_default_and_argparse_prints_it() -> None:
    assert RATE.help == "Scan rate [Hz] (default: 1000.0)"
    assert FILE.help == "File; empty: none (default: empty)"
    parser = argparse.ArgumentParser()
    parser.add_argument("--share", help=Parameter("share", 5.0, "Share in %").help)
    assert "Share in % (default: 5.0)" in parser.format_help()


def test_every_default_survives_a_round_trip_through_text() -> None:
    for parameter in (*MODEL_NODE, WHOLE, RATE):
        assert parameter.parse(parameter.default_text) == parameter.default


@pytest.mark.parametrize("value", [0.0, -0.2, 100.0, math.nan, math.inf])
def test_a_meaningless_relative_uncertainty_is_rejected(value: float) -> None:
    assert MAX_RELATIVE.check(value).startswith("must be a number")
