# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Signals for a simulation of the follower: CSV with the columns ``t,vin`` in, ``t,vin,vout`` out, in s and V."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Final

import numpy as np

from posfet_model._lib.shown import one_line, shown
from posfet_model._lib.types import Array, Mask
from posfet_model.config import ConfigError, read_text

HEADER: Final = "t,vin"

MAX_SIZE: Final = 128_000_000
"""Largest size of a file [byte]: some million rows."""

MAX_SAMPLES: Final = 10_000_000
"""Most samples of a signal."""

VOLTAGE_LIMIT: Final = 1e6
"""Largest accepted magnitude of a voltage [V]."""

SMALLEST_EXPONENT: Final = 20
"""Decimal exponent from which on a time is written as a power of ten."""

TIME_LIMIT: Final = 1e12
"""Largest accepted magnitude of a time [s]; Unix time is accepted."""


@dataclass(frozen=True, eq=False)
class Signal:
    """Input voltage over time, linear between samples."""

    time: Array
    """Times since `start` [s], shape [t], t >= 1, from 0, never decreasing; two equal times are a jump."""
    v_in: Array
    """Input [V], shape [t]."""
    start: Decimal = Decimal(0)
    """First time as it is written [s]: the difference of two Unix times in float64 would be 0.24 us off."""

    def written(self, time: float) -> str:
        """Return a time since `start` [s] as a time of the file."""
        if not self.start:
            return f"{time:.15g}"
        at = self.start + Decimal(f"{time:.15g}")
        text = f"{at:f}" if at.adjusted() > -SMALLEST_EXPONENT else f"{at:g}"
        return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text

    def with_even_times(self, step: float) -> tuple[Signal, Mask]:
        """Return the signal with even times in addition to its own, so that no jump or corner is lost.

        Parameters
        ----------
        step : float
            Time between the even times [s], above 0.

        Returns
        -------
        Signal
            The signal at all times.
        ndarray
            Mask of the even times, from the first time of the signal to its last.

        Raises
        ------
        ConfigError
            There would be more than `MAX_SAMPLES` even times.
        """
        span = float(self.time[-1] - self.time[0])
        if not span / step < MAX_SAMPLES:
            raise ConfigError(f"--dt: must give at most {MAX_SAMPLES} samples, got {step:g} s for {span:g} s")
        even = self.time[0] + step * np.arange(math.floor(span / step * (1 + 1e-12)) + 1)
        v_even = np.interp(even, self.time, self.v_in)  # at a jump the value after it
        time = np.concatenate([self.time, even])
        order = np.argsort(time, kind="stable")  # own samples first where times are equal
        v_in = np.concatenate([self.v_in, v_even])
        return replace(self, time=time[order], v_in=v_in[order]), order >= self.time.size


def read_signal(path: Path) -> Signal:
    """Return the signal in a CSV file with the header ``t,vin``; empty lines and lines that start with # are skipped.

    Times may start anywhere, at Unix time for instance: the first one is subtracted as it is written, before rounding.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    Signal
        The signal.

    Raises
    ------
    ConfigError
        The file cannot be read, or a row is wrong; one line with file, row and reason.
    """
    where = one_line(str(path))
    lines = read_text(path, MAX_SIZE).splitlines()
    rows = [(i, line) for i, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not rows or "".join(rows[0][1].split()).lower() != HEADER:
        line, got = (rows[0][0], shown(rows[0][1])) if rows else (1, "nothing")
        raise ConfigError(f"{where}:{line}: header must be {HEADER}, got {got}")
    if len(rows) < 2:
        raise ConfigError(f"{where}:{rows[0][0]}: must have at least one row below the header")
    table = np.array([_row(where, *row) for row in rows[1:]])
    start = Decimal(0)
    if table[0, 0] != 0:
        start, table[:, 0] = _since_first(where, rows[1:])
    signal = Signal(table[:, 0], table[:, 1], start)
    backwards = np.flatnonzero(np.diff(signal.time) < 0)
    if backwards.size:
        first = int(backwards[0])
        before, after = (_cell(rows[first + k][1]) for k in (1, 2))
        raise ConfigError(f"{where}:{rows[first + 2][0]}: t must not decrease, got {after:.40} after {before:.40}")
    return signal


def _cell(text: str) -> str:
    """Return the time of a row as it is written."""
    return text.partition(",")[0].strip()


def _since_first(where: str, rows: list[tuple[int, str]]) -> tuple[Decimal, list[float]]:
    """Return the first time, and the times less that [s]."""
    since: list[float] = []
    first: Decimal | None = None
    for line, text in rows:
        try:
            time = Decimal(_cell(text))
        except InvalidOperation:  # exponents of twenty digits
            raise ConfigError(f"{where}:{line}: t must be a number, got {shown(_cell(text))}") from None
        first = time if first is None else first
        since.append(float(time - first))
    return first or Decimal(0), since


def _row(where: str, line: int, text: str) -> tuple[float, float]:
    cells = text.split(",")
    if len(cells) != 2:
        raise ConfigError(f"{where}:{line}: must be 2 values ({HEADER}), got {len(cells)}")
    values = []
    for name, cell, limit in zip(HEADER.split(","), cells, (TIME_LIMIT, VOLTAGE_LIMIT), strict=True):
        try:
            value = float(cell) if "_" not in cell else math.nan  # only Python accepts 1_000
        except ValueError:
            value = math.nan
        if not abs(value) <= limit:
            raise ConfigError(
                f"{where}:{line}: {name} must be a number in [{-limit:g}, {limit:g}], got {shown(cell.strip())}"
            )
        values.append(value)
    return values[0], values[1]


def signal_csv(signal: Signal, v_out: Array, rows: Mask) -> str:
    """Return the text of the output file, ``t,vin,vout``.

    Parameters
    ----------
    signal : Signal
        Input of the follower.
    v_out : ndarray
        Its output [V], shape [t].
    rows : ndarray
        Mask of the samples that are written, shape [t].

    Returns
    -------
    str
        The text.
    """
    columns = (column[rows].tolist() for column in (signal.time, signal.v_in, v_out))
    lines = (f"{signal.written(t)},{vin:.12g},{vout:.12g}" for t, vin, vout in zip(*columns, strict=True))
    return "\n".join([f"{HEADER},vout", *lines, ""])
