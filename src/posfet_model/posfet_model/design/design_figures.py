# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Figures of merit of a sensor element, or of many: all follow from the numbers of `DesignFields`."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from posfet_model._lib.types import FloatArray
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.validity import Validity
from posfet_model.design import ranges
from posfet_model.design.amplifier_figures import AmplifierFigures, amplifier_figures
from posfet_model.design.design_fields import PARTS, DesignFields
from posfet_model.design.margins_in_use import MarginsInUse, margins_in_use
from posfet_model.design.mismatch import hand_common_mode_rejection
from posfet_model.design.noise_by_source import adc_step, noise_by_source
from posfet_model.design.op_amp import op_amp_circuit
from posfet_model.device.noise import NoiseBudget


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignFigures(DesignFields):
    """Numbers of designs with what follows from them, each of the designs' shape.

    Raises
    ------
    ValueError
        A value is not a real number, not plausible in its SI unit, or the shapes of arrays do not broadcast.
    """

    @cached_property
    def amplifier(self) -> AmplifierFigures:
        """Figures of merit of the op-amp and its follower; NaN where it has no operating point."""
        figures = amplifier_figures(self.op_amp)
        if self.slew_rate_known:
            return figures
        unknown = np.full(self.op_amp.shape, math.nan)[()]
        return dataclasses.replace(figures, slew_rate=unknown, falling_slew_rate=unknown)

    @cached_property
    def op_amp(self) -> AmplifierCircuit:
        """The op-amp as a circuit, of arrays where the design has them."""
        return op_amp_circuit(self)

    @cached_property
    def margins_in_use(self) -> MarginsInUse:
        """The worst phase margin and overshoot at inputs from 0 V to that of `signal_force`, in the saturated range."""
        amplifier, wanted = self.amplifier, self.volts_per_newton() * self.signal_force
        within = np.fmax(np.fmin(wanted, amplifier.highest_saturated_input), amplifier.lowest_saturated_input)
        return margins_in_use(self.op_amp, amplifier, within)

    @cached_property
    def noise(self) -> NoiseBudget:
        """Noise by source in the band [V rms], as a voltage of the top electrode."""
        return noise_by_source(self, self.amplifier)

    @property
    def lsb(self) -> FloatArray:
        """Step of the ADC [V]."""
        return adc_step(self)

    @property
    def signal_to_noise(self) -> FloatArray:
        """Ratio of the signal of `signal_force` to the noise in the band [dB]."""
        return self.noise.signal_to_noise(self.signal_force)

    @property
    def smallest_force(self) -> FloatArray:
        """Smallest detectable force [N]; inf where a force gives no signal."""
        return self.noise.minimum_force(1.0) * self.detection_sigmas

    @property
    def output_volts_per_newton(self) -> FloatArray:
        """Sensitivity at the follower's output [V/N]."""
        return self.volts_per_newton() * self.amplifier.follower_gain

    @property
    def amperes_per_newton(self) -> FloatArray:
        """Change of the drain current of M1 per force at the bias of the pair [A/N]: gm1 times V/N, of either plane."""
        return self.amplifier.input_transconductance * self.volts_per_newton()

    @property
    def common_mode_rejection(self) -> FloatArray:
        """CMRR by a hand formula, with mismatch of one standard deviation of each pair [V/V] (`mismatch`)."""
        return hand_common_mode_rejection(self, self.amplifier)

    @property
    def low_corner(self) -> FloatArray:
        """Frequency below which the signal leaks away, 1/(2*pi*R*(Cf + Cg)) [Hz]."""
        return 1 / (2 * math.pi * self.leak_time_constant)

    @property
    def largest_force(self) -> FloatArray:
        """Largest compressive force within the ranges of amplifier and ADC [N]; inf where a force gives no signal."""
        return ranges.largest_force(self, self.amplifier)

    @property
    def power(self) -> FloatArray:
        """Power from both supplies at rest [W]; the current of the load, by the offset, is drawn from one of them."""
        amplifier = self.amplifier
        both: FloatArray = 2 * amplifier.supply_current - amplifier.offset / self.load_resistance
        return both * self.supply

    @property
    def area(self) -> FloatArray:
        """Area of the film and of the gates of M2 to M8, without wiring and capacitors [m2]."""
        gates = (np.multiply(getattr(self, f"{part}_width"), getattr(self, f"{part}_length")) for part in PARTS[1:])
        total: FloatArray = sum(gates, np.asarray(self.film_area))
        return total

    @cached_property
    def validity(self) -> Validity:
        """Where the design is usable, and why not: ringing, transistors out of saturation, ranges, slew rate."""
        return ranges.validity(self, self.amplifier, self.margins_in_use)

    @property
    def valid(self) -> Any:
        """Whether the design is usable; a mask for arrays."""
        return np.broadcast_to(self.validity.valid, self.shape)[()]

    @property
    def reasons(self) -> list[str]:
        """Why the design, or any of the arrays, is not valid; empty if it is."""
        return self.validity.reasons
