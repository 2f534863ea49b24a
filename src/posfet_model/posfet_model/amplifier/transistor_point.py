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
