# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Steps of a guided calibration: what to do on the rig, how far it is, and when it is enough for the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array
from posfet_model._lib.units import NANOSECONDS
from posfet_model.calibration.bench_signals import MIN_FORCE
from posfet_model.calibration.fit_checks import PRESS_TIME
from posfet_model.calibration.fit_steps import MIN_TEMPERATURE_RANGE
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan

REST: Final = 2.0
"""Duration of the rest before the presses [s]."""
HOLD: Final = 20.0
"""Duration of the long hold [s]: shorter ones give no slow poles."""
AFTER: Final = 5.0
"""Duration of the rest at the end [s]."""
DECIMATION: Final = 5
"""Number of scans for each update of the steps."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What is seen in one scan, with nominal parameters."""

    time: float
    """Time [s]."""
    force: Array
    """Force on each taxel [N], NaN where unknown, shape [rows * cols]."""
    valid: bool
    """Whether the forces are valid."""
    touching: bool
    """Whether there is a contact."""
    temperature: float
    """Mean of the chip's temperature sensors [degC], NaN: unknown."""


class Step:
    """One step.

    Parameters
    ----------
    title : str
        Name of the step.
    instruction : str
        What to do, in one line.
    optional : str, optional
        What the calibration lacks without the step; '' if it needs it.
    """

    def __init__(self, title: str, instruction: str, optional: str = "") -> None:
        self.title, self.instruction, self.optional = title, instruction, optional
        self.share = 0.0
        """Share that is done, in [0, 1]."""
        self.text = ""
        """How far it is, in one line."""

    def update(self, seen: Seen) -> None:
        """Note what is seen."""
        raise NotImplementedError


class Untouched(Step):
    """Nothing touches for some seconds."""

    def __init__(self, title: str, instruction: str, seconds: float) -> None:
        super().__init__(title, instruction)
        self._seconds = seconds
        self._since: float | None = None

    def update(self, seen: Seen) -> None:
        """Note what is seen."""
        if seen.touching or (self._since is not None and seen.time < self._since):
            self._since = None
        elif self._since is None and seen.valid:
            self._since = seen.time
        rested = 0.0 if self._since is None else seen.time - self._since
        self.share = max(self.share, min(rested / self._seconds, 1.0))
        state = "touched" if seen.touching else "waiting for valid forces" if self._since is None else "at rest"
        self.text = f"{state}, {rested:.1f} of {self._seconds:g} s"


class Presses(Step):
    """Each taxel is pressed."""

    def __init__(self, taxels: int, seconds: float) -> None:
        super().__init__(
            "presses",
            f"press the ball on the centre of each taxel in turn with {MIN_FORCE:g} N or more, better 2 N; release it "
            f"after {seconds:.1g} s or more, for as long",
        )
        self.peak = np.zeros(taxels)
        """Largest force of each taxel so far [N], nominal."""

    @property
    def missing(self) -> list[int]:
        """Taxels that have not been pressed enough."""
        return [int(taxel) for taxel in np.flatnonzero(self.peak < MIN_FORCE)]

    def update(self, seen: Seen) -> None:
        """Note what is seen."""
        self.peak = np.fmax(self.peak, seen.force)
        missing = self.missing
        self.share = 1.0 - len(missing) / len(self.peak)
        if not missing and seen.touching:
            self.share = 1.0 - 1e-3  # the last one is released first
        shown = ", ".join(map(str, missing[:10])) + ", ..." * (len(missing) > 10)
        self.text = f"missing: taxels {shown}" if missing else "all taxels pressed; release"


class Temperature(Step):
    """The temperature of the chip changes."""

    def __init__(self) -> None:
        super().__init__(
            "temperature",
            f"cool and warm the chip by {MIN_TEMPERATURE_RANGE:g} K or more, without touch",
            "pyroelectric gains are those of the sensor file",
        )
        self._low, self._high = np.inf, -np.inf

    def update(self, seen: Seen) -> None:
        """Note what is seen."""
        if np.isfinite(seen.temperature):
            self._low, self._high = min(self._low, seen.temperature), max(self._high, seen.temperature)
        width = max(self._high - self._low, 0.0)
        self.share = min(width / MIN_TEMPERATURE_RANGE, 1.0)
        self.text = f"{width:.2f} of {MIN_TEMPERATURE_RANGE:g} K"


class Hold(Step):
    """One taxel is held for long."""

    def __init__(self) -> None:
        super().__init__(
            "long hold",
            f"hold one taxel with 2 N for {HOLD:g} s, then release it",
            "relaxation and creep are not fitted",
        )
        self._since: float | None = None
        self._longest = 0.0

    def update(self, seen: Seen) -> None:
        """Note what is seen."""
        if seen.touching:
            self._since = seen.time if self._since is None else self._since
            self._longest = max(self._longest, seen.time - self._since)
        else:
            self._since = None
        self.share = min(self._longest / HOLD, 1.0 - 1e-3 * seen.touching)
        self.text = f"{self._longest:.1f} of {HOLD:g} s" + "; release" * (self._longest >= HOLD and seen.touching)


class Guide:
    """Goes through the steps as scans arrive; a step that is done is followed by the next one.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    """

    def __init__(self, sensor: Sensor) -> None:
        self.presses = Presses(sensor.layout.taxels, PRESS_TIME * sensor.device.leak_time_constant)
        """The step in which each taxel is pressed."""
        self.steps: tuple[Step, ...] = (
            Untouched("rest", "leave the sensor untouched", REST),
            self.presses,
            Temperature(),
            Hold(),
            Untouched("rest", "leave the sensor untouched", AFTER),
        )
        """All steps in their order."""
        self.index = 0
        """Index of the step; the number of steps at the end."""
        self.skipped: list[Step] = []
        """Steps that were left before they were done."""
        self.force = float("nan")
        """Total force of the newest update [N], nominal; NaN: unknown."""
        self._model = Reconstructor(sensor)
        self._scans = 0

    @property
    def step(self) -> Step | None:
        """The step; None at the end."""
        return self.steps[self.index] if self.index < len(self.steps) else None

    def skip(self) -> None:
        """Go on to the next step."""
        if self.step is not None:
            if self.step.share < 1.0:
                self.skipped.append(self.step)
            self.index += 1

    def add(self, scan: Scan) -> None:
        """Note a scan.

        Parameters
        ----------
        scan : Scan
            The scan.
        """
        result = self._model.process(scan)
        self._scans += 1
        if self._model.maintenance_due:
            self._model.run_maintenance()
        if self._scans % DECIMATION == 0 and result.accepted:
            image = self._model.image()
            temperature = float(np.mean(scan.temperatures))
            force = image.force.astype(np.float64)
            self.update(Seen(scan.stamp / NANOSECONDS, force, result.valid, bool(result.contacts), temperature))
            self.force = image.total

    def update(self, seen: Seen) -> None:
        """Note what is seen in a scan, as `add` does."""
        step = self.step
        if step is not None:
            step.update(seen)
            if step.share >= 1.0:
                self.index += 1
