# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the model reports on /diagnostics about a period of scans."""

from __future__ import annotations

from dataclasses import asdict

from posfet_model.reconstruction.diagnostics import Period, Verdict, is_silent, judge
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.reconstruction.scan_clock import ScanCounts


class ModelReport:
    """State of a reconstructor at one time; reading it takes no part in the processing of scans.

    Parameters
    ----------
    model : Reconstructor
        The reconstructor; not used after construction.
    result : Reconstruction, optional
        Its newest result; None before the first.
    """

    def __init__(self, model: Reconstructor, result: Reconstruction | None) -> None:
        self.counts = model.counts
        """Numbers of scans and events."""
        self._saturated = result.saturated if result else 0
        self._unsettled, self._restarts, self._faulty = model.unsettled, model.restarts, model.faulty
        self._temperature_known, self._rate = model.temperature_known, model.rate
        self._hum_frequency, self._hum_amplitude = model.hum_frequency, model.hum_amplitude
        self._calibration = model.calibration

    def verdict(self, before: ScanCounts, without: float) -> Verdict:
        """Return level and text for the scans since `before`.

        Parameters
        ----------
        before : ScanCounts
            Numbers at the report before.
        without : float
            Time since the last report that knew new scans [s]; 0 if this one does.

        Returns
        -------
        Verdict
            The most severe finding.
        """
        state = self._unsettled, self._saturated, self._faulty, self._temperature_known, self._calibration.calibrated
        return judge(Period.between(before, self.counts, *state, is_silent(without, self._rate)))

    def values(self, before: ScanCounts, period: float) -> dict[str, str]:
        """Return the keys and values of the status.

        Parameters
        ----------
        before : ScanCounts
            Numbers at the report before.
        period : float
            Time since then [s].
        """
        values = {name.replace("_", " "): str(count) for name, count in asdict(self.counts).items()}
        values["calibration"] = self._calibration.summary
        values["scan rate received [Hz]"] = f"{(self.counts.accepted - before.accepted) / period:.0f}"
        values["scan rate by the board's clock [Hz]"] = f"{self._rate:.1f}"
        values["taxels without a baseline"] = str(self._unsettled)
        values["taxels saturated"] = str(self._saturated)
        values["taxels dead, stuck or noisy"] = str(self._faulty)
        values["baseline restarts"] = str(self._restarts)
        values["mains hum removed, RMS [mN]"] = f"{self._hum_amplitude * 1e3:.2f}"
        values["mains hum frequency [Hz]"] = f"{self._hum_frequency:.2f}"
        return values
