# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Where the scans of a session come from: a simulated board, or a recording. A board on a bus: `board_feed`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, Protocol, TypeAlias

import numpy as np

from posfet.sessions.frames import GroundTruth
from posfet_model.sensor.description import Layout, Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.ground_truth import Truth
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.faulty_scans import FaultyScans
from posfet_sim.loads import ObjectsState
from posfet_sim.recording.mcap_reader import Message
from posfet_sim.recording.recorded_scans import RecordedScans

WAITING: Final = 64
"""Scans of a recording that wait for their ground truth, which follows them in the file."""


Delivered: TypeAlias = "tuple[Scan, Callable[[], GroundTruth | None]]"
"""A scan, which the next one overwrites, and what returns its ground truth until then; None where it is unknown."""


def no_truth() -> None:
    """Return the ground truth of a scan that has none."""


class Feed(Protocol):
    """Delivers scans one by one."""

    name: str
    """What it is, for messages."""
    sensor: Sensor
    """The sensor that the scans are of."""
    simulated: bool
    """Whether the signals come from a model instead of a device."""
    endless: bool
    """Whether it goes on until it is closed."""

    def scans(self) -> Iterator[Delivered]:
        """Iterate over the scans with their ground truth."""
        ...

    def report(self) -> str:
        """Return the state in one line."""
        ...

    def close(self) -> None:
        """Release what was opened; may be called twice."""
        ...


def ground_truth(truth: Truth, sequence: int, layout: Layout) -> GroundTruth:
    """Return the ground truth of a scan of a simulated board.

    Parameters
    ----------
    truth : Truth
        That of the board.
    sequence : int
        Sequence of the scan.
    layout : Layout
        Layout of the array.
    """
    shape = layout.rows, layout.cols
    return GroundTruth(
        sequence,
        np.array(truth.force).reshape(shape),
        truth.chip_temperature,
        truth.film_temperature,
        np.array(truth.taxel_status).reshape(shape),
        truth.objects,
    )


class SimulatedFeed:
    """The scans of a simulated board, as fast as they are computed, after the faults of its link.

    Parameters
    ----------
    board : SimulatedBoard
        The board, at its start.
    duration : float
        Simulated time [s]; inf: endless.
    seed : int
        Seed that the error model of the board is drawn from.
    """

    simulated = True

    def __init__(self, board: SimulatedBoard, duration: float, seed: int) -> None:
        self.sensor = board.sensor
        self.endless = math.isinf(duration)
        self.name = f"simulated scene '{board.loads.name}'"
        self._board, self._duration = board, duration
        self._scans = FaultyScans(board, seed)
        self._delivered = 0

    def scans(self) -> Iterator[Delivered]:
        """Iterate over the scans."""
        board, layout = self._board, self.sensor.layout
        scan = Scan.empty(layout.id, layout.taxels)
        count = math.inf if self.endless else math.ceil(self._duration * self.sensor.can.scan_rate - 1e-6)

        def truth() -> GroundTruth:
            return ground_truth(board.truth(), scan.sequence, layout)

        index = 0
        while index < count:
            for _ in range(self._scans.scan(index, scan)):
                self._delivered += 1
                yield scan, truth
            index += 1

    def report(self) -> str:
        """Return the state in one line."""
        lost = "".join(f", {count} {name}" for name, count in self._scans.counters.items() if count)
        return f"{self.name}: {self._delivered} scans{lost}"

    def close(self) -> None:
        """Do nothing: a simulated board holds nothing open."""


class RecordedFeed:
    """The scans of a recording, as fast as they are read, with the ground truth that was recorded after them.

    Parameters
    ----------
    recorded : RecordedScans
        The recording.
    sensor : Sensor
        The sensor that it is of.
    """

    endless = False

    def __init__(self, recorded: RecordedScans, sensor: Sensor) -> None:
        self.sensor = sensor
        self.simulated = recorded.simulated()
        self.name = f"{recorded.recording.path}"
        self._recorded = recorded
        self._delivered = 0

    def scans(self) -> Iterator[Delivered]:
        """Iterate over the scans."""
        topic = f"{self._recorded.topic.name.rpartition('/')[0]}/truth"
        if topic not in self._recorded.overview.topics:
            for scan in self._recorded.scans():
                self._delivered += 1
                yield scan, no_truth
            return
        truths: dict[int, GroundTruth] = {}
        waiting: deque[Scan] = deque()

        def keep(message: Message) -> None:
            if message.topic.name != topic:
                return
            try:
                truth = _recorded_truth(message.topic.reader.read(message.data), self.sensor.layout)
            except (KeyError, TypeError, ValueError):  # of another version, which does not have all fields
                return
            truths[truth.sequence] = truth

        for scan in self._recorded.scans(keep):
            waiting.append(scan.snapshot())
            while waiting and (waiting[0].sequence in truths or len(waiting) > WAITING):
                yield self._with_truth(waiting.popleft(), truths)
        for scan in waiting:
            yield self._with_truth(scan, truths)

    def _with_truth(self, scan: Scan, truths: dict[int, GroundTruth]) -> Delivered:
        self._delivered += 1
        truth = truths.pop(scan.sequence, None)
        if len(truths) > WAITING:  # those of scans that were lost
            truths.clear()
        return scan, lambda: truth

    def report(self) -> str:
        """Return the state in one line."""
        problem = f"; {self._recorded.problem}" if self._recorded.problem else ""
        return f"{self.name}: {self._delivered} of {len(self._recorded)} scans{problem}"

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""


def _recorded_truth(values: Mapping[str, Any], layout: Layout) -> GroundTruth:
    """Return a TactileTruth message as ground truth."""
    shape = layout.rows, layout.cols
    poses, contacts = values["poses"], np.asarray(values["contact_objects"], np.intp)
    return GroundTruth(
        int(values["sequence"]),
        np.asarray(values["force"], np.float64).reshape(shape),
        float(values["chip_temperature"]),
        float(values["temperature"]),
        np.asarray(values["status"], np.uint8).reshape(shape),
        ObjectsState(
            names=tuple(values["objects"]),
            positions=np.array([_vector(pose["position"], "xyz") for pose in poses]).reshape(-1, 3),
            orientations=np.array([_vector(pose["orientation"], "xyzw") for pose in poses]).reshape(-1, 4),
            contact_objects=contacts,
            contact_centres=np.array([_vector(each, "xy") for each in values["contact_centres"]]).reshape(-1, 2),
            contact_normals=np.array([_vector(each, "xyz") for each in values["contact_normals"]]).reshape(-1, 3),
            contact_forces=np.asarray(values["contact_forces"], np.float64),
        ),
    )


def _vector(values: Mapping[str, float], names: str) -> list[float]:
    return [float(values[name]) for name in names]
