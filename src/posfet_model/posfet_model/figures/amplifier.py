# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The follower behind a taxel: from force to output over time (the paper's Fig. 6), gain and phase (its Fig. 7).

Each is compared with runs of ngspice, and the difference is drawn below.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model.amplifier.circuit_figures import unloaded_response
from posfet_model.amplifier.closed_loop import close_loop
from posfet_model.amplifier.follower import Follower, OnePoleFollower
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.amplifier.transient_follower import CircuitFollower
from posfet_model.device import paper
from posfet_model.device.charge import frequency_response
from posfet_model.figures import ngspice_runs
from posfet_model.figures.style import (
    BLACK,
    BLUE,
    DASHED,
    DOTTED,
    GREY,
    SOLID,
    VERMILION,
    label,
    new_figure,
)
from posfet_model.spice.circuits import CIRCUITS

_PUBLISHED = close_loop(paper.AMPLIFIER_GAIN.value, paper.GAIN_BANDWIDTH.value)
_CIRCUIT: Final = CircuitFollower.from_design()
_HIGHEST: Final = 1e8
"""Highest frequency of Fig. 7 [Hz]."""
_LOOKS: Final[dict[str, dict[str, Any]]] = {
    "42.3 dB, 1.5 MHz": {"color": VERMILION, "linestyle": DASHED},
    "sizes and bias": {"color": BLUE, "linestyle": SOLID},
}
"""Models by what they know, and how they are drawn."""
_MARKS: Final[dict[str, Any]] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 3.2,
    "markerfacecolor": "white",
    "color": BLACK,
    "zorder": 6,
}


def models() -> dict[str, Follower]:
    """Return the followers by what is known of the circuit: the published two numbers, or its sizes and bias."""
    return {
        "42.3 dB, 1.5 MHz": OnePoleFollower(gain=_PUBLISHED.gain, bandwidth=_PUBLISHED.bandwidth),
        "sizes and bias": _CIRCUIT,
    }


def fine_times(time: Array, stop: float) -> tuple[Array, NDArray[np.intp]]:
    """Return a grid fine enough for the models that contains the times of a recorded run, and their places in it.

    Parameters
    ----------
    time : ndarray, shape [t]
        Times of the run [s].
    stop : float
        End of the run [s].

    Returns
    -------
    tuple of ndarray
        Increasing times [s], shape [n], and places, shape [t].
    """
    rounded = np.round(time, 11)  # files have nine digits
    fine = np.unique(np.round(np.r_[np.linspace(0, stop, 2001), rounded], 11))
    return fine, np.searchsorted(fine, rounded)


def sine() -> Figure:
    """Draw Fig. 6: force, voltages and difference to ngspice, for a sine of 1 kHz and a press."""
    figure, panels = new_figure(6.0, rows=3, columns=2)
    cases = (("sine", 1e-3, "time [ms]", "sine of 1 N, 1 kHz"), ("press", 1.0, "time [s]", "press of 1.5 N, 50 ms"))
    for column, (name, unit, axis, title) in enumerate(cases):
        force, voltage, error = panels[column::2]
        time, _, reference = ngspice_runs.read(name)
        x = time / unit
        force.plot(x, ngspice_runs.FORCES[name][0](time), color=BLACK, linestyle=SOLID)
        force.set(title=title)
        fine, place = fine_times(time, ngspice_runs.FORCES[name][1])
        gate = ngspice_runs.gate_voltage(ngspice_runs.FORCES[name][0](fine), fine)[place]
        for knowledge, model in models().items():
            out = model.run(time, gate).v_out
            difference = (out - out[0]) - (reference - reference[0])
            error.plot(x, 1e3 * difference, label=knowledge, **_LOOKS[knowledge])
        voltage.plot(x, gate, color=GREY, linestyle=SOLID, linewidth=4.5, label="gate")
        voltage.plot(x, out - out[0], label="output, model", **_LOOKS["sizes and bias"])
        voltage.plot(x[::20], (reference - reference[0])[::20], label="output, ngspice", **_MARKS)
        for axes in (force, voltage, error):
            axes.set_xlim(0, x[-1])
        error.set_xlabel(axis)
    panels[0].set_ylabel("force [N]")
    panels[2].set_ylabel("voltage [V]")
    panels[4].set_ylabel("model − ngspice [mV]")
    panels[3].legend(loc="upper right", frameon=False, fontsize=8)
    panels[5].legend(loc="lower right", frameon=False, fontsize=8, title="model from", title_fontsize=8)
    return figure


