# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recordings that are started and stopped in the browser."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

from posfet.record import Recorder
from posfet_model.config import ConfigError

TOPICS: Final = ("raw", "info", "contacts", "/diagnostics")
"""Topics that are recorded: enough to replay, and few, since a message that nobody subscribes to is not computed."""


class Recording:
    """Recordings of one sensor, one at a time, in the folder in which the process was started.

    Parameters
    ----------
    namespace : str
        Namespace of the sensor.
    """

    def __init__(self, namespace: str) -> None:
        self._namespace = namespace
        self._recorder: Recorder | None = None

    @property
    def running(self) -> bool:
        """Whether a recording goes on."""
        return self._recorder is not None and self._recorder.running

    def start(self) -> str:
        """Begin to record, and return where; ConfigError, one line, if it is running already."""
        if self.running:
            raise ConfigError("is being recorded already")
        name = f"posfet_{self._namespace.replace('/', '-')}_{time.strftime('%Y-%m-%d_%H-%M-%S')}.mcap"
        recorder = Recorder(Path(name).absolute(), [self._namespace], TOPICS)
        recorder.start()
        self._recorder = recorder
        return f"recording to {recorder.path}"

    def stop(self) -> str:
        """End the recording, and return its summary; ConfigError, one line, if it failed or there is none."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            raise ConfigError("nothing is being recorded")
        return recorder.stop()
