# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Follower runs of any simulator or measurement setup: the CSV file format."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.amplifier.follower_base import STEP_LIMIT, TIME_LIMIT, VOLTAGE_LIMIT
from posfet_model.files import read_text

HEADER: Final = "time,v_in,v_out"

MAX_SIZE: Final = 128_000_000
"""Largest size of a file [byte]: some million rows."""

MIN_SWING: Final = (1e-12, 1e-9)
"""Smallest peak-to-peak of v_out: absolute [V], and relative to the largest voltage in the file [1]."""


class RunFileError(ValueError):
    """A file is not a follower run; the message is one line with file, line number and error."""


@dataclass(frozen=True, eq=False)
class FollowerRun:
    """One run, all fields of shape [t], t >= 2."""

    time: NDArray[np.float64]
    """[s], never decreasing; 0 in the first row."""
    v_in: NDArray[np.float64]
    """Input voltage [V]."""
    v_out: NDArray[np.float64]
    """Output voltage [V], with a peak-to-peak of at least `MIN_SWING`."""


def read_run(path: Path) -> FollowerRun:
    """Return the run in a CSV file with the header ``time,v_in,v_out`` [s, V, V].

    Lines starting with # and empty lines are skipped. Steps may be uneven; two lines of the same time are a jump. Times
    may start anywhere, at Unix time for instance: the first one is subtracted as it is written, before rounding.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    FollowerRun
        The run.

    Raises
    ------
    RunFileError
        The file cannot be read or does not contain such a run.
    """
    try:
        lines = read_text(path, MAX_SIZE).splitlines()
    except OSError as error:
        raise RunFileError(f"{path}: cannot be read: {error.strerror}") from error
    numbers = [i for i, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbers or "".join(lines[numbers[0] - 1].split()) != HEADER:
        where, got = (numbers[0], repr(lines[numbers[0] - 1][:60])) if numbers else (1, "nothing")
        raise RunFileError(f"{path}:{where}: header must be {HEADER}, got {got}")
    rows = numbers[1:]
    if len(rows) < 2:
        raise RunFileError(f"{path}:{len(lines) or 1}: a run needs at least 2 rows, got {len(rows)}")
    table = _parse(path, lines, rows)
    _check_ranges(path, table, rows)
    if table[0, 0] != 0:
        table[0] = _since_first(path, lines, rows)
    _check_course(path, table, rows)
    return FollowerRun(*table)


def _parse(path: Path, lines: list[str], rows: list[int]) -> NDArray[np.float64]:
    """Return the columns, shape [3, t]; RunFileError that names the first line that is not three numbers."""
    try:
        table = np.loadtxt([lines[i - 1] for i in rows], delimiter=",", ndmin=2, comments=None)
        if table.shape[1] == 3:
            return np.ascontiguousarray(table.T)
    except ValueError:
        pass  # the loop below finds the line
    for i in rows:
        cells = lines[i - 1].split(",")
        if len(cells) != 3:
            raise RunFileError(f"{path}:{i}: 3 values ({HEADER}) expected, got {len(cells)}")
        for name, cell in zip(HEADER.split(","), cells, strict=True):
            if not _is_number(cell):
                raise RunFileError(f"{path}:{i}: {name} must be a number, got {cell.strip()[:40]!r}")
    raise RunFileError(f"{path}: cannot be read as numbers")


def _since_first(path: Path, lines: list[str], rows: list[int]) -> list[float]:
    """Return the times of the rows less the first; in float64 the difference of two Unix times is 0.24 us off."""
    since: list[float] = []
    first: Decimal | None = None
    for i in rows:
        cell = lines[i - 1].partition(",")[0].strip()
        try:
            time = Decimal(cell)
        except InvalidOperation:  # exponents of twenty digits
            raise RunFileError(f"{path}:{i}: time must be a number, got {cell[:40]!r}") from None
        first = time if first is None else first
        since.append(float(time - first))
    return since


def _is_number(cell: str) -> bool:
    """Return whether a cell is a number in the notation of other programs: only Python accepts 1_000."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _check_ranges(path: Path, table: NDArray[np.float64], rows: list[int]) -> None:
    """Raise RunFileError for values out of range."""
    for name, column, limit in zip(HEADER.split(","), table, (TIME_LIMIT, VOLTAGE_LIMIT, VOLTAGE_LIMIT), strict=True):
        bad = ~(np.abs(column) <= limit)
        if bad.any():
            first = int(bad.argmax())
            allowed = f"[{-limit:g}, {limit:g}]"
            raise RunFileError(f"{path}:{rows[first]}: {name} must be in {allowed}, got {column[first]:g}")


def _check_course(path: Path, table: NDArray[np.float64], rows: list[int]) -> None:
    """Raise RunFileError for time that decreases, never increases or leaps, and for a constant output."""
    time, _, v_out = table
    step = np.diff(time)
    if step.min() < 0:
        first = int((step < 0).argmax())
        raise RunFileError(f"{path}:{rows[first + 1]}: time must not decrease, got a step of {step[first]:g} s")
    if step.max() > STEP_LIMIT:
        first = int((step > STEP_LIMIT).argmax())
        raise RunFileError(f"{path}:{rows[first + 1]}: steps must be at most {STEP_LIMIT:g} s, got {step[first]:g} s")
    if time[-1] == 0:
        raise RunFileError(f"{path}:{rows[-1]}: time must increase, got the same in every row")
    swing, least = float(np.ptp(v_out)), max(MIN_SWING[0], MIN_SWING[1] * float(np.max(np.abs(table[1:]))))
    if swing < least:
        raise RunFileError(
            f"{path}:{rows[-1]}: v_out must vary by {least:g} V or more, got {swing:g} V; it is the full scale"
        )
