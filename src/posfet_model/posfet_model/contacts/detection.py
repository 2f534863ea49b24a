# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contact detection: regions of the force map above a threshold, with centre of pressure, force and shape.

A taxel enters a contact at the enter threshold and stays in it until its force falls below the release threshold
(hysteresis); both rise with the uncertainty of the force. One more ring of taxels around a contact counts toward force
and moments, without being listed: the threshold would otherwise truncate the contact's flanks asymmetrically.

Compiled: `posfet_core`, detection.hpp and what it includes.
"""

from __future__ import annotations

from typing import Final

from posfet_core import scan_path
from posfet_core.contact import Region
from posfet_model._lib.types import Array, Mask
from posfet_model.sensor.description import ContactThresholds, Sensor
from posfet_model.sensor.grid import compiled_layout

__all__ = ["ENTER_DEVIATIONS", "ContactFinder", "ForceEstimate", "Region"]

ENTER_DEVIATIONS: Final = scan_path.ENTER_DEVIATIONS
"""Standard deviations above zero from which a force begins a contact [1]."""


class ForceEstimate(scan_path.ForceEstimate):
    """Forces of all taxels with their uncertainty.

    Forces may be overwritten from scan to scan. Any other change requires a new object.

    Parameters
    ----------
    force : ndarray of float64, shape [rows * cols]
        Force [N], positive when pushed; kept by reference.
    variance : ndarray of float64, shape [rows * cols]
        Variance of each force that it does not share with others [N2]; kept by reference.
    saturated : ndarray of bool, shape [rows * cols], optional
        Taxels whose force is a lower bound.
    unlisted : ndarray of bool, shape [rows * cols], optional
        Taxels that count toward force and moments, but are listed in no contact.
    interpolated : ndarray of bool, shape [rows * cols], optional
        Those among them whose force is interpolated from their neighbours, and that are no region by themselves.
    correlated_error : ndarray of float64, shape [rows * cols, causes], optional
        Factor E of the covariance E E' that the forces have in common [N].
    """

    def __init__(
        self,
        force: Array,
        variance: Array,
        saturated: Mask | None = None,
        unlisted: Mask | None = None,
        interpolated: Mask | None = None,
        correlated_error: Array | None = None,
    ) -> None:
        super().__init__(force, variance, saturated, unlisted, interpolated, correlated_error)


class ContactFinder(scan_path.ContactFinder):
    """Detects contacts scan by scan, with hysteresis.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    """

    def __init__(self, sensor: Sensor) -> None:
        contact = sensor.contact
        spread = sensor.device.contact_spread
        super().__init__(
            compiled_layout(sensor.layout), spread, contact.threshold, contact.threshold - contact.deadband
        )

    def set_thresholds(self, contact: ContactThresholds) -> None:
        """Use other thresholds from the next `update_thresholds` on.

        Parameters
        ----------
        contact : ContactThresholds
            Thresholds of a taxel without uncertainty.
        """
        self.change_thresholds(contact.threshold, contact.threshold - contact.deadband)
