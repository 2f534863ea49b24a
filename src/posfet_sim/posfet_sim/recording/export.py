# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recordings as tables for learning: NumPy (.npz), HDF5 (.h5), Parquet (.parquet)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from posfet_model.calibration.calibration_file import check_writable
from posfet_model.config import ConfigError
from posfet_sim.recording.columns import Columns
from posfet_sim.recording.mcap_reader import Recording, Topic
from posfet_sim.recording.ros2msg import parse_schema

BATCH: Final = 5000
"""Messages that are written to a Parquet file at once."""


class Export:
    """Reads messages of a recording for a table.

    Parameters
    ----------
    path : Path
        Path of the recording.
    topics : sequence of str, optional
        Topics, in full or as their last parts; default: all.

    Raises
    ------
    ConfigError
        The recording cannot be read or has no such topic; one line.
    """

    def __init__(self, path: Path, topics: Sequence[str] = ()) -> None:
        self.recording = Recording(path)
        """The file."""
        overview = self.recording.overview()
        if not overview.topics:
            raise ConfigError(self.recording.missing or f"{path}: has no messages")
        self.messages = overview.messages
        """Number of messages in it."""
        self.topics = _chosen(path, list(overview.topics), topics)
        """Names of the topics that are exported."""
        self.problems: list[str] = []
        """What could not be read, each in one line."""

    def rows(self, at: Callable[[int], object]) -> Iterator[tuple[Topic, int, dict[str, Any]]]:
        """Iterate over topic, time [ns] and fields of the messages. Topics that cannot be read are left out.

        Parameters
        ----------
        at : callable
            Called with the position in the file [byte] now and then.

        Yields
        ------
        tuple of Topic, int, dict
            Topic, time at which it was recorded [ns], and the fields of a message.
        """
        bad: set[str] = set()
        schemas: dict[str, tuple[str, str]] = {}
        for message in self.recording.messages(at):
            topic = message.topic
            if topic.name not in self.topics or topic.name in bad:
                continue
            try:
                if schemas.setdefault(topic.name, (topic.type, topic.schema)) != (topic.type, topic.schema):
                    raise ValueError("its messages change their type")
                values = topic.reader.read(message.data)
            except ValueError as error:
                bad.add(topic.name)
                self.problems.append(f"{topic.name}: {error}; its messages from there on are left out")
                continue
            yield topic, message.time, values
        if self.recording.missing:
            self.problems.append(self.recording.missing)


def _chosen(path: Path, known: list[str], wanted: Sequence[str]) -> list[str]:
    found = []
    for name in wanted:
        matching = [topic for topic in known if topic == name or topic.endswith(f"/{name.strip('/')}")]
        if not matching:
            raise ConfigError(f"{path}: has no topic {name}, but {', '.join(known)}")
        found += matching
    return found or known


