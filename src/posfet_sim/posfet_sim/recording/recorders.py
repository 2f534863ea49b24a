# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""File formats of a simulated run: MCAP with ROS messages, or CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Protocol

from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.files import check_folder
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import TEMPERATURE_SENSORS, Scan
from posfet_sim.device.ground_truth import Truth, truth_columns, truth_row
from posfet_sim.recording.mcap_file import MessageFile
from posfet_sim.recording.message_definitions import schema_text
from posfet_sim.recording.scan_messages import RAW, TRUTH, ScanMessage, TruthMessage


class Recorder(Protocol):
    """Writes scans and their ground truth to a file."""

    def write(self, scan: Scan, truth: Truth) -> None:
        """Write one scan and its ground truth.

        Parameters
        ----------
        scan : Scan
            The scan.
        truth : Truth
            Ground truth of the scan.
        """
        ...

    def close(self) -> None:
        """Finish the file, so that it can be read up to here."""
        ...


class McapRecorder:
    """MCAP with the profile ros2: topics `raw` and `truth` in a namespace, CDR messages with ros2msg schemas.

    rosbag2 (storage mcap), Foxglove and PlotJuggler read it. Times are those of the stamps.

    Parameters
    ----------
    path : Path
        Path of the file.
    sensor : Sensor
        Sensor description.
    namespace : str
        Namespace of the topics, without slashes around it.

    Raises
    ------
    ConfigError
        The package mcap or a message definition is missing.
    OSError
        The file cannot be created.
    """

    def __init__(self, path: Path, sensor: Sensor, namespace: str) -> None:
        schemas = {name: schema_text(name) for name in (RAW, TRUTH)}
        layout = sensor.layout
        self._scan, self._truth = ScanMessage(layout.rows, layout.cols), TruthMessage(layout.rows, layout.cols)
        self._file = MessageFile(path, "posfet sim", overwrite=True)
        self._scans = self._file.add_topic(f"/{namespace}/raw", RAW, schemas[RAW])
        self._truths = self._file.add_topic(f"/{namespace}/truth", TRUTH, schemas[TRUTH])

    def write(self, scan: Scan, truth: Truth) -> None:
        """Write one scan and its ground truth."""
        self._file.add(self._scans, scan.stamp, self._scan.fill(scan), scan.sequence)
        self._file.add(self._truths, scan.stamp, self._truth.fill(truth, scan), scan.sequence)

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


class CsvRecorder:
    """CSV with one line per scan: stamp, sequence, device time, status, temperatures, counts, and the ground truth.

    Parameters
    ----------
    path : Path
        Path of the file.
    sensor : Sensor
        Sensor description.
    objects : sequence of str
        Names of the objects in the scene.
    """

    def __init__(self, path: Path, sensor: Sensor, objects: Sequence[str]) -> None:
        layout = sensor.layout
        check_folder(path)
        self._stream = path.open("w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._stream, lineterminator="\n")
        self._writer.writerow(
            ["stamp_s", "raw_sequence", "device_time_us", "status"]
            + [f"temperature_{index}_degC" for index in range(TEMPERATURE_SENSORS)]
            + [f"count_r{row}_c{col}" for row in range(layout.rows) for col in range(layout.cols)]
            + truth_columns(layout, objects)
        )

    def write(self, scan: Scan, truth: Truth) -> None:
        """Write one scan and its ground truth."""
        stamp = f"{scan.stamp // NANOSECONDS}.{scan.stamp % NANOSECONDS:09}"
        head = [stamp, scan.sequence, scan.device_time, int(scan.status)]
        self._writer.writerow(head + scan.temperatures.tolist() + scan.counts.tolist() + truth_row(truth))

    def close(self) -> None:
        """Finish the file."""
        self._stream.close()


FORMATS: Final = (".mcap", ".csv")
"""Supported suffixes."""


def make_recorder(path: Path, sensor: Sensor, objects: Sequence[str], namespace: str) -> Recorder:
    """Create the recorder for a file, by its suffix.

    Parameters
    ----------
    path : Path
        Path of the file, with a suffix of `FORMATS`.
    sensor : Sensor
        Sensor description.
    objects : sequence of str
        Names of the objects in the scene.
    namespace : str
        Namespace of the topics in an MCAP file.

    Returns
    -------
    Recorder
        The recorder; its file is open.

    Raises
    ------
    ConfigError
        The suffix is unknown, there is such a file, or the package mcap or a message definition is missing.
    OSError
        The file cannot be created.
    """
    if path.is_file():
        raise ConfigError(f"{path}: cannot be written: File exists; choose another name, or remove it")
    if path.suffix == ".csv":
        return CsvRecorder(path, sensor, objects)
    if path.suffix == ".mcap":
        return McapRecorder(path, sensor, namespace)
    raise ConfigError(f"{path}: must end in {' or '.join(FORMATS)}")
