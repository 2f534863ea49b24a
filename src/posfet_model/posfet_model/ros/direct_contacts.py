# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts that are published by the thread that decodes the scans, without Python."""

from __future__ import annotations

from typing import Protocol

from posfet_model.reconstruction.contacts_sink import ContactsSink, Mutex
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.ros.model_outputs import ModelOutputs
from posfet_model.ros.rcl_functions import rcl_functions
from posfet_model.sensor.scan import Scan


class StreamingSource(Protocol):
    """What delivers scans, to a compiled sink if it can."""

    def read(self, timeout: float) -> Scan | None:
        """Return the next scan within `timeout` [s]."""
        ...

    def stream(self, sink: object, timeout: float) -> Scan | None:
        """Hand scans to the sink of a capsule, for up to `timeout` [s]; return a scan that it did not take."""
        ...


class DirectContacts:
    """Owns the sink of a reconstructor. All but `stream` is called with the mutex held.

    Parameters
    ----------
    outputs : ModelOutputs
        Publishes the contacts.
    mutex : Mutex
        Held while a scan is processed.
    """

    def __init__(self, outputs: ModelOutputs, mutex: Mutex) -> None:
        self._outputs, self._mutex = outputs, mutex
        self._functions = rcl_functions()
        self._sink: ContactsSink | None = None

    def close(self) -> None:
        """Have no more scans taken: reconstructor or message will be another one."""
        if self._sink is not None:
            self._sink.close()
        self._sink = None

    def open(self, reconstructor: Reconstructor, subscribed: bool) -> bool:
        """Have scans taken by a reconstructor.

        Parameters
        ----------
        reconstructor : Reconstructor
            Which has processed a scan before.
        subscribed : bool
            Whether the contacts are to be published.

        Returns
        -------
        bool
            False where contacts are not published in this way.
        """
        writer, functions = self._outputs.contacts_writer, self._functions
        if writer is None or functions is None:
            return False
        if self._sink is None:
            self._sink = reconstructor.make_sink(writer, self._mutex)
        publisher = self._outputs.contacts.handle.pointer if subscribed else 0
        self._sink.publish_with(functions.publish, functions.reset_error, publisher)
        reconstructor.vibration_wanted = False
        return True

    def stream(self, source: StreamingSource, timeout: float) -> Scan | None:
        """Have the scans of a source taken after `open`; return one that was not.

        Parameters
        ----------
        source : StreamingSource
            The source.
        timeout : float
            Longest time to wait [s].
        """
        sink = self._sink
        if sink is None:  # closed since
            return source.read(timeout)
        with self._outputs.contacts.handle:  # so that it is not destroyed meanwhile
            return source.stream(sink.capsule, timeout)

    def take_failure(self) -> bool:
        """Return whether the newest contacts could not be published."""
        return self._sink is not None and self._sink.take_failure()
