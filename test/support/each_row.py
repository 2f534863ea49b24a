# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One test for a whole table: every row is tried, and all failures are reported together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest

Row = Callable[[str], AbstractContextManager[None]]


@contextmanager
def each_row() -> Iterator[Row]:
    """Yield the context in which a row is tried; fail at the end if a row failed or there was none.

    Examples
    --------
    >>> with each_row() as row:
    ...     for number in (1, 4, 9):
    ...         with row(f"root of {number}"):
    ...             assert (number**0.5).is_integer()
    """
    tried = 0
    failures = []

    @contextmanager
    def row(name: str) -> Iterator[None]:
        nonlocal tried
        tried += 1
        try:
            yield
        except (Exception, pytest.fail.Exception) as error:  # the other rows are still tried
            failures.append(f"{name}: {type(error).__name__}: {error}")

    yield row
    if failures:
        pytest.fail("\n".join([f"{len(failures)} of {tried} rows fail:", *failures]), pytrace=False)
    if not tried:
        pytest.fail("the table has no rows", pytrace=False)
