# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Random comparisons with few examples in the ordinary run, and with all of them in the slow one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import pytest
from hypothesis import given, settings
from hypothesis.strategies import SearchStrategy

Example = TypeVar("Example")


def examples(few: int, many: int) -> pytest.MarkDecorator:
    """Return the parameter `count` of a test: `few` in the ordinary run, `many` in that of the slow tests."""
    return pytest.mark.parametrize("count", [few, pytest.param(many, marks=pytest.mark.slow)])


def each_of(count: int, strategy: SearchStrategy[Example], check: Callable[[Example], object]) -> None:
    """Call a check, which fails by an exception, with so many examples, the same ones in every run."""

    @settings(max_examples=count, deadline=None)
    @given(strategy)
    def checked(example: Example) -> None:
        check(example)

    checked()
