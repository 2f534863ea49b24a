# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibrations of simulated boards, each made once for all tests of a run, whichever process runs them."""

from __future__ import annotations

import fcntl
import hashlib
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Final

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor
from posfet_sim.calibration import simulated_bench
from posfet_sim.device.error_model import ErrorModel

RATE: Final = 250.0
"""Scans per second of the recordings [Hz]: what is found does not depend on it, and is a third less certain than with
1000, in 40 % of the time."""


def with_rate(sensor: Sensor) -> Sensor:
    """Return a sensor that is recorded with `RATE`."""
    return replace(sensor, can=replace(sensor.can, scan_rate=RATE))


class SharedCalibrations:
    """Calibrates simulated boards like `simulated_bench.calibrate`, and keeps the results in a folder of the run."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(exist_ok=True)

    def __call__(
        self,
        sensor: Sensor,
        seed: int,
        error_model: ErrorModel | None = None,
        device: Sensor | None = None,
        long_hold: bool = True,
    ) -> Calibration:
        """Return the calibration of a board, which another process may be making: one makes it, the others wait."""
        what = repr((sensor, seed, error_model, device, long_hold))  # dataclasses of numbers and words
        path = self._folder / hashlib.sha256(what.encode()).hexdigest()
        with path.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                part = path.with_suffix(".part")
                sensor, device = with_rate(sensor), with_rate(device) if device else None
                part.write_bytes(pickle.dumps(simulated_bench.calibrate(sensor, seed, error_model, device, long_hold)))
                part.rename(path)
        found: Calibration = pickle.loads(path.read_bytes())
        return found
