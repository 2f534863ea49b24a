# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Many independent runs: in this process, in several with joblib, or on other machines with dask; tables of results."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from posfet_model.config import ConfigError, write_text

LOCAL: Final = "local"
"""Name of a dask cluster of this machine."""
CONNECTION_TIMEOUT: Final = 10
"""Time in which a dask scheduler is reached [s]."""

Item = TypeVar("Item")
Result = TypeVar("Result")


def results(
    run: Callable[[Item], Result],
    items: Sequence[Item],
    jobs: int = 1,
    dask: str = "",
    done: Callable[[int], None] = lambda finished: None,
) -> list[Result]:
    """Return the result of each run, in the order of the items.

    Parameters
    ----------
    run : callable
        A function of a module, so that other processes find it.
    items : sequence
        Its arguments.
    jobs : int, optional
        Number of processes; 0: one for each processor. More than one needs joblib.
    dask : str, optional
        Address of a dask scheduler, or `LOCAL` for one of this machine with `jobs` processes; '': no dask.
    done : callable, optional
        Takes the number of finished runs.

    Raises
    ------
    ConfigError
        joblib or dask is missing, or there is no such scheduler; one line.
    """
    numbered = list(enumerate(items))
    if dask:
        finished = _with_dask(run, numbered, jobs, dask)
    elif jobs == 1 or len(items) == 1:
        finished = ((number, run(item)) for number, item in numbered)
    else:
        finished = _with_joblib(run, numbered, jobs)
    found: dict[int, Result] = {}
    for number, result in finished:
        found[number] = result
        done(len(found))
    return [found[number] for number in range(len(items))]


def _numbered(run: Callable[[Item], Result], number: int, item: Item) -> tuple[int, Result]:
    return number, run(item)


def _with_joblib(
    run: Callable[[Item], Result], numbered: Sequence[tuple[int, Item]], jobs: int
) -> Iterator[tuple[int, Result]]:
    try:
        import joblib  # noqa: PLC0415  optional
    except ImportError as error:
        raise ConfigError("several processes need joblib: pip install joblib") from error
    parallel = joblib.Parallel(n_jobs=jobs or -1, return_as="generator_unordered")
    yield from parallel(joblib.delayed(_numbered)(run, number, item) for number, item in numbered)


def _with_dask(
    run: Callable[[Item], Result], numbered: Sequence[tuple[int, Item]], jobs: int, address: str
) -> Iterator[tuple[int, Result]]:
    try:
        from distributed import Client, as_completed  # noqa: PLC0415  optional
    except ImportError as error:
        raise ConfigError("dask is missing: pip install distributed") from error
    local = {"n_workers": jobs or None, "threads_per_worker": 1, "dashboard_address": None}
    try:
        client = Client(**local) if address == LOCAL else Client(address, timeout=CONNECTION_TIMEOUT)
    except (OSError, ValueError) as error:
        raise ConfigError(f"no dask scheduler at {address}: {' '.join(str(error).split())}") from error
    with client:
        futures = [client.submit(_numbered, run, number, item, pure=False) for number, item in numbered]
        for future in as_completed(futures):
            yield future.result()


def flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row without mappings in it: the names of both levels joined.

    Parameters
    ----------
    row : mapping
        Values by name.

    Examples
    --------
    >>> flat({"scene": "press", "error_mm": {"mean": 0.1}})
    {'scene': 'press', 'error_mm_mean': 0.1}
    """
    found: dict[str, Any] = {}
    for name, value in row.items():
        found.update(
            {f"{name}_{key}": each for key, each in value.items()} if isinstance(value, Mapping) else {name: value}
        )
    return found


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as CSV with one line of names; None is an empty cell.

    Parameters
    ----------
    rows : sequence of mapping
        Values by name; all have the same names.
    """
    cells = [flat(row) for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(cells[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(cells)
    return text.getvalue()


def as_json(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as a JSON list of objects.

    Parameters
    ----------
    rows : sequence of mapping
        Values by name.
    """
    return json.dumps([dict(row) for row in rows], indent=2) + "\n"


FORMATS: Final = {".csv": as_csv, ".json": as_json}
"""How a table is written, by the end of the file's name."""


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a table in the format that the file's name asks for.

    Parameters
    ----------
    path : Path
        File to write, with an end in `FORMATS`.
    rows : sequence of mapping
        Values by name.
    """
    write_text(path, FORMATS[path.suffix](rows))
