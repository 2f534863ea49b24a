# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Noise of a design by source, referred to the top electrode."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np

from posfet_model._lib.types import FloatArray
from posfet_model.design.amplifier_figures import AmplifierFigures
from posfet_model.design.design_fields import DesignFields
from posfet_model.device.noise import (
    NoiseBudget,
    gate_flicker_coefficient,
    noise_budget,
    pair_density,
    sampling_rms,
)

LEAST_TRANSCONDUCTANCE: Final = 1e-12
"""gm1 below which the input pair is cut off, and the noise unknown [S]."""

LEAST_GAIN: Final = 1e-3
"""Gain of the follower below which the noise behind it is unknown [V/V]."""


def noise_by_source(design: DesignFields, amplifier: AmplifierFigures) -> NoiseBudget:
    """Return the noise by source in the band [V rms], as a voltage of the top electrode; unchecked.

    Parameters
    ----------
    design : DesignFields
        One design or arrays.
    amplifier : AmplifierFigures
        Figures of its op-amp; noise of what has no operating point is NaN.
    """
    usable = amplifier.found & (amplifier.input_transconductance >= LEAST_TRANSCONDUCTANCE)
    usable &= (amplifier.follower_gain >= LEAST_GAIN) & (amplifier.follower_gain <= 1 / LEAST_GAIN)
    # Where it is not, the rest is computed with figures that do not matter.
    gm1 = np.where(usable, amplifier.input_transconductance, 1.0)
    gm3 = np.where(usable, amplifier.load_transconductance, 0.0)
    gain = np.where(usable, amplifier.follower_gain, 1.0)
    below = gate_flicker_coefficient(
        design.flicker_constant, design.gate_width, design.gate_length, design.oxide_capacitance
    )
    load = gate_flicker_coefficient(
        design.flicker_constant, design.load_width, design.load_length, design.oxide_capacitance
    )
    budget = noise_budget(
        design.bias_noise(design.low_frequency, design.high_frequency, design.temperature),
        pair_density(gm1, gm3, design.temperature),
        2 * (below / design.coupling**2 + load * (gm3 / gm1) ** 2),
        adc_step(design),
        np.abs(design.volts_per_newton()),
        design.low_frequency,
        design.high_frequency,
        gain=gain,
        sampled_rms=sampling_rms(design.sampling_capacitance, design.temperature),
    )
    ahead = ("thermal", "flicker", "sampling", "quantisation")
    return dataclasses.replace(
        budget, **{name: np.where(usable, getattr(budget, name), math.nan)[()] for name in ahead}
    )


def adc_step(design: DesignFields) -> FloatArray:
    """Return the step of the ADC [V]; unchecked."""
    step: FloatArray = np.subtract(design.adc_high, design.adc_low) / (np.exp2(design.adc_bits) - 1)
    return step
