"""Figures of merit of the op-amp of a design and of its follower, for one circuit or for arrays of circuits."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from posfet_model._lib.types import Array, FloatArray, Mask
from posfet_model.amplifier.one_stage import one_stage_figures
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.amplifier.operating_point import operating_point
from posfet_model.amplifier.two_stage import figures_of_merit
from posfet_model.amplifier.validity import Validity
from posfet_model.spice.circuits import Circuit

NO_OPERATING_POINT: Final = "the supply is too low: a transistor is not saturated at rest"
NO_REST: Final = "an input of 0 V is out of the amplifier's range"


@dataclass(frozen=True, eq=False, kw_only=True)
class AmplifierFigures:
    """Figures of merit by hand formulas at rest, input and output near 0 V; NaN where a transistor is not saturated."""

    saturated: Mask
    """Where all transistors are saturated at rest."""
    tail_current: Array
    """Current through M5 [A]."""
    output_current: Array
    """Current through M7 and M8 [A]."""
    overdrive: Array
    """Overdrive of M1 and M2 [V]."""
    input_transconductance: Array
    """gm1 [S], for the voltage of the top electrode."""
    load_transconductance: Array
    """gm3 [S]."""
    open_loop_gain: Array
    """A0 [V/V]."""
    dominant_pole: Array
    """Dominant pole [Hz]."""
    second_pole: Array
    """Second pole [Hz]."""
    zero: Array
    """Zero [Hz], negative in the right half-plane, inf without one."""
    slew_rate: Array
    """Slew rate of rise and fall, the smaller one [V/s]."""
    common_mode_rejection: Array
    """CMRR: difference gain over common-mode gain of the first stage [V/V]."""
    lowest_input: Array
    """Lowest input that keeps all transistors saturated [V]."""
    highest_input: Array
    """Highest input that keeps all transistors saturated [V]."""

    @property
    def open_loop(self) -> OpenLoop:
        """Poles and zero of the op-amp; those without an operating point are replaced by a gain of 1."""
        usable = self.saturated
        gain, first, second, zero = (
            np.where(usable, part, 1.0)
            for part in (self.open_loop_gain, self.dominant_pole, self.second_pole, self.zero)
        )
        return OpenLoop(gain, (first, second), zero)

    def _known(self, values: Any) -> FloatArray:
        known: FloatArray = np.where(self.saturated, values, math.nan)
        return known[()]

    @property
    def gain_db(self) -> FloatArray:
        """A0 [dB]."""
        return 20 * np.log10(self.open_loop_gain)

    @property
    def gain_pole_product(self) -> FloatArray:
        """A0 times the dominant pole [Hz]."""
        return self.open_loop_gain * self.dominant_pole

    @property
    def gain_bandwidth(self) -> FloatArray:
        """Frequency at which the open-loop gain is 1 [Hz]; NaN where it never is."""
        return self._known(self.open_loop.gain_bandwidth)

    @property
    def phase_margin(self) -> FloatArray:
        """Phase margin [degrees]; NaN where the gain never is 1."""
        return self._known(self.open_loop.phase_margin)

    @property
    def overshoot(self) -> FloatArray:
        """Overshoot of a small step of the follower [1]; NaN where unstable."""
        return self._known(self.open_loop.overshoot)

    @property
    def settling_time(self) -> FloatArray:
        """Time after which a small step stays within 1 % [s]; inf where unstable."""
        return self._known(self.open_loop.settling_time(0.01))

    @property
    def stable(self) -> Any:
        """Whether the follower is stable; False without an operating point."""
        return (self.saturated & self.open_loop.stable)[()]

    @property
    def follower_gain(self) -> FloatArray:
        """Gain of the follower at frequency 0, A0/(1 + A0) [V/V]."""
        return self._known(self.open_loop.closed_loop_gain)

    @property
    def bandwidth(self) -> FloatArray:
        """-3 dB frequency of the follower [Hz], the root of a quadratic equation; returns NaN where unknown.

        With ``H = (1 + s*tz)/(1 + a1*s + a2*s^2)`` and x = w^2: ``a2^2*x^2 + (a1^2 - 2*a2 - 2*tz^2)*x = 1``.
        """
        loop = self.open_loop
        (t1, t2), tz = loop.pole_times, loop.zero_time
        gain = np.asarray(loop.gain)
        a1, a2 = (t1 + t2 + gain * tz) / (1 + gain), t1 * t2 / (1 + gain)
        b = a1 * a1 - 2 * a2 - 2 * tz * tz
        root = np.sqrt(b * b + 4 * a2 * a2)
        with np.errstate(divide="ignore", invalid="ignore"):
            square = np.where(b > 0, 2 / (b + root), (root - b) / (2 * a2 * a2))
        return self._known(np.sqrt(square) / (2 * math.pi))

    @property
    def supply_current(self) -> FloatArray:
        """Current through M5 and M8 [A]; the reference current comes in addition."""
        return (self.tail_current + self.output_current)[()]

    @property
    def validity(self) -> Validity:
        """Where the follower is usable, and why not."""
        with np.errstate(invalid="ignore"):
            outside = (self.lowest_input > 0) | (self.highest_input < 0)
        ringing = {reason: mask & self.saturated for reason, mask in self.open_loop.validity.findings.items()}
        return Validity({NO_OPERATING_POINT: ~self.saturated, **ringing, NO_REST: outside})


def amplifier_figures(circuits: Iterable[Circuit], shape: tuple[int, ...]) -> AmplifierFigures:
    """Return the figures of merit of circuits, NaN where a transistor is not saturated at rest.

    Parameters
    ----------
    circuits : iterable of Circuit
        The circuits, in C order.
    shape : tuple of int
        Shape of the result.

    Returns
    -------
    AmplifierFigures
        Figures of merit, of that shape.
    """
    rows = [_row(circuit) for circuit in circuits]
    names = [item.name for item in fields(AmplifierFigures)]
    columns = {name: np.array([row[name] for row in rows]).reshape(shape) for name in names}
    return AmplifierFigures(**columns)


def _row(circuit: Circuit) -> dict[str, Any]:
    bias, design = circuit.bias, circuit.design
    try:
        figures = figures_of_merit(bias, design) if circuit.stages == 2 else one_stage_figures(bias, design)
    except ValueError:
        nothing = dict.fromkeys((item.name for item in fields(AmplifierFigures)), math.nan)
        return {**nothing, "saturated": False}
    point = operating_point(bias, design)
    lam, tail_voltage = bias.modulation, bias.supply - point.pair_threshold - point.pair_overdrive
    gm3, tail_conductance = point.tail / point.load_overdrive, lam * point.tail / (1 + lam * tail_voltage)
    return {
        "saturated": True,
        "tail_current": figures.tail_current,
        "output_current": point.output,
        "overdrive": figures.overdrive,
        "input_transconductance": figures.input_transconductance,
        "load_transconductance": gm3,
        "open_loop_gain": figures.open_loop_gain,
        "dominant_pole": figures.dominant_pole,
        "second_pole": figures.second_pole,
        "zero": getattr(figures, "zero", math.inf),
        "slew_rate": min(figures.slew_rate, getattr(figures, "falling_slew_rate", math.inf)),
        "common_mode_rejection": figures.first_gain * 2 * gm3 / tail_conductance,
        "lowest_input": figures.limits.v_low,
        "highest_input": figures.limits.v_high,
    }
