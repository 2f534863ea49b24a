"""Models of a circuit, by what they are made of: sizes and bias, given figures, or the operating point of a netlist."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from posfet_model.amplifier.closed_loop import close_loop
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.amplifier.follower_base import Follower
from posfet_model.amplifier.one_stage import one_stage_figures
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.amplifier.slew_identification import one_stage_model, two_stage_model
from posfet_model.amplifier.two_stage import figures_of_merit
from posfet_model.spice.circuits import Circuit
from posfet_model.spice.measurement import BiasPoint, LoopMeasurement


@dataclass(frozen=True, eq=False)
class CircuitModel:
    """A follower in time and its loop gain."""

    follower: Follower
    """Output over time, with its range of validity."""
    open_loop: OpenLoop
    """Unity crossing, phase margin, stability, and whether the design is usable."""


def from_sizes(circuit: Circuit, loop: LoopMeasurement, bias_point: BiasPoint) -> CircuitModel:
    """Return the model from sizes, bias, compensation and load alone; unchecked."""
    del loop, bias_point
    if circuit.stages == 1:
        one = one_stage_figures(circuit.bias, circuit.design)
        follower = one_stage_model(circuit.bias, circuit.design).follower()
        return CircuitModel(follower, OpenLoop(one.open_loop_gain, (one.dominant_pole, one.second_pole)))
    two = figures_of_merit(circuit.bias, circuit.design)
    return CircuitModel(
        two_stage_model(circuit.bias, circuit.design).follower(),
        OpenLoop(two.open_loop_gain, (two.dominant_pole, two.second_pole), two.zero),
    )


def from_figures(circuit: Circuit, loop: LoopMeasurement, bias_point: BiasPoint) -> CircuitModel:
    """Return the model from gain, unity crossing and phase margin as ngspice shows them; unchecked."""
    del circuit, bias_point
    closed = close_loop(loop.gain, loop.unity_crossing)
    return CircuitModel(OnePoleFollower(gain=closed.gain, bandwidth=closed.bandwidth), _open_loop(loop))


def _open_loop(loop: LoopMeasurement) -> OpenLoop:
    """Return two poles, or a pole and a zero; for an unstable loop a pole and an all-pass, whose zero is on the right.

    No two poles make a margin that is not positive; a second pole p and a zero at -p leave the gain as it is and turn
    the phase by ``2*atan(f/p)``.
    """
    if loop.phase_margin > 0.1:
        return OpenLoop.from_phase_margin(loop.gain, loop.unity_crossing, loop.phase_margin)
    lag = math.pi - math.radians(loop.phase_margin) - math.atan(math.sqrt(loop.gain**2 - 1))
    second = loop.unity_crossing / math.tan(0.5 * lag)
    return OpenLoop(loop.gain, (loop.unity_crossing / math.sqrt(loop.gain**2 - 1), second), -second)


WAYS: Final[Mapping[str, Callable[[Circuit, LoopMeasurement, BiasPoint], CircuitModel]]] = {
    "sizes": from_sizes,
    "given": from_figures,
}
"""Ways to obtain a model, by name."""


def unusable(model: CircuitModel) -> bool:
    """Return whether the model's open loop says that the design is not usable."""
    return not bool(model.open_loop.validity.valid) or math.isnan(float(model.open_loop.phase_margin))