def fast_sine() -> Figure:
    """Draw sines of 1 MHz at the gate, within the limits of the output stage and beyond, which the model reports."""
    figure, panels = new_figure(4.6, rows=2, columns=2)
    for column, (name, amplitude) in enumerate(ngspice_runs.FAST_AMPLITUDES.items()):
        note = _overlay(panels[column::2], name, models())
        panels[column].set_title(f"1 MHz, {amplitude:g} V{note}")
    _finish(figure, panels, 2)
    return figure


def steps() -> Figure:
    """Draw steps of 50 mV into loads of three capacitances, up to ringing."""
    figure, panels = new_figure(4.6, rows=2, columns=len(ngspice_runs.LOADS))
    for column, (name, load) in enumerate(ngspice_runs.LOADS.items()):
        bias = CIRCUITS[ngspice_runs.STEPPED[name]].bias
        circuit = CircuitFollower.from_design(bias)
        known = {**models(), "sizes and bias": circuit}
        _overlay(panels[column :: len(ngspice_runs.LOADS)], name, known, unit=1e-3)
        panels[column].set_ylim(-4, 72)
        margin = float(circuit.figures.phase_margin)
        panels[column].set_title(f"{load * 1e12:.0f} pF, margin {margin:.0f}°")
    _finish(figure, panels, len(ngspice_runs.LOADS), "mV")
    return figure


def _overlay(panels: list[Axes], name: str, known: dict[str, Follower], unit: float = 1.0) -> str:
    """Draw gate, models and ngspice above, the difference below, and shade what a model flags; say so if it does."""
    voltage, error = panels
    time, v_in, reference = ngspice_runs.read(name)
    x, reference = 1e6 * time, reference - reference[0]
    shown, note = np.searchsorted(time, np.linspace(0, time[-1] * 0.999, 33)), ""
    voltage.plot(x, v_in / unit, color=GREY, linestyle=SOLID, linewidth=4.5, label="gate")
    for knowledge, model in known.items():
        output = model.run(time, v_in)
        out = output.v_out - output.v_out[0]
        voltage.plot(x, out / unit, label=f"from {knowledge}", **_LOOKS[knowledge])
        error.plot(x, 1e3 * (out - reference), **_LOOKS[knowledge])
        if not (output.valid.all() or name in ngspice_runs.LOADS):
            note = ", shaded: flagged"
            for axes in panels:
                _shade(axes, x, ~output.valid)
    voltage.plot(x[shown], reference[shown] / unit, label="ngspice", **_MARKS)
    error.set_xlabel("time [µs]")
    for axes in panels:
        axes.set_xlim(0, x[-1])
    return note


def _finish(figure: Figure, panels: list[Axes], columns: int, unit: str = "V") -> None:
    panels[0].set_ylabel(f"voltage [{unit}]")
    panels[columns].set_ylabel("model − ngspice [mV]")
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4, frameon=False, fontsize=8)


def _shade(axes: Axes, x: Array, where: Mask) -> None:
    """Shade the spans of x in which `where` is true."""
    edges = np.flatnonzero(np.diff(np.r_[False, where, False].astype(np.int8)))
    for first, end in edges.reshape(-1, 2):
        axes.axvspan(x[first], x[end - 1], color="#e2e2e2", linewidth=0, zorder=0)


