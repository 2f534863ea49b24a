# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Input that nobody meant: how many examples, and mutations of valid files that keep most of their structure."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

COUNTS = (40, pytest.param(2_000, marks=pytest.mark.slow))
"""Numbers of examples for `pytest.mark.parametrize`: few in every run, many among the slow tests."""

MAX_MESSAGE = 600
"""Longest message of an error, beside the path."""

TOKENS = [
    *(b"[", b"]", b"{", b"}", b": ", b":", b", ", b"- ", b"? ", b"&a ", b"*a", b"!!int ", b"!", b"|\n", b">", b"'"),
    *(b'"', b"#", b"%", b"<<: ", b"=", b"---\n", b"...\n", b"\n", b"\n  ", b"\t", b"\0", b"\x1b", b"\xff", b"\xc3\xbc"),
    *(b"\xef\xbb\xbf", b"\xe2\x80\xa8", b"-1", b"0", b"1e999", b".nan", b".inf", b"nan", b"inf", b"0x_", b"1:59"),
    *(b"1_0", b"~", b"yes", b"9" * 30, b"9" * 5000, b"1" + b":59" * 2000, b"2026-13-45", b"[" * 1000, b"- " * 1000),
    *(b"a: 1\n", b",", b",,", b"1,2,3\n", b"x" * 2000),
]  # fmt: skip

NUMBERS = [
    b"0",
    b"-1",
    b"1",
    b"2",
    b"0.1",
    b"1.0e-9",
    b"1.0e-3",
    b"0.5",
    b"10",
    b"45",
    b"99.9",
    b"1000",
    b"1.0e+5",
    b"1.0e+6",
]
_NUMBER = re.compile(rb"(?<![\w.])-?\d+(\.\d+)?(?![\w.])")


def examples(count: int) -> Any:
    """Return the settings of a test with so many examples, the same ones in every run."""
    return settings(
        max_examples=count,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example],
    )


@st.composite
def mutated(draw: st.DrawFn, *originals: bytes) -> bytes:
    """Return one of the originals after some changes of numbers and bytes, insertions, deletions and copies."""
    content = bytearray(draw(st.sampled_from(originals)))
    for _ in range(draw(st.integers(0, 6))):
        at = draw(st.integers(0, len(content)))
        kind = draw(st.sampled_from(["number", "insert", "delete", "copy", "byte", "cut"]))
        numbers = list(_NUMBER.finditer(content)) if kind == "number" else []
        if numbers:
            number = draw(st.sampled_from(numbers))
            content[slice(*number.span())] = draw(st.sampled_from(NUMBERS))
        elif kind == "insert":
            content[at:at] = draw(st.one_of(st.sampled_from(TOKENS), st.binary(max_size=8)))
        elif kind == "byte" and at < len(content):
            content[at] = draw(st.integers(0, 255))
        elif kind == "cut":
            del content[at:]
        else:
            end = min(at + draw(st.integers(0, 200)), len(content))
            if kind == "delete":
                del content[at:end]
            else:
                content[at:at] = content[at:end]
    return bytes(content)


def assert_one_line(error: Exception, path: object = "", limit: int = MAX_MESSAGE) -> None:
    """Check that the message of an error is one line of limited length that a terminal can show."""
    message = str(error).replace(str(path), "")
    assert message.isprintable(), message
    assert 0 < len(message) < limit, message
