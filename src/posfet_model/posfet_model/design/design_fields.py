# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The numbers that describe a whole sensor element: those of the taxel, its amplifier, ADC and band."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.validation import instance, whole_number
from posfet_model.amplifier.undetermined import NEAR_REST, check_known_inputs
from posfet_model.design import readout
from posfet_model.device import paper
from posfet_model.device.taxel import Taxel
from posfet_model.device.taxel_fields import Values, quantity

PARTS: Final = ("gate", "gate", "load", "load", "tail", "mirror", "output", "sink")
"""Names of M1 to M8 in the fields of sizes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignFields(Taxel):
    """A taxel with amplifier, load, ADC and band; any number may be an array.

    Raises
    ------
    ValueError
        A value is not a real number, not plausible in its SI unit, or the shapes of arrays do not broadcast.
    """

    stages: int = 2
    """2: Miller op-amp, two stages; 1: one stage and an n-channel output follower."""
    slew_rate_known: bool = True
    """Whether the slew rates are those of the op-amp; if not, it slews otherwise, and they are unknown."""
    poles_known: bool = True
    """Whether second pole and zero are those of the op-amp, as with its sizes and bias; if not, fast inputs are not
    valid, nor those outside of `known_inputs`."""
    known_inputs: tuple[float, float] = NEAR_REST
    """Inputs [V], from one in [-1e6, 0] to one in [0, 1e6], at which the op-amp is known to be stable and in its range;
    not used where its poles are known."""
    reference_current: Values = quantity(readout.REFERENCE_CURRENT, 1e-9, 0.1)
    """Current into M6 [A]."""
    supply: Values = quantity(readout.SUPPLY, 0.5, 100)
    """Positive supply, and magnitude of the negative one [V]."""
    compensation: Values = quantity(readout.COMPENSATION, 1e-15, 1e-6)
    """Compensation capacitor Cc [F]."""
    zero_resistor: Values = quantity(readout.ZERO_RESISTOR, 0, 1e9)
    """Rz in series with Cc [ohm]; not used with one stage."""
    load_capacitance: Values = quantity(readout.LOAD_CAPACITANCE, 0, 1e-6)
    """Capacitance from the output to ground [F]."""
    load_resistance: Values = quantity(readout.LOAD_RESISTANCE, 1, 1e15)
    """Resistance from the output to ground [ohm]."""
    channel_length_modulation: Values = quantity(readout.MODULATION, 1e-6, 1)
    """lambda of all transistors [1/V]."""
    hole_mobility: Values = quantity(readout.HOLES, 1e-5, 1)
    """Mobility of the p-channel transistors [m2/(V s)]."""
    load_width: Values = quantity(readout.LOAD_WIDTH, 1e-8, 0.1)
    """Width of M3 and M4 [m]."""
    load_length: Values = quantity(readout.LOAD_LENGTH, 1e-8, 1e-2)
    """Length of M3 and M4 [m]."""
    tail_width: Values = quantity(readout.TAIL_WIDTH, 1e-8, 0.1)
    """Width of M5 [m]."""
    tail_length: Values = quantity(readout.TAIL_LENGTH, 1e-8, 1e-2)
    """Length of M5 [m]."""
    mirror_width: Values = quantity(readout.MIRROR_WIDTH, 1e-8, 0.1)
    """Width of M6 [m]."""
    mirror_length: Values = quantity(readout.MIRROR_LENGTH, 1e-8, 1e-2)
    """Length of M6 [m]."""
    output_width: Values = quantity(readout.OUTPUT_WIDTH, 1e-8, 0.1)
    """Width of M7 [m]."""
    output_length: Values = quantity(readout.OUTPUT_LENGTH, 1e-8, 1e-2)
    """Length of M7 [m]."""
    sink_width: Values = quantity(readout.SINK_WIDTH, 1e-8, 0.1)
    """Width of M8 [m]."""
    sink_length: Values = quantity(readout.SINK_LENGTH, 1e-8, 1e-2)
    """Length of M8 [m]."""
    threshold_mismatch: Values = quantity(readout.THRESHOLD_MISMATCH, 0, 1e-6)
    """Standard deviation of the difference of two thresholds, times sqrt(W*L) [V m]."""
    gain_mismatch: Values = quantity(readout.GAIN_MISMATCH, 0, 1e-6)
    """Standard deviation of the relative difference of two gain factors, times sqrt(W*L) [m]."""
    flicker_constant: Values = quantity(paper.FLICKER_CONSTANT, 0, 1e-15)
    """1/f noise of the process, K*W*L*Cox [V2 F]."""
    temperature: Values = quantity(paper.TEMPERATURE, 100, 600)
    """Temperature of the chip [K], of which only the noise is calculated; all other numbers are those at it."""
    adc_bits: Values = quantity(readout.ADC_BITS, 1, 32)
    """Resolution of the ADC [bit]."""
    adc_low: Values = quantity(readout.ADC_LOW, 0, 1e3, signed=True)
    """Lower end of the ADC's range [V]."""
    adc_high: Values = quantity(readout.ADC_HIGH, 0, 1e3, signed=True)
    """Upper end of the ADC's range [V]."""
    sampling_capacitance: Values = quantity(readout.SAMPLING_CAPACITANCE, 1e-15, 1e-6)
    """Sampling capacitor of the ADC [F]."""
    low_frequency: Values = quantity(readout.LOW_FREQUENCY, 1e-9, 1e9)
    """Lower end of the band in which noise counts [Hz]."""
    high_frequency: Values = quantity(readout.HIGH_FREQUENCY, 1e-6, 1e12)
    """Upper end of that band [Hz]."""
    signal_force: Values = quantity(readout.SIGNAL_FORCE, 1e-9, 1e5)
    """Force to which the signal-to-noise ratio refers, and which has to be measured [N]."""
    detection_sigmas: Values = quantity(readout.DETECTION_SIGMAS, 1e-3, 100)
    """Standard deviations of the noise in the smallest detectable force [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        whole_number("stages", self.stages, 1, 2)
        instance("slew_rate_known", self.slew_rate_known, bool)
        instance("poles_known", self.poles_known, bool)
        check_known_inputs(self.known_inputs)
        for low, high in (("adc_low", "adc_high"), ("low_frequency", "high_frequency")):
            if np.any(np.less_equal(getattr(self, high), getattr(self, low))):
                raise ValueError(f"{high} must be above {low}, got {_first(self, high)} and {_first(self, low)}")


def _first(design: DesignFields, name: str) -> str:
    return f"{float(np.asarray(getattr(design, name)).flat[0]):g}"
