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
