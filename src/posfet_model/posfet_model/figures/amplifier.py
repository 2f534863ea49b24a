"""The follower: its response to a sine (paper, Fig. 6) and its gain and phase (paper, Fig. 7)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from posfet_model.amplifier.closed_loop import close_loop
from posfet_model.amplifier.follower import OnePoleFollower, SquareLawFollower, TwoPoleFollower
from posfet_model.amplifier.slew_identification import OVERDRIVE
from posfet_model.device.paper import AMPLIFIER_GAIN, GAIN_BANDWIDTH
from posfet_model.figures.style import (
    BLACK,
    BLUE,
    DASH_DOT,
    DASHED,
    DOTTED,
    GREY,
    SOLID,
    VERMILION,
    label,
    new_figure,
)
from posfet_model.spice.model_comparison import SECOND_POLE_QUALITY

_LOOP = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
_ONE_POLE = OnePoleFollower(gain=_LOOP.gain, bandwidth=_LOOP.bandwidth)
_TWO_POLE = TwoPoleFollower(
    gain=_LOOP.gain, natural_frequency=_LOOP.bandwidth / SECOND_POLE_QUALITY, quality=SECOND_POLE_QUALITY
)
_SLEWING = SquareLawFollower(gain=_LOOP.gain, bandwidth=_LOOP.bandwidth, overdrive=OVERDRIVE)


def sine() -> Figure:
    """Draw Fig. 6: input and output for a sine of 1 V. At 1 kHz they coincide; at 1 MHz the follower slews."""
    figure, (slow, error, fast) = new_figure(6.4, rows=3)
    time = np.linspace(0, 2, 2001)
    v_in = np.sin(2 * np.pi * time)
    v_out = _ONE_POLE.run(time * 1e-3, v_in).v_out
    slow.plot(time, v_in, color=GREY, linestyle=SOLID, linewidth=4)
    slow.plot(time, v_out, color=BLUE, linestyle=DASHED)
    label(slow, 0.30, 1.05, "input (wide), output (dashed)", BLACK, va="bottom")
    slow.set(xlabel="time  [ms]", ylabel="voltage  [V]", title="1 kHz, 1 V", xlim=(0, 2), ylim=(-1.2, 1.5))
    error.plot(time, 1e3 * (v_out - v_in), color=VERMILION)
    error.set(xlabel="time  [ms]", ylabel="output − input  [mV]", title="the difference, at 1 kHz", xlim=(0, 2))
    v_in = np.sin(2 * np.pi * time)
    fast.plot(time, v_in, color=GREY, linewidth=4)
    fast.plot(time, _ONE_POLE.run(time * 1e-6, v_in).v_out, color=BLUE, linestyle=DASHED)
    fast.plot(time, _SLEWING.run(time * 1e-6, v_in).v_out, color=VERMILION, linestyle=SOLID)
    label(fast, 0.26, 1.05, "input", GREY, va="bottom")
    label(fast, 0.42, 0.88, "one pole", BLUE)
    label(fast, 0.62, 0.30, "slew-limited", VERMILION)
    fast.set(
        xlabel="time  [µs]",
        ylabel="voltage  [V]",
        title=f"1 MHz, 1 V; overdrive of the pair {OVERDRIVE} V, assumed",
        xlim=(0, 2),
        ylim=(-1.2, 1.5),
    )
    return figure


def gain_and_phase() -> Figure:
    """Draw Fig. 7: gain and phase of the open loop and of the follower."""
    figure, (gain, phase) = new_figure(5.6, rows=2)
    frequency = np.logspace(1, 8, 701)
    pole = GAIN_BANDWIDTH.value / AMPLIFIER_GAIN.value
    open_loop = AMPLIFIER_GAIN.value / (1 + 1j * frequency / pole)
    gain.plot(frequency, 20 * np.log10(np.abs(open_loop)), color=BLACK, linestyle=SOLID)
    phase.plot(frequency, np.degrees(np.angle(open_loop)), color=BLACK, linestyle=SOLID)
    for follower, colour, dashes in ((_ONE_POLE, BLUE, DASHED), (_TWO_POLE, VERMILION, DASH_DOT)):
        response = follower.response(frequency)
        gain.plot(frequency, 20 * np.log10(response.gain), color=colour, linestyle=dashes)
        phase.plot(frequency, np.degrees(response.phase), color=colour, linestyle=dashes)
    for axes in (gain, phase):
        axes.axvline(GAIN_BANDWIDTH.value, color=GREY, linestyle=DOTTED, linewidth=1)
        axes.set(xscale="log", xlim=(10, 1e8), xlabel="frequency  [Hz]")
    gain.plot(pole, 20 * math.log10(AMPLIFIER_GAIN.value / math.sqrt(2)), "o", color=BLACK, markersize=5)
    label(gain, 30, 36, f"open loop, {20 * math.log10(AMPLIFIER_GAIN.value):.1f} dB", BLACK)
    label(gain, pole * 1.4, 40, f"pole at {pole / 1e3:.2f} kHz", BLACK)
    label(gain, 20, 5, "follower: one pole (dashed), two poles (dash-dot)", BLUE)
    label(gain, GAIN_BANDWIDTH.value * 1.2, 22, "1.5 MHz", GREY)
    label(phase, 3e3, -52, "open loop", BLACK, ha="right")
    label(phase, 1e4, -18, "follower", BLUE)
    gain.set(ylabel="gain  [dB]", ylim=(-45, 50))
    phase.set(ylabel="phase  [°]", ylim=(-185, 10), yticks=[0, -45, -90, -135, -180])
    return figure


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"fig6_follower_sine": sine, "fig7_gain_phase": gain_and_phase}
