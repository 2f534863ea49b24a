# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A table of cases in one test fails for every row that fails, and for no other."""

import math

import pytest

from support.each_row import each_row
from support.sweep import assert_all_refused, refusals


def test_every_row_is_tried_and_all_failures_are_reported() -> None:
    tried = []
    with pytest.raises(pytest.fail.Exception) as caught, each_row() as row:
        for name in ("good", "asserts", "refuses nothing", "raises", "good as well"):
            with row(name):
                tried.append(name)
                assert name != "asserts"
                if name == "refuses nothing":
                    with pytest.raises(ValueError, match="never"):
                        pass
                if name == "raises":
                    raise KeyError("key")
    assert len(tried) == 5
    first, *failures = str(caught.value).splitlines()
    assert first == "3 of 5 rows fail:"
    assert [line.split(":")[0] for line in failures if ": " in line] == ["asserts", "refuses nothing", "raises"]


def test_a_table_without_failures_passes_and_one_without_rows_does_not() -> None:
    with each_row() as row, row("only"):
        pass
    with pytest.raises(pytest.fail.Exception, match="no rows"), each_row():
        pass


def half(number: float, *, of: float = 1.0) -> float:
    """Reject text by name, NaN under another name, and nothing else."""
    if isinstance(number, str):
        raise ValueError("number must be a number")
    if math.isnan(number):
        raise ValueError("this must not be NaN")
    return number / of


def test_a_value_not_rejected_by_name_is_reported_with_function_argument_and_value() -> None:
    (function, cases) = refusals(half, {"number": 1.0}, number=[-1.0, "minus one"]).values
    with pytest.raises(pytest.fail.Exception) as caught:
        assert_all_refused(function, cases)
    said = str(caught.value)
    assert "7 of 9 rows fail:" in said
    assert "half, number = -1.0: Failed: DID NOT RAISE" in said
    assert "half, number = nan: AssertionError" in said
    assert "half, number = None: TypeError" in said
    assert "one'" not in said
    with pytest.raises(AssertionError, match=r"no good value of {'number'}"):
        refusals(half, {}, of=[0.0])
