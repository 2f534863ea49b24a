# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Cases of a test that show the same: those that differ most in the ordinary run, the others in make soak."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import product
from typing import Any

import pytest
from _pytest.mark.structures import ParameterSet


def long_cases(cases: Iterable[Any] | Mapping[str, Any], ordinary: Collection[Any]) -> list[ParameterSet]:
    """Return the parameters of a test, of which those not in `ordinary` are slow; their ids stay as they are.

    A case of several parameters is a tuple, or one of `pytest.param`. Cases of a mapping have its keys as ids, and
    `ordinary` are keys then.
    """
    if isinstance(cases, Mapping):
        named = [(key, pytest.param(*_values(case), id=key)) for key, case in cases.items()]
    else:
        named = [(case, case if isinstance(case, ParameterSet) else pytest.param(*_values(case))) for case in cases]
    keys = [key for key, _ in named]
    missing = [each for each in ordinary if each not in keys]
    assert not missing, f"no such case: {missing}"
    return [each if key in ordinary else _slow(each) for key, each in named]


def crossed(*axes: Iterable[Any] | Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """Return each case of one axis with each of the others, with the ids of a decorator for each, the nearest first."""
    named = [axis if isinstance(axis, Mapping) else {str(each): each for each in axis} for axis in axes]
    return {
        "-".join(key for key, _ in case): tuple(each for _, each in case)
        for case in product(*(axis.items() for axis in named))
    }


def _values(case: Any) -> tuple[Any, ...]:
    return case if isinstance(case, tuple) else (case,)


def _slow(case: ParameterSet) -> ParameterSet:
    return case._replace(marks=[*case.marks, pytest.mark.slow])
