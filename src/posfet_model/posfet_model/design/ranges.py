# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Whether a design measures the force that it has to: ranges of amplifier and ADC, slew rate, poling."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_model._lib.types import FloatArray, Mask
from posfet_model.amplifier.open_loop import LEAST_PHASE_MARGIN, LOW_MARGIN, MOST_OVERSHOOT, RINGS
from posfet_model.amplifier.validity import Validity
from posfet_model.design.amplifier_figures import AmplifierFigures
from posfet_model.design.design_fields import DesignFields
from posfet_model.design.margins_in_use import MarginsInUse

NOT_POLED: Final = "the film is not poled: a force gives no signal"
BEYOND_INPUT: Final = "the force to be measured drives the input out of the amplifier's range"
OSCILLATES: Final = "the force to be measured drives the input to where the follower is unstable"
LOW_MARGIN_IN_USE: Final = (
    f"the force to be measured drives the input to where the phase margin is below {LEAST_PHASE_MARGIN:g} degrees"
)
RINGS_IN_USE: Final = (
    f"the force to be measured drives the input to where a step overshoots by more than {100 * MOST_OVERSHOOT:g} %"
)
BEYOND_KNOWN: Final = (
    "the force to be measured drives the input to where figures at 0 V do not tell whether the follower is stable"
)
BEYOND_ADC: Final = "the force to be measured drives the ADC out of its range"
REST_BEYOND_ADC: Final = "the output at rest, which is the offset, is out of the ADC's range"
TOO_STEEP: Final = "the force to be measured, at the upper end of the band, is steeper than the slew rate"


def largest_force(design: DesignFields, amplifier: AmplifierFigures) -> FloatArray:
    """Return the largest compressive force within the ranges of amplifier and ADC, the former stable [N]; unchecked.

    The ADC sees the offset, too; NaN where that alone is out of its range.
    Of an op-amp of which only figures are known it is one within the inputs at which it is known to be stable.

    Parameters
    ----------
    design : DesignFields
        One design or arrays.
    amplifier : AmplifierFigures
        Figures of its op-amp.
    """
    least = np.minimum(_reach(design, amplifier, "stable"), _reach(design, amplifier, "adc"))
    return (least if design.poles_known else np.minimum(least, _reach(design, amplifier, "known")))[()]


def validity(design: DesignFields, amplifier: AmplifierFigures, margins: MarginsInUse) -> Validity:
    """Return where a design is usable, and why not; unchecked.

    Parameters
    ----------
    design : DesignFields
        One design or arrays.
    amplifier : AmplifierFigures
        Figures of its op-amp.
    margins : MarginsInUse
        The worst at the inputs that the force to be measured reaches.
    """
    saturated, stable = _reach(design, amplifier, "saturated"), _reach(design, amplifier, "stable")
    volts = np.abs(design.volts_per_newton() * design.signal_force)
    at_rest = amplifier.validity.findings
    with np.errstate(invalid="ignore"):
        return amplifier.validity.also(
            {
                NOT_POLED: np.equal(volts, 0),
                BEYOND_INPUT: np.greater(design.signal_force, saturated),
                OSCILLATES: np.greater(design.signal_force, stable) & (stable < saturated),
                LOW_MARGIN_IN_USE: (margins.phase_margin < LEAST_PHASE_MARGIN) & ~at_rest[LOW_MARGIN],
                RINGS_IN_USE: (margins.overshoot > MOST_OVERSHOOT) & ~at_rest[RINGS] & amplifier.stable,
                BEYOND_KNOWN: np.greater(design.signal_force, _reach(design, amplifier, "known"))
                & (not design.poles_known),
                BEYOND_ADC: np.greater(design.signal_force, _reach(design, amplifier, "adc")),
                REST_BEYOND_ADC: _rests_beyond_adc(design, amplifier),
                TOO_STEEP: 2 * math.pi * design.high_frequency * volts
                > np.minimum(amplifier.slew_rate, amplifier.falling_slew_rate),
            }
        )


def _reach(design: DesignFields, amplifier: AmplifierFigures, of: str) -> FloatArray:
    """Return the force [N] that reaches the end of a range of the amplifier's input, or that of the ADC behind it."""
    gain, offset = amplifier.follower_gain, amplifier.offset
    per_newton = design.volts_per_newton()
    with np.errstate(divide="ignore", invalid="ignore"):  # of a follower without gain, a film without signal
        low, high = {
            "stable": (amplifier.lowest_input, amplifier.highest_input),
            "saturated": (amplifier.lowest_saturated_input, amplifier.highest_saturated_input),
            "known": (np.float64(design.known_inputs[0]), np.float64(design.known_inputs[1])),
            "adc": ((design.adc_low - offset) / gain, (design.adc_high - offset) / gain),
        }[of]
        force = np.where(per_newton > 0, high, low) / per_newton
    if of == "adc":
        force = np.where(_rests_beyond_adc(design, amplifier), math.nan, force)
    return np.where(per_newton == 0, math.inf, force)


def _rests_beyond_adc(design: DesignFields, amplifier: AmplifierFigures) -> Mask:
    """Return where the output without a force is out of the ADC's range, so that no range begins there."""
    low, high = np.less(amplifier.offset, design.adc_low), np.greater(amplifier.offset, design.adc_high)
    beyond: Mask = np.logical_or(low, high)
    return beyond
