# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Operating point of a transistor as a circuit simulator reports it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TransistorPoint:
    """Currents, voltages and small-signal parameters of one transistor; magnitudes, also of p-channel ones."""

    current: float
    """Drain current [A]."""
    gate_voltage: float
    """Gate-source voltage [V]."""
    drain_voltage: float
    """Drain-source voltage [V]."""
    saturation_voltage: float
    """Drain-source voltage from which on it is saturated [V]."""
    transconductance: float
    """gm [S]."""
    output_conductance: float
    """gds [S]."""
    gate_source_capacitance: float
    """Cgs [F]."""
    gate_drain_capacitance: float
    """Cgd [F]."""
    gate_bulk_capacitance: float
    """Cgb [F]."""

    @property
    def saturated(self) -> bool:
        """Whether it is in saturation."""
        return self.drain_voltage >= self.saturation_voltage