def gain_and_phase() -> Figure:
    """Draw Fig. 7: gain and phase of the op-amp and of a taxel with its follower, and the errors against ngspice."""
    figure, panels = new_figure(6.6, rows=4, columns=2)
    for column, name in enumerate(("open_loop", "ac")):
        gain, phase, gain_error, phase_error = axes_of = panels[column::2]
        low = 1.0 if name == "open_loop" else 1e-2
        frequency, real, imaginary = columns = ngspice_runs.read(name)
        frequency, real, imaginary = columns[:, frequency <= _HIGHEST]
        reference = (real + 1j * imaginary) * _high_pass(name, frequency)
        wide = np.logspace(math.log10(low), math.log10(_HIGHEST), 401)
        for knowledge, respond in responses(name).items():
            look = _LOOKS[knowledge]
            curve = respond(wide) * _high_pass(name, wide)
            gain.plot(wide, _decibel(curve), label=f"from {knowledge}", **look)
            phase.plot(wide, np.degrees(np.angle(curve)), **look)
            ratio = respond(frequency) * _high_pass(name, frequency) / reference
            gain_error.plot(frequency, _decibel(ratio), **look)
            phase_error.plot(frequency, np.degrees(np.angle(ratio)), **look)
        gain.plot(frequency[::4], _decibel(reference)[::4], label="ngspice", **_MARKS)
        phase.plot(frequency[::4], np.degrees(np.angle(reference))[::4], **_MARKS)
        for axes in axes_of:
            axes.set(xscale="log", xlim=(low, _HIGHEST))
            axes.axvline(paper.GAIN_BANDWIDTH.value, color=GREY, linestyle=DOTTED, linewidth=1)
            axes.set_xticks([1, 1e2, 1e4, 1e6, 1e8] if low == 1 else [1e-2, 1, 1e2, 1e4, 1e6, 1e8])
            axes.minorticks_off()
        gain.set(title="op-amp alone" if low == 1 else "taxel with follower")
        phase.set(yticks=[-180, -90, 0] if low == 1 else [-90, 0, 90])
        phase_error.set_xlabel("frequency [Hz]")
    label(panels[0], paper.GAIN_BANDWIDTH.value * 0.8, -42, "1.5 MHz", BLACK, ha="right", bbox=None)
    for axes, text in zip(panels[::2], ("gain [dB]", "phase [°]", "gain error [dB]", "phase error [°]"), strict=True):
        axes.set_ylabel(text)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return figure


def responses(name: str) -> dict[str, Callable[[Array], NDArray[np.complex128]]]:
    """Return frequency responses by what is known of the circuit: of the op-amp (open_loop) or the follower (ac).

    Parameters
    ----------
    name : str
        open_loop or ac.
    """
    gain = paper.AMPLIFIER_GAIN.value
    published = OpenLoop(gain, (paper.GAIN_BANDWIDTH.value / gain, math.inf))
    if name == "open_loop":
        return {"42.3 dB, 1.5 MHz": published.response, "sizes and bias": unloaded_response(_CIRCUIT.circuit).at}
    follower = _CIRCUIT.figures.closed_loop_response
    return {"42.3 dB, 1.5 MHz": published.closed_loop_response, "sizes and bias": follower.at}


def _high_pass(name: str, frequency: Array) -> NDArray[np.complexfloating[Any, Any]]:
    """Return the gate voltage of a taxel relative to that of a film that does not leak; 1 for the op-amp alone."""
    if name == "open_loop":
        return np.ones(frequency.shape, np.complex128)
    return frequency_response(frequency, paper.LEAK_TIME_CONSTANT.value)


def _decibel(response: NDArray[np.complexfloating[Any, Any]]) -> Array:
    return np.asarray(20 * np.log10(np.abs(response)), np.float64)


FIGURES: Final[dict[str, Callable[[], Figure]]] = {
    "fig6_follower_sine": sine,
    "fig6_slew": fast_sine,
    "fig6_steps": steps,
    "fig7_gain_phase": gain_and_phase,
}