def to_arrays(export: Export, at: Callable[[int], object] = lambda _: None) -> dict[str, Any]:
    """Return the messages as arrays by name, such as `tactile/raw/counts`, with `recorded_ns` for each topic.

    Parameters
    ----------
    export : Export
        What to read.
    at : callable, optional
        Called with the position in the file [byte] now and then.
    """
    columns: dict[str, Columns] = {}
    times: dict[str, list[int]] = {}
    for topic, time, values in export.rows(at):
        if topic.name not in columns:
            columns[topic.name] = Columns(parse_schema(topic.type, topic.schema), topic.type)
            times[topic.name] = []
        columns[topic.name].add(values)
        times[topic.name].append(time)
    arrays: dict[str, Any] = {}
    for name, table in columns.items():
        arrays[f"{name.strip('/')}/recorded_ns"] = np.asarray(times[name], np.int64)
        arrays |= table.arrays(name.strip("/"))
    return arrays


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield the path of a file beside this one, which it replaces once it is whole; otherwise it is removed."""
    part = check_writable(path).with_name(f".posfet-{os.urandom(8).hex()}")
    try:
        yield part
        with _writing(path):
            os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Name the file that was asked for in an OSError, which names its part or nothing."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def write_npz(path: Path, export: Export, at: Callable[[int], object]) -> list[Path]:
    """Write one .npz file and return its path; `numpy.load` reads it without pickles.

    Parameters
    ----------
    path : Path
        Path of the file.
    export : Export
        What to read.
    at : callable
        Called with the position in the file [byte] now and then.
    """
    with _replacing(path) as part:
        arrays = to_arrays(export, at)
        with _writing(path), part.open("wb") as stream:
            np.savez_compressed(stream, **arrays)
    return [path]


def write_hdf5(path: Path, export: Export, at: Callable[[int], object]) -> list[Path]:
    """Write one HDF5 file with a group for each topic and a dataset for each array, and return its path.

    Parameters
    ----------
    path : Path
        Path of the file.
    export : Export
        What to read.
    at : callable
        Called with the position in the file [byte] now and then.
    """
    h5py = _package("h5py", path)
    with _replacing(path) as part, _writing(path), h5py.File(part, "w") as file:
        for name, array in to_arrays(export, at).items():
            text = array.dtype.kind == "U"
            file.create_dataset(
                name, data=array.astype(object) if text else array, dtype=h5py.string_dtype() if text else None
            )
    return [path]


def write_parquet(path: Path, export: Export, at: Callable[[int], object]) -> list[Path]:
    """Write one Parquet file for each topic, its name before the suffix, and return their paths.

    Messages within messages are structs, lists of them lists of structs.

    Parameters
    ----------
    path : Path
        Path of the file; of one topic alone it is used as it is.
    export : Export
        What to read.
    at : callable
        Called with the position in the file [byte] now and then.
    """
    arrow, parquet = _package("pyarrow", path), _package("pyarrow.parquet", path)
    rows: dict[str, list[dict[str, Any]]] = {}
    schemas: dict[str, Any] = {}
    writers: dict[str, Any] = {}
    paths: dict[str, Path] = {}

    def flush(name: str) -> None:
        table = arrow.Table.from_pylist(rows[name], schema=schemas[name])
        with _writing(paths[name]):
            writers[name].write_table(table)
        rows[name].clear()

    def close(name: str) -> None:
        with _writing(paths[name]):
            writers[name].close()

    with ExitStack() as files, ExitStack() as opened:  # closed first
        for topic, time, values in export.rows(at):
            name = topic.name
            if name not in writers:
                schemas[name] = _arrow_schema(arrow, parse_schema(topic.type, topic.schema), topic.type)
                one = len(export.topics) == 1
                paths[name] = path if one else path.with_suffix(f".{name.strip('/').replace('/', '.')}{path.suffix}")
                part = files.enter_context(_replacing(paths[name]))
                with _writing(paths[name]):
                    writers[name] = parquet.ParquetWriter(part, schemas[name])
                opened.callback(close, name)
                rows[name] = []
            rows[name].append({"recorded_ns": time, **values})
            if len(rows[name]) == BATCH:
                flush(name)
        for name in writers:
            flush(name)
    return list(paths.values())


def _arrow_schema(arrow: Any, definitions: Any, name: str) -> Any:
    """Return the Arrow schema of a message; NumPy arrays as values are taken as they are."""

    def kind(field: Any) -> Any:
        if field.type == "string":
            inner = arrow.string()
        elif field.type in definitions:
            inner = arrow.struct([(each.name, kind(each)) for each in definitions[field.type]])
        else:
            names = {"byte": "uint8", "char": "uint8", "bool": "bool_"}
            inner = getattr(arrow, names.get(field.type, field.type))()
        return arrow.list_(inner) if field.many else inner

    return arrow.schema([("recorded_ns", arrow.int64()), *((each.name, kind(each)) for each in definitions[name])])


def _package(name: str, path: Path) -> Any:
    from importlib import import_module  # noqa: PLC0415

    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ConfigError(
            f"{path}: needs the package {package}: pip install {package}; .npz needs no further package"
        ) from error


FORMATS: Final[dict[str, Callable[[Path, Export, Callable[[int], object]], list[Path]]]] = {
    ".npz": write_npz,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
    ".parquet": write_parquet,
}
"""Writers by suffix."""
