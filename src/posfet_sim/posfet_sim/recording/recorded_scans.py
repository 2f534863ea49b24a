# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of a recording, whichever version of the stack has made it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import TEMPERATURE_SENSORS, Scan, ScanStatus
from posfet_sim.recording.mcap_reader import Message, Overview, Recording, Topic
from posfet_sim.recording.scan_messages import TRUTH

RAW: Final = "posfet_msgs/TactileRaw"
"""Type of the scans."""
INFO: Final = "posfet_msgs/TactileInfo"
"""Type of the description of an array."""
UNRELATED_LAYOUT: Final = 0
"""Layout id that no sensor has: theirs begin at 1."""
INFO_WITHIN: Final = 10_000
"""Messages among which the description of the array is looked for: it is sent before the first scan."""


class ScanMessages:
    """Makes scans of TactileRaw messages by the names of their fields.

    Fields that a message does not have keep the values of an unknown: messages of other versions are read, too.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    """

    def __init__(self, sensor: Sensor) -> None:
        layout = sensor.layout
        self._shape = layout.rows, layout.cols, layout.taxels
        self._scan = Scan.empty(layout.id, layout.taxels)
        self._unknown = np.full(TEMPERATURE_SENSORS, np.nan, np.float32)

    def scan(self, values: Mapping[str, Any]) -> Scan:
        """Return the scan of a message, which the next call overwrites; ValueError, one line, if it is none.

        Parameters
        ----------
        values : mapping of str to Any
            Fields of the message by name.
        """
        try:
            stamp = values["header"]["stamp"]
            counts = np.asarray(values["counts"], np.uint16)
            shape = int(values["rows"]), int(values["cols"]), counts.size
            scan = self._scan
            scan.stamp = int(stamp["sec"]) * NANOSECONDS + min(int(stamp["nanosec"]), NANOSECONDS - 1)
            scan.layout_id = int(values["layout_id"]) if shape == self._shape else UNRELATED_LAYOUT
            scan.sequence = int(values["sequence"])
            temperatures = np.asarray(values.get("temperatures", self._unknown), np.float32)
            scan.device_time = int(values.get("device_time", 0))
            scan.status = int(values.get("status", ScanStatus.OK))
            scan.frames_lost = int(values.get("frames_lost", 0))
            scan.stamp_uncertainty = float(values.get("stamp_uncertainty", math.nan))
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{RAW}: cannot be read as a scan: {error}") from error
        scan.counts = counts
        scan.temperatures = temperatures if temperatures.size == TEMPERATURE_SENSORS else self._unknown
        return scan


class RecordedScans:
    """The scans of one sensor in a recording.

    Parameters
    ----------
    path : Path
        Path of the recording.
    sensor : Sensor
        Sensor description.
    topic : str, optional
        Topic of the scans; default: the only one.

    Raises
    ------
    ConfigError
        The recording cannot be read, has no scans, those of several sensors, or of another one; one line.
    """

    def __init__(self, path: Path, sensor: Sensor, topic: str = "") -> None:
        self.recording = Recording(path)
        """The file."""
        self.overview: Overview = self.recording.overview()
        """What it contains."""
        if self.recording.missing and not self.overview.topics:
            raise ConfigError(self.recording.missing)
        self.topic: Topic = _raw_topic(path, self.overview, topic)
        """Topic of the scans."""
        self.problem = ""
        """After the iteration: what could not be read, in one line; '' if everything could."""
        self._sensor = sensor
        first = next(iter(self.scans()), None)
        if first is None:
            raise ConfigError(self.problem or f"{path}: has no scans")
        if first.layout_id != sensor.layout.id:
            raise ConfigError(
                f"{path}: the scans are not of layout {sensor.layout.id} of sensor '{sensor.name}'; "
                "give the sensor file that they were recorded with: sensor_file:=<file>"
            )

    def __len__(self) -> int:
        return self.overview.counts[self.topic.name]

    def scans(
        self, other: Callable[[Message], object] = lambda _: None, at: Callable[[int], object] = lambda _: None
    ) -> Iterator[Scan]:
        """Iterate over the scans in the order of the file.

        Parameters
        ----------
        other : callable, optional
            Called with each message of another topic.
        at : callable, optional
            Called with the position in the file [byte] now and then.

        Yields
        ------
        Scan
            A scan, overwritten by the next one.
        """
        messages, count = ScanMessages(self._sensor), 0
        for message in self.recording.messages(at):
            if message.topic.name != self.topic.name:
                other(message)
                continue
            try:
                scan = messages.scan(message.topic.reader.read(message.data))
            except ValueError as error:
                self.problem = f"{self.recording.path}: {error}; {count} scans before it were read"
                return
            yield scan
            count += 1
        self.problem = self.recording.missing

    def of_sensor(self, topic: Topic) -> bool:
        """Return whether a description or a ground truth is that of the sensor of these scans, not of another one.

        Each sensor has its topics in a namespace of its own. A topic in no namespace with scans, as after a remap,
        counts as one of this sensor.

        Parameters
        ----------
        topic : Topic
            Topic of the recording.
        """
        other = {_namespace(name) for name, each in self.overview.topics.items() if each.type == RAW}
        return _namespace(topic.name) not in other - {_namespace(self.topic.name)}

    def simulated(self) -> bool:
        """Return whether the scans are those of a simulated board, as its description in the file says."""
        for number, message in enumerate(self.recording.messages()):
            if message.topic.type == INFO and self.of_sensor(message.topic):
                try:
                    return bool(message.topic.reader.read(message.data).get("simulated"))
                except ValueError:
                    return False
            if number == INFO_WITHIN:
                break
        return any(topic.type == TRUTH and self.of_sensor(topic) for topic in self.overview.topics.values())


def _namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


def _raw_topic(path: Path, overview: Overview, wanted: str) -> Topic:
    found = {name: topic for name, topic in overview.topics.items() if topic.type == RAW}
    name = f"/{wanted.strip('/')}" if wanted else next(iter(found), "")
    listed = ", ".join(found)
    if not found:
        others = ", ".join(overview.topics) or "nothing"
        raise ConfigError(f"{path}: has no scans ({RAW}), but {others}; record the topic raw")
    if name not in found:
        raise ConfigError(f"{path}: has no scans on {name}, but on {listed}")
    if not wanted and len(found) > 1:
        raise ConfigError(f"{path}: has scans on {listed}; choose one: replay_topic:={name}")
    return found[name]
