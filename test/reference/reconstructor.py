# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the reconstruction, scan by scan and block by block, of parts that are references themselves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from posfet_model._lib.types import Array
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms
from reference.contacts.detection import ENTER_DEVIATIONS
from reference.estimation.force_estimator import BLOCK, ForceEstimator
from reference.mains_hum import PAUSE, MainsHum
from reference.scan_path import ScanPath
from reference.taxel_faults import INFORMATIVE, TaxelFaultDetector


class Reconstructor:
    """Forces and contacts of one sensor.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    calibration : Calibration
        Properties of each taxel.
    settings : ReconstructionSettings
        Settings.
    """

    def __init__(self, sensor: Sensor, calibration: Calibration, settings: ReconstructionSettings) -> None:
        layout, noise, self._sensor = sensor.layout, force_noise_rms(sensor), sensor
        self.estimator = ForceEstimator(sensor, settings.priors, calibration, settings.max_relative_uncertainty)
        self.estimator.touch_at_start = settings.touch_at_start
        leaking = replace(
            sensor, device=replace(sensor.device, leak_time_constant=calibration.usual_leak_time_constant)
        )
        self.faults = TaxelFaultDetector(leaking, known_dead=calibration.dead)
        offset = calibration.offset * charge_per_newton(sensor) / sensor.volts_per_newton
        self._rates, self._noise = {True: sensor.can.scan_rate, False: 0.0}, noise * charge_per_newton(sensor)
        self._settings = settings
        self.hum = self._make_hum()
        self.path = ScanPath(
            leaking, calibration.crosstalk, offset, self.hum, self.estimator.integration, 0, INFORMATIVE * noise
        )
        self.path.finder.set_thresholds(settings.contact or sensor.contact)
        self._margin = math.ceil(3.0 * sensor.device.contact_spread / min(layout.pitch_x, layout.pitch_y)) + 1
        self._informative = sensor.contact.threshold / ENTER_DEVIATIONS
        self._variance = np.zeros(layout.taxels)
        self.estimator.ignore(self.faults.faulty)
        self._choose_interpolated()
        self._set_thresholds()

    def _make_hum(self) -> MainsHum:
        return MainsHum(self._sensor.layout.taxels, self._rates[self._settings.hum_removal], self._noise)

    def process(self, scan: Scan) -> tuple[bool, bool, bool, int, int]:
        """Process a scan; return what the compiled path returns."""
        accepted = self.path.clock.counts.accepted
        result = self.path.process(scan, self._start, self._end_block)
        if self.path.clock.counts.accepted > accepted:
            self.faults.history.add(scan.counts, self.path.clock.close)
        return result

    def _end_block(self) -> None:
        if self.estimator.block_time >= BLOCK:
            self.close_block()

    def _start(self, charge: Array, interrupted: bool) -> None:
        if interrupted:
            self.estimator.interrupt()
            self.hum.forget()
        self.estimator.start(charge)

    def change(self, settings: ReconstructionSettings) -> None:
        """Use other settings."""
        before, self._settings = self._settings, settings
        if settings.hum_removal != before.hum_removal:
            self.hum = self.path.hum = self._make_hum()
        self.estimator.max_relative_uncertainty = settings.max_relative_uncertainty
        self.estimator.touch_at_start = settings.touch_at_start
        self.path.finder.set_thresholds(settings.contact or self._sensor.contact)
        self._set_thresholds()

    def tare(self) -> Array:
        """Set the forces to zero in any case; return the correction of each [N]."""
        self._end_block()
        change = self.estimator.tare(True)
        self._set_thresholds()
        return change

    def close_block(self) -> None:
        """Correct baselines away from contacts, test the taxels, and set the thresholds by the new uncertainty."""
        estimator, faults, path = self.estimator, self.faults, self.path
        duration = estimator.block_time
        touched = path.finder.touched.copy()
        near = path.finder.dilated(touched, self._margin)
        variance = estimator.steady_variance(self._variance)
        mean, charge = estimator.block_mean, estimator.residual_charge
        if not self._settings.fault_detection:
            faults.measure_noise(estimator.block_time, path.saturated, near)
        elif faults.close_block(
            estimator.block_time, mean, variance, charge, path.saturated, near, estimator.offset_known
        ):
            estimator.ignore(faults.faulty)
        estimator.set_noise_variance(faults.noise_variance)
        path.bursts.set_usual_change(faults.usual_change)
        hummed = self.hum.present
        self.hum.close_block(touched, faults.faulty | path.saturated, estimator.block_time)
        estimator.close_block(touched, [contact.region.taxels for contact in path.contacts])
        begins = estimator.age < PAUSE and not touched.any()
        if begins and not hummed and self.hum.strong:
            estimator.forget()
        self._choose_interpolated()
        self._set_thresholds(duration)

    def _choose_interpolated(self) -> None:
        """Choose the faulty taxels that are interpolated: not noisy ones that are still informative."""
        faults = self.faults
        informative = np.zeros_like(faults.faulty)
        if faults.any_faulty:
            informative = faults.informative(self._informative) & self.estimator.offset_known
            self.estimator.informative[:] = informative
        self.path.set_faulty(faults.faulty.copy(), faults.faulty & ~informative)

    def _set_thresholds(self, duration: float = 0.0) -> None:
        """Set the contact thresholds by the uncertainty of the forces, and that uncertainty itself."""
        estimator, path = self.estimator, self.path
        path.set_variance(estimator.force_variance(np.zeros_like(self._variance)))
        variance = estimator.variance(self._variance)
        variance[path.interpolated] = 0.0
        usable = estimator.offset_known | path.interpolated
        if estimator.valid and not self.faults.any_faulty:
            usable = np.ones_like(usable)
        path.finder.update_thresholds(estimator.force, variance, usable, duration)
