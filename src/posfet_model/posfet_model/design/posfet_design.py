# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The whole sensor element as one object: film, transistor, poling, bias, amplifier, load, ADC and band.

Every number may be an array: arrays broadcast, so that one object is a single design, a sweep, or a tolerance analysis.
What follows from the numbers is in `DesignFigures`, `AmplifierFigures` and `NoiseBudget`; `report` lists it all.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from posfet_model.amplifier.calibration import calibrate_circuit
from posfet_model.amplifier.circuit_figures import circuit_figures
from posfet_model.amplifier.closed_loop import FollowerLimits
from posfet_model.amplifier.ringing_follower import RingingFollower
from posfet_model.amplifier.transient_follower import CircuitFollower
from posfet_model.design.design_figures import DesignFigures
from posfet_model.design.margins_in_use import quiet_range
from posfet_model.design.op_amp import named_circuit
from posfet_model.device.taxel_fields import plausible_fields
from posfet_model.spice import netlist
from posfet_model.spice.circuits import Circuit


@dataclass(frozen=True, kw_only=True, eq=False)
class PosfetDesign(DesignFigures):
    """A sensor element from the film to the ADC, or many: any number may be an array.

    The defaults are the paper's device with the bias of circuit B (docs/device.md); M1 and M2 have the size of the
    transistor below the film, `gate_width` and `gate_length`.

    Raises
    ------
    ValueError
        A value is not a real number, not plausible in its SI unit, or the shapes of arrays do not broadcast.

    Examples
    --------
    >>> design = PosfetDesign()
    >>> print(f"{design.amplifier.gain_db:.1f} dB, {design.amplifier.gain_pole_product / 1e6:.2f} MHz")
    52.5 dB, 4.90 MHz
    >>> thicker = PosfetDesign(film_thickness=np.array([2.5e-6, 5e-6]))
    >>> print((thicker.smallest_force * 1e6).round())
    [167.  88.]
    """

    def at(self, *index: int) -> PosfetDesign:
        """Return one design of the arrays.

        Parameters
        ----------
        *index : int
            Position in `shape`.

        Returns
        -------
        PosfetDesign
            A design of numbers.
        """
        chosen: dict[str, Any] = {
            name: float(np.broadcast_to(getattr(self, name), self.shape)[index]) for name in plausible_fields(self)
        }
        if self.poling_voltages is not None:
            chosen["poling_voltages"] = tuple(
                float(np.broadcast_to(volt, self.shape)[index]) for volt in self.poling_voltages
            )
        return dataclasses.replace(self, **chosen)

    def circuit(self, name: str = "design") -> Circuit:
        """Return the circuit of a single design, for hand formulas and SPICE.

        Parameters
        ----------
        name : str, default "design"
            Name of the circuit, of letters, digits and underscores.

        Returns
        -------
        Circuit
            The circuit.

        Raises
        ------
        ValueError
            The design has arrays (use `at`), the name has other characters, or film and poling are beyond what a
            netlist can have.
        """
        self._require_single()
        return named_circuit(self, name)

    def _require_single(self) -> None:
        if self.shape:
            raise ValueError(f"the design must be a single one, got arrays of shape {self.shape}; use design.at(...)")

    def follower(self, full_scale: float | None = None) -> CircuitFollower:
        """Return the follower of a single design: the circuit, integrated over time for any input.

        Parameters
        ----------
        full_scale : float, optional
            Span of the whole input [V], where it is given in parts; needed only with `poles_known` False.

        Returns
        -------
        CircuitFollower
            The follower, with its ranges of validity.

        Raises
        ------
        ValueError
            The design has arrays (use `at`), or the span is not real or out of range.
        """
        self._require_single()
        return CircuitFollower(
            circuit=self.op_amp,
            slew_rate_known=self.slew_rate_known,
            poles_known=self.poles_known,
            full_scale=full_scale,
            known_inputs=self.known_inputs,
        )

    def linear_follower(self) -> RingingFollower:
        """Return the follower of a single design for small signals, with gain, crossing and margin of the circuit.

        Two poles and a zero, exact in time for any step and far faster than `follower`; a steeper output than the slew
        rates, and inputs out of range or at which the circuit rings, are not valid.

        Returns
        -------
        RingingFollower
            The follower, with the circuit's systematic offset.

        Raises
        ------
        ValueError
            The design has arrays (use `at`), or no operating point, is out of its range at 0 V, or its second pole
            and zero are not known.
        """
        self._require_single()
        if not self.poles_known:
            raise ValueError(
                "the design has no linear follower: gain, unity crossing and phase margin alone do not tell second "
                "pole and zero; give sizes and bias"
            )
        amplifier = self.amplifier
        ends = amplifier.lowest_input, amplifier.highest_input
        if not amplifier.stable:
            ends = amplifier.lowest_saturated_input, amplifier.highest_saturated_input
        if not np.isfinite(ends).all():
            raise ValueError(f"the design has no linear follower: {'; '.join(amplifier.validity.reasons)}")
        low, high = float(ends[0]), float(ends[1])
        if amplifier.validity.valid:
            low, high = quiet_range(self.op_amp, low, high)
        loop = circuit_figures(self.op_amp).open_loop
        return RingingFollower(
            open_loop=loop,
            offset=float(amplifier.offset / loop.closed_loop_gain),
            limits=FollowerLimits(
                v_low=low,
                v_high=high,
                slew_rate=float(np.nan_to_num(amplifier.slew_rate, nan=math.inf)),
                falling_slew_rate=float(np.nan_to_num(amplifier.falling_slew_rate, nan=math.inf)),
            ),
        )

    def with_measured(
        self,
        gain: float,
        gain_bandwidth: float,
        phase_margin: float,
        *,
        bandwidth: float | None = None,
        slew_rate: float | None = None,
        falling_slew_rate: float | None = None,
    ) -> PosfetDesign:
        """Return a single design whose op-amp has measured figures; what was not measured stays as it is.

        With two stages `load_resistance` is adjusted to the gain, with one stage `channel_length_modulation`;
        `compensation` and `load_capacitance` to unity crossing and phase margin, `zero_resistor` to the bandwidth,
        `reference_current` and `sink_width` to the slew rates (`calibrate_circuit`). With sizes, bias and load of the
        op-amp three figures suffice. Where these are not known, say so with `poles_known=False`, and with
        `slew_rate_known=False` without slew rates: then inputs that are fast or may slew are not valid, nor those
        outside of `known_inputs`.

        Parameters
        ----------
        gain : float
            Measured open-loop gain [V/V], in [1.01, 1e9].
        gain_bandwidth : float
            Measured unity crossing [Hz], in [1, 1e12].
        phase_margin : float
            Measured phase margin [degrees], in [-85, 179].
        bandwidth : float, optional
            Measured -3 dB frequency of the follower [Hz], in [1, 1e12]; two stages only.
        slew_rate : float, optional
            Measured slew rate of a rise, as in the report [V/s], in [1, 1e15].
        falling_slew_rate : float, optional
            The same of a fall [V/s]; needs `slew_rate`.

        Returns
        -------
        PosfetDesign
            The adjusted design.

        Raises
        ------
        ValueError
            The design has arrays (use `at`), an argument is not real, not finite or out of range, or no plausible
            values of these fields give these figures.

        Examples
        --------
        >>> design = PosfetDesign().with_measured(400.0, 5e6, 60.0)
        >>> print(f"{design.amplifier.phase_margin:.2f} degrees with {design.load_capacitance * 1e12:.1f} pF")
        60.00 degrees with 18.8 pF
        """
        self._require_single()
        found = calibrate_circuit(
            self.op_amp,
            gain,
            gain_bandwidth,
            phase_margin,
            bandwidth=bandwidth,
            slew_rate=slew_rate,
            falling_slew_rate=falling_slew_rate,
        )
        return dataclasses.replace(
            self,
            slew_rate_known=self.slew_rate_known or slew_rate is not None,
            reference_current=float(found.reference_current),
            sink_width=float(self.sink_width * (found.beta[..., 7] / self.op_amp.beta[..., 7])),
            zero_resistor=float(found.zero_resistor),
            load_resistance=float(found.load_resistance),
            channel_length_modulation=float(found.modulation),
            compensation=float(found.compensation),
            load_capacitance=float(found.load_capacitance),
        )

    def netlist(self, name: str = "design") -> str:
        """Return the op-amp of a single design as a SPICE subcircuit, ``.subckt opamp plus minus out``.

        Parameters
        ----------
        name : str, default "design"
            Name of the circuit, of letters, digits and underscores.

        Returns
        -------
        str
            The netlist.

        Raises
        ------
        ValueError
            As for `circuit`.
        """
        return netlist.subcircuit(self.circuit(name))
