# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Slewing follower model from a small-signal measurement of gain and bandwidth, without a transient run.

An op-amp of one pole and a gain-bandwidth product GBW makes a follower of the bandwidth ``GBW*(1 + 1/A0)``. A measured
bandwidth deviates from it; what that means depends on the circuit, which the user states:

- two stages: a lower bandwidth, by up to 1/sqrt(2), is due to a zero in the left half-plane, as a resistor in series
  with Cc makes. With the zero at k times the time constant the bandwidth falls by ``sqrt(1 + 2*k - k^2)``.
- one stage and an output follower: a higher one is due to the second pole; it adds no lag to slow signals.
- not stated: one pole of the measured bandwidth, or of a given gain-bandwidth product, and an assumed overdrive.

Slewing is not observable in small signals. Overdrive and quadratic lead are those of the hand formulas, with the sizes
of Table II and the bias of circuit B or C, which is assumed. With sizes and bias known, `transient_follower` is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from posfet_model._lib.validation import instance, real_number, whole_number
from posfet_model.amplifier.closed_loop import ClosedLoop, FollowerLimits, close_loop
from posfet_model.amplifier.differential_pair import NO_LEAD, Lead
from posfet_model.amplifier.follower import SquareLawFollower
from posfet_model.amplifier.one_stage import CIRCUIT_C, one_stage_figures
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.amplifier.two_stage import CIRCUIT_B, TABLE_II, AmplifierBias, AmplifierDesign, figures_of_merit
from posfet_model.device.paper import AMPLIFIER_GAIN, GAIN_BANDWIDTH

OVERDRIVE: Final = 0.39
"""Default overdrive of the differential pair of an unknown op-amp [V], assumed: between that of the two-stage op-amp,
0.47 V, and of the one-stage one, 0.32 V."""

NO_LIMITS: Final = FollowerLimits()
"""Unknown range of validity."""


@dataclass(frozen=True)
class SlewModel:
    """Parameters of a slewing follower from small signals and hand formulas."""

    amplifier: str
    """Circuit that the op-amp is assumed to have."""
    loop: ClosedLoop
    """Gain, and the bandwidth of the pole alone, which determines the lag of slow signals."""
    overdrive: float
    """Overdrive of the pair at balance [V], in [1e-6, 1e3]."""
    lead: Lead = NO_LEAD
    """Direct contribution of the pair's current to the output."""
    limits: FollowerLimits = NO_LIMITS
    """Range of validity, as far as the circuit is known. The slew rate of the model itself is no limit."""
    usable: bool = True
    """Whether the op-amp is stable with phase margin; if not, no result of the follower is valid."""

    def follower(self, overdrive: float | None = None) -> SquareLawFollower:
        """Return the follower model.

        Parameters
        ----------
        overdrive : float, optional
            Measured overdrive of the pair [V], in [1e-6, 1e3]; that of the hand formulas by default.

        Returns
        -------
        SquareLawFollower
            The follower.
        """
        return SquareLawFollower(
            gain=self.loop.gain,
            bandwidth=self.loop.bandwidth,
            overdrive=self.overdrive if overdrive is None else overdrive,
            lead=self.lead,
            limits=self.limits,
            usable=self.usable,
        )


def two_stage_model(bias: AmplifierBias = CIRCUIT_B, design: AmplifierDesign = TABLE_II) -> SlewModel:
    """Return the slewing follower of the two-stage op-amp from sizes and bias alone, by hand formulas.

    The zero is corrected for the second pole, ``k = GBW*(1/zero - 1/second pole)``, limited to [0, 1].

    Parameters
    ----------
    bias : AmplifierBias, default CIRCUIT_B
        Bias of the circuit.
    design : AmplifierDesign, default TABLE_II
        Sizes and process.

    Returns
    -------
    SlewModel
        Parameters of the follower.

    Raises
    ------
    ValueError
        The supply is too low for the transistors to be saturated.

    Notes
    -----
    Compared with ngspice, steps of 1 V upwards at biases from 100 to 300 uA and Cc from 33 to 60 pF: at most 0.7 % rms.
    Not valid for falls beyond `AmplifierFigures.falling_slew_rate`.
    """
    figures = figures_of_merit(bias, design)
    limits = replace(figures.known_limits(), slew_rate=math.inf)
    zero = figures.gain_bandwidth * (1 / figures.zero - 1 / figures.second_pole)
    lead = Lead(linear=min(max(zero, 0.0), 1.0), square=min(figures.bend / figures.slew_overdrive, 0.5))
    open_loop = OpenLoop(figures.open_loop_gain, (figures.dominant_pole, figures.second_pole), figures.zero)
    usable = bool(open_loop.validity.valid)
    return SlewModel("two stages", figures.closed_loop, figures.slew_overdrive, lead, limits, usable)


