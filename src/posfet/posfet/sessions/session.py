# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A session: the scans of one sensor through the model, as contacts, images, wrenches or all of it."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from posfet.sessions.arrays import Arrays, collect
from posfet.sessions.feeds import Feed
from posfet.sessions.frames import Contact, Contacts, Frame, GroundTruth, Image, Wrench
from posfet_model._lib.units import NANOSECONDS
from posfet_model._lib.validation import real_number
from posfet_model.contacts.slip import Motion
from posfet_model.contacts.tracker import Contact as TrackedContact
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor, Tare, total_reasons
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.surface import Surface, wrench_per_newton

_AT_REST = Motion()


class _Step(NamedTuple):
    """One scan after the model."""

    scan: Scan
    result: Reconstruction
    truth: Callable[[], GroundTruth | None]
    time: float
    """Since the first scan of the session [s]."""


class _Timed(Protocol):
    """What has a time."""

    @property
    def time(self) -> float:
        """Time [s]."""
        ...


_TimedT = TypeVar("_TimedT", bound=_Timed)


class Session:
    """The scans of one sensor, one after the other, with forces and contacts: an iterator of `Frame`.

    Made by `posfet.simulate`, `posfet.open` and `posfet.replay`. A session has one position, like a file: each of
    `frames`, `contacts`, `images`, `wrench`, `scans`, `truth`, `arrays` and `record` goes on at the next scan, and only
    what is asked for is computed. Used by one thread. A context manager that closes what was opened.

    Parameters
    ----------
    feed : Feed
        Source of the scans.
    reconstructor : Reconstructor
        Model of the sensor.

    Examples
    --------
    >>> import posfet
    >>> with posfet.simulate("press", seed=1) as session:
    ...     largest = max(image.total for image in session.images() if image.valid)
    >>> 1.5 < largest < 2.5  # newtons, of 2 N in the scene
    True
    """

    def __init__(self, feed: Feed, reconstructor: Reconstructor) -> None:
        self._feed = feed
        self._model = reconstructor
        self._scans = feed.scans()
        self._closed = False
        self._finalizer = weakref.finalize(self, feed.close)  # also without `with`
        self._begin: int | None = None  # stamp of the first scan [ns]
        layout = feed.sensor.layout
        self._shape = layout.rows, layout.cols
        self._surface = Surface.of(layout)
        self._wrench_per_newton = wrench_per_newton(layout)

    @property
    def sensor(self) -> Sensor:
        """Description of the sensor: `layout` with rows, cols, pitches and positions [m], contact thresholds, rates."""
        return self._feed.sensor

    @property
    def simulated(self) -> bool:
        """Whether the signals come from a model instead of a device."""
        return self._feed.simulated

    @property
    def model(self) -> Reconstructor:
        """The model, with its counters and its calibration."""
        return self._model

    @property
    def state(self) -> str:
        """State of the source in one line, such as the number of scans, and what is missing."""
        return "closed" if self._closed else self._feed.report()

    def frames(self) -> Iterator[Frame]:
        """Iterate over everything about each scan.

        Yields
        ------
        Frame
            Scan, contacts, image, wrench and ground truth.

        Raises
        ------
        SourceError
            No scan of a real board has arrived in time; iterate again to go on waiting.
        """
        for step in self._steps():
            contacts, image, wrench = self._contacts(step), self._image(step), self._wrench(step)
            yield Frame(*self._stamp(step), step.scan.snapshot(), contacts, image, wrench, step.truth())

    __iter__ = frames

    def contacts(self) -> Iterator[Contacts]:
        """Iterate over the contacts of each scan.

        Returns
        -------
        iterator of Contacts
            A sequence of `Contact`, empty while nothing touches.
        """
        return map(self._contacts, self._steps())

    def images(self) -> Iterator[Image]:
        """Iterate over the force image of each scan.

        Returns
        -------
        iterator of Image
            Force, standard uncertainty [N] and status of each taxel, shape [rows, cols].
        """
        return map(self._image, self._steps())

    def wrench(self) -> Iterator[Wrench]:
        """Iterate over the total force and torque of each scan.

        Returns
        -------
        iterator of Wrench
            Force [N] and torque [N m] with covariance.
        """
        return map(self._wrench, self._steps())

    def scans(self) -> Iterator[Scan]:
        """Iterate over the scans as acquired, which the model processes, too.

        Returns
        -------
        iterator of Scan
            Counts, shape [rows * cols], temperatures [degC], stamp [ns], device time [us] and status.
        """
        return (step.scan.snapshot() for step in self._steps())

    def truth(self) -> Iterator[GroundTruth]:
        """Iterate over the ground truth of a simulated board.

        Returns
        -------
        iterator of GroundTruth
            Force on each taxel [N], shape [rows, cols], temperatures and objects.

        Raises
        ------
        ValueError
            The scans are those of a real board.
        """
        if not self.simulated:
            raise ValueError(f"{self._feed.name}: a real board has no ground truth")
        known = (step.truth() for step in self._steps())
        return (truth for truth in known if truth is not None)

    def arrays(self, seconds: float | None = None) -> Arrays:
        """Collect the scans to come as arrays with one row for each.

        Parameters
        ----------
        seconds : float, optional
            Duration [s]; default: up to the end.

        Returns
        -------
        Arrays
            Times [s], forces [N], contacts and ground truth.

        Raises
        ------
        ValueError
            The session is endless, and no duration is given.
        """
        return collect(self._during(seconds, self.frames()), *self._shape)

    def record(self, path: str | Path, seconds: float | None = None) -> int:
        """Write the scans to come, and their ground truth, to an MCAP file; needs the package mcap.

        `posfet.replay`, `posfet replay`, `posfet export`, rosbag2, Foxglove and PlotJuggler read it.

        Parameters
        ----------
        path : str or Path
            File to write; it must not exist.
        seconds : float, optional
            Duration [s]; default: up to the end.

        Returns
        -------
        int
            Number of scans written.

        Raises
        ------
        ConfigError
            The file cannot be written; one line.
        ValueError
            The session is endless, and no duration is given.
        """
        from posfet.sessions.recording import write_scans  # noqa: PLC0415  # only recording needs mcap

        steps = self._during(seconds, self._steps())
        return write_scans(Path(path), ((step.scan, step.truth()) for step in steps), *self._shape)

    def tare(self, force: bool = False) -> Tare:
        """Set the forces to zero while nothing touches; refused under load, and while offsets are unknown.

        Parameters
        ----------
        force : bool, optional
            Set them to zero in any case.

        Returns
        -------
        Tare
            Whether it was done, and why not, in one line.
        """
        return self._model.tare(force)

    def close(self) -> None:
        """Close the source; may be called twice."""
        self._closed = True
        self._finalizer()

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<posfet.Session {self.state}>"

    def _steps(self) -> Iterator[_Step]:
        """Iterate over the scans after the model, but for duplicates; results are overwritten by the next one."""
        model = self._model
        while True:
            if self._closed:
                raise ValueError("the session is closed")
            delivered = next(self._scans, None)
            if delivered is None:
                return
            scan, truth = delivered
            result = model.process(scan)
            if result.accepted or result.unusable:
                if self._begin is None:
                    self._begin = scan.stamp
                yield _Step(scan, result, truth, (scan.stamp - self._begin) / NANOSECONDS)

    def _during(self, seconds: float | None, steps: Iterator[_TimedT]) -> Iterator[_TimedT]:
        """Return the steps of a duration from the next scan on."""
        if seconds is None:
            if self._feed.endless:
                raise ValueError(f"{self._feed.name} does not end: seconds must be given")
            return steps
        length = real_number("seconds", seconds, 0.0, exclusive=True)
        return _within(length - 1.5 / self.sensor.can.scan_rate, steps)

    def _stamp(self, step: _Step) -> tuple[float, int, int, bool]:
        return step.time, step.result.stamp, step.result.sequence, step.result.valid

    def _contacts(self, step: _Step) -> Contacts:
        result = step.result
        items = tuple(self._contact(each, result.motions.get(each.id, _AT_REST)) for each in result.contacts)
        return Contacts(*self._stamp(step), items, result.reasons)

    def _contact(self, tracked: TrackedContact, motion: Motion) -> Contact:
        region, surface = tracked.region, self._surface
        x, y = region.centre_of_pressure
        return Contact(
            id=tracked.id,
            state=tracked.state,
            position=np.array(surface.point(x, y)),
            normal=np.array(surface.normal(x, y)),
            force=region.force,
            force_std=math.sqrt(region.force_variance),
            area=region.area,
            peak_pressure=region.peak_pressure,
            velocity=np.array(surface.along(x, y, tracked.velocity)),
            age=tracked.age,
            slipping=motion.slipping,
            vibration=motion.vibration,
            taxels=region.taxels.copy(),
        )

    def _image(self, step: _Step) -> Image:
        image, shape = self._model.image(), self._shape
        return Image(
            *self._stamp(step),
            image.force.reshape(shape).copy(),
            image.standard_deviation.reshape(shape).copy(),
            image.status.reshape(shape).copy(),
            image.total,
            image.total_standard_deviation,
        )

    def _wrench(self, step: _Step) -> Wrench:
        image = self._model.image()
        known = not total_reasons(step.result, image)
        whole = self._wrench_per_newton @ image.load if known else np.full(6, math.nan)
        covariance = self._model.covariance(self._wrench_per_newton) if known else np.full((6, 6), math.nan)
        time, stamp, sequence, _ = self._stamp(step)
        return Wrench(time, stamp, sequence, known, whole[:3], whole[3:], covariance)


def _within(length: float, steps: Iterator[_TimedT]) -> Iterator[_TimedT]:
    """Yield the steps up to the first that is `length` [s] or more after the first one."""
    end = math.inf
    for step in steps:
        if end == math.inf:
            end = step.time + length
        yield step
        if step.time >= end:
            return
