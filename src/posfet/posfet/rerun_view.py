# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Snapshots for rerun: `posfet view --rerun`, with the optional package rerun-sdk."""

from __future__ import annotations

import argparse
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Final

import numpy as np

from posfet.array_view import ArrayView
from posfet.snapshot import Snapshot, SnapshotSource
from posfet_model.config import ConfigError

PERIOD: Final = 1 / 30
"""Period of the snapshots [s]."""
CLOSING_TIMEOUT: Final = 10.0
"""Longest wait for what is still to be written at the end [s]."""
MILLI: Final = 1e3
Sensor = tuple[str, SnapshotSource, Callable[[], ArrayView | None]]
"""Name, source of snapshots, and a function that returns the description, None while it is unknown."""


def add_rerun_arguments(parser: argparse.ArgumentParser) -> None:
    """Add `--rerun` and `--rerun-file` to a command line.

    Parameters
    ----------
    parser : ArgumentParser
        The command line.
    """
    parser.add_argument("--rerun", action="store_true", help="show it in the viewer of rerun (pip install rerun-sdk)")
    parser.add_argument("--rerun-file", metavar="FILE", help="write a file for that viewer: .rrd")


@contextmanager
def rerun_view(sensors: Sequence[Sensor], viewer: bool, file: str | None) -> Iterator[None]:
    """Log snapshots of sensors to rerun during the block.

    Parameters
    ----------
    sensors : sequence of Sensor
        What to log.
    viewer : bool
        Whether to open the viewer.
    file : str, optional
        File to write instead.

    Raises
    ------
    ConfigError
        One line, if rerun is not installed, or viewer or file cannot be opened.
    """
    if not viewer and file is None:
        yield
        return
    stream = _opened(file)
    stop = threading.Event()
    newest = dict.fromkeys((name for name, _, _ in sensors), -1)

    def run() -> None:
        while not stop.wait(PERIOD):
            for name, source, array in sensors:
                snapshot = source.snapshot()
                if snapshot is not None and snapshot.sequence != newest[name]:
                    newest[name] = snapshot.sequence
                    log(stream, name, snapshot, array())

    thread = threading.Thread(target=run, name="rerun", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        stream.flush(timeout_sec=CLOSING_TIMEOUT)
        stream.disconnect()


def _rerun() -> Any:
    try:
        return import_module("rerun")
    except ModuleNotFoundError as error:
        raise ConfigError("--rerun: needs the package rerun-sdk: pip install rerun-sdk") from error


def _opened(file: str | None) -> Any:
    """Return a stream to the viewer, or to a file."""
    stream = _rerun().RecordingStream("posfet")
    try:
        if file is None:
            stream.spawn()
        else:
            stream.save(file)
    except (OSError, RuntimeError) as error:
        raise ConfigError(f"--rerun: {file or 'the viewer'} cannot be opened: {str(error).splitlines()[0]}") from error
    return stream


def log(stream: Any, name: str, snapshot: Snapshot, array: ArrayView | None) -> None:
    """Log one snapshot.

    Parameters
    ----------
    stream : RecordingStream
        Where to.
    name : str
        Namespace of the sensor: the root of its entities.
    snapshot : Snapshot
        What to log.
    array : ArrayView, optional
        Description; without it there is no place for contacts in the image.
    """
    rerun = _rerun()
    stream.set_time("acquired", timestamp=np.datetime64(snapshot.stamp, "ns"))
    force = snapshot.force.reshape(snapshot.rows, snapshot.cols)[::-1].astype("float32")  # y of an image points down
    stream.log(f"{name}/force", rerun.DepthImage(force, meter=1.0, colormap="viridis"))
    stream.log(f"{name}/total_force", rerun.Scalars(snapshot.total_force))
    stream.log(f"{name}/total_force/two_sigma", rerun.Scalars(2 * snapshot.total_standard_deviation))
    stream.log(f"{name}/valid", rerun.Scalars(float(snapshot.data_valid)))
    if array is None:
        return

    def place(x: float, y: float) -> tuple[float, float]:
        """Return the pixel of the force image that shows a point of the surface."""
        return x / array.pitch[0] + 0.5 * snapshot.cols, 0.5 * snapshot.rows - y / array.pitch[1]

    stream.log(
        f"{name}/force/contacts",
        rerun.Points2D(
            [place(contact.x, contact.y) for contact in snapshot.contacts],
            radii=0.15,
            labels=[
                f"#{contact.id} {contact.force:.2f} N at ({contact.x * MILLI:+.2f}, {contact.y * MILLI:+.2f}) mm"
                for contact in snapshot.contacts
            ],
        ),
    )
    stream.log(f"{name}/force/truth", rerun.Points2D([place(true.x, true.y) for true in snapshot.truth], radii=0.08))