def one_stage_model(bias: AmplifierBias = CIRCUIT_C, design: AmplifierDesign = TABLE_II) -> SlewModel:
    """Return the slewing follower of the one-stage op-amp from sizes and bias alone, by hand formulas.

    Parameters
    ----------
    bias : AmplifierBias, default CIRCUIT_C
        Bias of the circuit.
    design : AmplifierDesign, default TABLE_II
        Sizes and process.

    Returns
    -------
    SlewModel
        Parameters of the follower.

    Raises
    ------
    ValueError
        The supply is too low for the transistors to be saturated.

    Notes
    -----
    Compared with ngspice, steps of 1 V upwards at biases from 50 to 200 uA and Cc from 33 to 66 pF: at most 1.1 % rms.
    """
    figures = one_stage_figures(bias, design)
    limits = replace(figures.known_limits(), slew_rate=math.inf)
    open_loop = OpenLoop(figures.open_loop_gain, (figures.dominant_pole, figures.second_pole))
    return SlewModel(
        "one stage and an output follower",
        figures.closed_loop,
        figures.slew_overdrive,
        limits=limits,
        usable=bool(open_loop.validity.valid),
    )


def slew_model(loop: ClosedLoop, gain_bandwidth: float | None = None, stages: int | None = None) -> SlewModel:
    """Return the slewing follower of a measured gain and -3 dB bandwidth.

    Parameters
    ----------
    loop : ClosedLoop
        Gain and bandwidth of the follower, measured with small signals.
    gain_bandwidth : float, optional
        Gain-bandwidth product of its op-amp [Hz], in [1e-12, 1e14]; by default the published 1.5 MHz if `stages` is
        given, else that of the measured bandwidth.
    stages : int, optional
        2: Miller op-amp (`two_stage`); 1: one stage and an output follower (`one_stage`); unknown by default.

    Returns
    -------
    SlewModel
        Parameters of the follower.

    Raises
    ------
    ValueError
        `gain_bandwidth` or `stages` is not a number in its range, or `loop` is not a ClosedLoop.

    Examples
    --------
    >>> model = slew_model(ClosedLoop(gain=0.99355, bandwidth=1.419e6), stages=2)
    >>> print(f"{model.amplifier}: {model.overdrive:.3f} V, zero {model.lead.linear:.3f}, bend {model.lead.square:.3f}")
    two stages: 0.466 V, zero 0.070, bend 0.175
    """
    loop = instance("loop", loop, ClosedLoop)
    given = None if gain_bandwidth is None else real_number("gain_bandwidth", gain_bandwidth, 1e-12, 1e14)
    known = None if stages is None else whole_number("stages", stages, 1, 2)
    if known is None and given is None:
        return SlewModel("one pole", loop, OVERDRIVE)
    product = GAIN_BANDWIDTH.value if given is None else given
    one_pole = ClosedLoop(gain=loop.gain, bandwidth=close_loop(AMPLIFIER_GAIN.value, product).bandwidth)
    if known is None:
        return SlewModel("one pole", one_pole, OVERDRIVE)
    hand = one_stage_model() if known == 1 else two_stage_model()
    measured = replace(hand, loop=one_pole, limits=NO_LIMITS)  # supply and load of the circuit are unknown
    if known == 1:
        return measured
    ratio = max(loop.bandwidth / one_pole.bandwidth, math.sqrt(0.5))  # of the largest zero
    zero = max(0.0, 1 - math.sqrt(max(2 - 1 / ratio**2, 0.0)))
    return replace(measured, lead=replace(hand.lead, linear=zero))
