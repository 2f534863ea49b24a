# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Charge of a taxel over time: a static force, a temperature rise of 1 K, and the high pass due to leakage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posfet_model.device import paper
from posfet_model.device.charge import frequency_response, propagate_first_order_hold, source_charge
from posfet_model.figures.style import BLACK, BLUE, DASHED, DOTTED, GREY, SOLID, VERMILION, label, new_figure

_TAU = paper.LEAK_TIME_CONSTANT.value
_UC_PER_M2 = 1e-6


def leakage() -> Figure:
    """Draw the charge by 1 N held for a second and by heating of 1 K (left), and gain against frequency (right)."""
    figure, (left, right) = new_figure(3.3, columns=2)
    time = np.linspace(0, 2.5, 2501)
    press = np.interp(time, [0.25, 0.3, 1.25, 1.3], [0.0, 1.0, 1.0, 0.0]) / paper.FORCE_AREA.value
    temperature = np.interp(time, [0.25, 1.25], [0.0, 1.0])
    coefficients = (paper.PIEZOELECTRIC_COEFFICIENT.value, paper.PYROELECTRIC_COEFFICIENT.value)
    pressed = source_charge(-press, 0.0, *coefficients)
    left.plot(time, pressed / _UC_PER_M2, color=GREY, linestyle=DOTTED)
    left.plot(time, _leaked(time, pressed) / _UC_PER_M2, color=BLUE, linestyle=SOLID)
    heated = _leaked(time, source_charge(0.0, temperature, *coefficients))
    left.plot(time, heated / _UC_PER_M2, color=VERMILION, linestyle=DASHED)
    label(left, 1.34, 36.5, "1 N, no leakage", GREY, va="center")
    label(left, 0.5, 22, "1 N for 1 s", BLUE)
    label(left, 0.28, -16.5, "heated by 1 K", VERMILION)
    left.set(xlabel="time [s]", ylabel="charge density [µC/m²]", xlim=(0, 2.5), ylim=(-42, 45))
    frequency = np.logspace(-2, 2, 201)
    right.plot(frequency, 20 * np.log10(np.abs(frequency_response(frequency, _TAU))), color=BLUE, linestyle=SOLID)
    corner = 1 / (2 * np.pi * _TAU)
    right.plot(corner, -10 * np.log10(2), marker="o", markersize=5, color=BLACK, zorder=6)
    label(right, corner * 1.25, -5.2, f"−3 dB at {corner:.2f} Hz", BLACK)
    right.set(xlabel="frequency [Hz]", ylabel="charge over source [dB]", xscale="log", xlim=(1e-2, 1e2), ylim=(-40, 2))
    return figure


def _leaked(time: NDArray[np.float64], source: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the charge density over time, step by step."""
    charge = np.zeros_like(time)
    for i in range(1, time.size):
        charge[i] = propagate_first_order_hold(charge[i - 1], source[i - 1], source[i], time[1] - time[0], _TAU)
    return charge


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"charge_leak": leakage}
