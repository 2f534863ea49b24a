# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The stated duration is that of a similar run, and none is stated for a part of the tests."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from support.expected_time import HERE, QUICK, expected, keep


class Cache(dict[str, Any]):
    def set(self, key: str, value: Any) -> None:
        self[key] = value


def config(*paths: str, cache: Cache | None = None, tx: tuple[str, ...] = (), **options: Any) -> Any:
    usual = {"keyword": "", "markexpr": "", "deselect": None, "ignore": None, "ignore_glob": None, "lf": False}
    return SimpleNamespace(
        option=SimpleNamespace(**{**usual, "collectonly": False, "tx": list(tx), **options}),
        args=list(paths or ("test",)),
        invocation_params=SimpleNamespace(dir=HERE.parent),
        cache=cache,
    )


def test_without_a_previous_run_the_time_is_that_of_two_idle_cores() -> None:
    assert expected(config(cache=Cache(), tx=("popen", "popen"))).endswith("minutes on two idle cores")
    assert "one test after the other" in expected(config())


def test_the_time_is_that_of_the_last_similar_run() -> None:
    cache = Cache()
    two = {"cache": cache, "tx": ("popen", "popen")}
    keep(config(**two), 250.4)
    assert expected(config(**two)) == "expected time: 4 min 10 s, as the last run on this machine"
    assert "two idle cores" in expected(config(cache=cache))
    assert "two idle cores" in expected(config(**two, markexpr=QUICK))


@pytest.mark.parametrize(
    "part", [{"keyword": "x"}, {"markexpr": "ros"}, {"lf": True}, {"deselect": ["a"]}, {"collectonly": True}], ids=str
)
def test_no_time_is_stated_or_stored_for_a_partial_run(part: dict[str, Any]) -> None:
    cache = Cache()
    keep(config(cache=cache, **part), 3.0)
    assert expected(config(cache=cache, **part)) == ""
    assert not cache


def test_paths_are_resolved_before_they_are_compared() -> None:
    assert expected(config(str(HERE)))
    assert expected(config("."))
    assert not expected(config("test/model"))
    assert not expected(config(str(HERE / Path("driver", "test_scan_codec.py"))))
