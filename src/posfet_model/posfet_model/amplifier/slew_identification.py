"""Which slewing follower a measured gain and bandwidth stand for, without any run in time.

An op-amp of one pole and a gain-bandwidth product GBW makes a follower of the bandwidth ``GBW*(1 + 1/A0)``. A measured
bandwidth is off that, and the sign tells what comes next in the open-loop response:

- lower, by up to 1/sqrt(2): a zero in the left half-plane, as a resistor in series with Cc makes. With the zero at k
  times the time constant the follower's bandwidth falls by ``sqrt(1 + 2*k - k^2)``, from which k. The op-amp is taken
  for the two-stage one of Table II (`amplifier`).
- higher, by up to sqrt(2), and a tenth for an uncertain gain-bandwidth product: a second pole; it adds nothing to the
  lag of slow signals. The op-amp is taken for the one-stage one with an output follower (`one_stage`).
- the same to 1 %: neither is seen. The op-amp is taken for the two-stage one, its zero cancelled.
- beyond: the gain-bandwidth product must be another one, and the bandwidth alone is believed.

Slewing is not seen in small signals at all. Overdrive and bend are those of the hand formulas, with the sizes of
Table II and the bias of circuit B or C, which is assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from posfet_model._lib.validation import instance, real_number
from posfet_model.amplifier.closed_loop import ClosedLoop, FollowerLimits, close_loop
from posfet_model.amplifier.differential_pair import NO_LEAD, Lead
from posfet_model.amplifier.follower import SquareLawFollower
from posfet_model.amplifier.one_stage import CIRCUIT_C, one_stage_figures
from posfet_model.amplifier.two_stage import CIRCUIT_B, TABLE_II, AmplifierBias, AmplifierDesign, figures_of_merit
from posfet_model.device.paper import AMPLIFIER_GAIN, GAIN_BANDWIDTH

OVERDRIVE: Final = 0.39
"""Overdrive of the differential pair [V] where nothing is known of the op-amp, assumed: between those of the two-stage
op-amp, 0.47 V, and of the one-stage one, 0.32 V."""

EXPLAINED: Final = (1 / math.sqrt(2), 1.1 * math.sqrt(2))
"""Ratios of bandwidths that a zero or a second pole explains."""

NO_LIMITS: Final = FollowerLimits()
"""Nothing is known of where the model ends."""

SEEN: Final = 1.01
"""Ratio of bandwidths from which on a second pole is seen."""


@dataclass(frozen=True)
class SlewModel:
    """What small signals and hand formulas say of a slewing follower."""

    amplifier: str
    """What the op-amp was taken for, in words."""
    loop: ClosedLoop
    """Gain, and the bandwidth of the pole alone: of the lag of slow signals."""
    overdrive: float
    """[V], in [1e-6, 1e3]."""
    lead: Lead = NO_LEAD
    """What the pair's current adds to the output at once."""
    limits: FollowerLimits = NO_LIMITS
    """Where the model holds, as far as the circuit is known. Its own slew rate is no limit."""

    def follower(self, overdrive: float | None = None) -> SquareLawFollower:
        """Return the follower, with another overdrive [V] where that is known."""
        return SquareLawFollower(
            gain=self.loop.gain,
            bandwidth=self.loop.bandwidth,
            overdrive=self.overdrive if overdrive is None else overdrive,
            lead=self.lead,
            limits=self.limits,
        )


def two_stage_model(bias: AmplifierBias = CIRCUIT_B, design: AmplifierDesign = TABLE_II) -> SlewModel:
    """Return the slewing follower of the two-stage op-amp from sizes and bias alone, by hand formulas.

    The zero counts less what the second pole takes back, ``k = GBW*(1/zero - 1/second pole)``, at least 0, at most 1.

    Notes
    -----
    Against ngspice, steps of 1 V upwards at biases from 100 to 300 uA and Cc from 33 to 60 pF: at most 0.7 % rms. Not
    for falls beyond `AmplifierFigures.falling_slew_rate`.
    """
    figures = figures_of_merit(bias, design)
    zero = figures.gain_bandwidth * (1 / figures.zero - 1 / figures.second_pole)
    lead = Lead(linear=min(max(zero, 0.0), 1.0), square=min(figures.bend / figures.slew_overdrive, 0.5))
    limits = replace(figures.limits, slew_rate=math.inf)
    return SlewModel("two stages", figures.closed_loop, figures.slew_overdrive, lead, limits)


def one_stage_model(bias: AmplifierBias = CIRCUIT_C, design: AmplifierDesign = TABLE_II) -> SlewModel:
    """Return the slewing follower of the one-stage op-amp from sizes and bias alone, by hand formulas.

    Notes
    -----
    Against ngspice, steps of 1 V upwards at biases from 50 to 200 uA and Cc from 33 to 66 pF: at most 1.1 % rms.
    """
    figures = one_stage_figures(bias, design)
    limits = replace(figures.limits, slew_rate=math.inf)
    return SlewModel("one stage and an output follower", figures.closed_loop, figures.slew_overdrive, limits=limits)


def slew_model(loop: ClosedLoop, gain_bandwidth: float = GAIN_BANDWIDTH.value) -> SlewModel:
    """Return the slewing follower that a measured gain and -3 dB bandwidth stand for.

    Parameters
    ----------
    loop : ClosedLoop
        Of the follower, measured for small signals.
    gain_bandwidth : float, default GAIN_BANDWIDTH.value
        Of its op-amp [Hz], in [1e-12, 1e14]; the published 1.5 MHz where it was not measured.

    Raises
    ------
    ValueError
        gain_bandwidth is not a real, finite number in its range, or loop not a ClosedLoop.

    Examples
    --------
    >>> model = slew_model(ClosedLoop(gain=0.99355, bandwidth=1.419e6))
    >>> print(f"{model.amplifier}: {model.overdrive:.3f} V, zero {model.lead.linear:.3f}, bend {model.lead.square:.3f}")
    two stages: 0.466 V, zero 0.070, bend 0.175
    """
    loop = instance("loop", loop, ClosedLoop)
    product = real_number("gain_bandwidth", gain_bandwidth, 1e-12, 1e14)
    one_pole = ClosedLoop(gain=loop.gain, bandwidth=close_loop(AMPLIFIER_GAIN.value, product).bandwidth)
    ratio = loop.bandwidth / one_pole.bandwidth
    if not EXPLAINED[0] < ratio <= EXPLAINED[1]:
        return SlewModel("one pole", loop, OVERDRIVE)
    hand = one_stage_model() if ratio > SEEN else two_stage_model()
    measured = replace(hand, loop=one_pole, limits=NO_LIMITS)  # supply and load of the circuit are not known
    if ratio > SEEN:
        return measured
    zero = max(0.0, 1 - math.sqrt(2 - 1 / ratio**2))
    return replace(measured, lead=replace(hand.lead, linear=zero))
