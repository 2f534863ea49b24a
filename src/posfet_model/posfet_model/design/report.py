# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every figure of merit of a design by name, with unit and meaning: the table, JSON and columns of a sweep."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from posfet_model._lib.types import FloatArray
from posfet_model.amplifier.step_test import SLEWING_STEP, slew_rates, step_test
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.device.transistor import Plane


@dataclass(frozen=True)
class Figure:
    """One figure of merit."""

    key: str
    """Name in JSON and CSV, with its unit."""
    unit: str
    """Unit for people."""
    meaning: str
    """What it is."""
    value: Callable[[PosfetDesign], Any]
    """Computes it, for all designs of the arrays."""


def _decibels(ratio: Any) -> Any:
    return 20 * np.log10(ratio)


FIGURES: Final = (
    Figure(
        "volts_per_newton_gate",
        "V/N",
        "sensitivity at the top electrode, before leakage",
        PosfetDesign.volts_per_newton,
    ),
    Figure("volts_per_newton_oxide", "V/N", "sensitivity at the oxide", lambda d: d.volts_per_newton(Plane.OXIDE)),
    Figure("volts_per_newton_output", "V/N", "sensitivity at the output", lambda d: d.output_volts_per_newton),
    Figure("amperes_per_newton", "A/N", "drain current of M1 per force, at its bias", lambda d: d.amperes_per_newton),
    Figure("newtons_per_kelvin", "N/K", "apparent force of a sudden temperature rise", lambda d: d.newtons_per_kelvin),
    Figure("leak_time_constant_s", "s", "leakage time constant", lambda d: d.leak_time_constant),
    Figure("low_corner_hz", "Hz", "frequency below which the signal leaks away", lambda d: d.low_corner),
    Figure("film_capacitance_f", "F", "capacitance of the film", lambda d: d.film_capacitance),
    Figure("gate_capacitance_f", "F", "capacitance with which the gate loads it", lambda d: d.gate_capacitance),
    Figure("coupling", "1", "share of a voltage of the top electrode at the oxide", lambda d: d.coupling),
    Figure("poled_fraction", "1", "polarisation in units of Pr", lambda d: d.poled_fraction),
    Figure("threshold_v", "V", "threshold of M1 and M2 with this film and poling", lambda d: d.threshold),
    Figure("gain_factor_a_per_v2", "A/V2", "gain factor of M1 and M2 at the gate", PosfetDesign.gain_factor),
    Figure("gain_db", "dB", "open-loop gain", lambda d: d.amplifier.gain_db),
    Figure("gbw_hz", "Hz", "gain-bandwidth: where the loop gain is 1", lambda d: d.amplifier.gain_bandwidth),
    Figure("gain_pole_product_hz", "Hz", "gain times dominant pole", lambda d: d.amplifier.gain_pole_product),
    Figure("dominant_pole_hz", "Hz", "dominant pole", lambda d: d.amplifier.dominant_pole),
    Figure("second_pole_hz", "Hz", "magnitude of the next pole", lambda d: d.amplifier.second_pole),
    Figure("phase_margin_deg", "degrees", "phase margin", lambda d: d.amplifier.phase_margin),
    Figure(
        "least_phase_margin_deg",
        "degrees",
        "least phase margin at inputs from 0 V to that of signal_force",
        lambda d: d.margins_in_use.phase_margin,
    ),
    Figure(
        "overshoot_small_signal_pct",
        "%",
        "overshoot of a step so small that the circuit is linear",
        lambda d: 100 * d.amplifier.overshoot,
    ),
    Figure("settling_time_s", "s", "time to 1 % of a small step", lambda d: d.amplifier.settling_time),
    Figure("follower_gain", "V/V", "gain of the follower", lambda d: d.amplifier.follower_gain),
    Figure("bandwidth_hz", "Hz", "-3 dB frequency of the follower", lambda d: d.amplifier.bandwidth),
    Figure("slew_hand_v_per_s", "V/s", "slew rate of a rise by a hand formula", lambda d: d.amplifier.slew_rate),
    Figure(
        "falling_slew_hand_v_per_s",
        "V/s",
        "slew rate of a fall by a hand formula",
        lambda d: d.amplifier.falling_slew_rate,
    ),
    Figure("offset_v", "V", "systematic offset, without mismatch", lambda d: d.amplifier.offset),
    Figure(
        "cmrr_systematic_db",
        "dB",
        "common-mode rejection of the circuit without mismatch",
        lambda d: _decibels(d.amplifier.common_mode_rejection),
    ),
    Figure(
        "cmrr_hand_db",
        "dB",
        "the same with mismatch of one standard deviation, by a hand formula",
        lambda d: _decibels(d.common_mode_rejection),
    ),
    Figure(
        "lowest_input_v",
        "V",
        "lowest input, with all transistors saturated and the follower stable",
        lambda d: d.amplifier.lowest_input,
    ),
    Figure("highest_input_v", "V", "highest input, as the lowest", lambda d: d.amplifier.highest_input),
    Figure(
        "lowest_saturated_input_v",
        "V",
        "lowest input with all transistors saturated, stable or not",
        lambda d: d.amplifier.lowest_saturated_input,
    ),
    Figure(
        "highest_saturated_input_v",
        "V",
        "highest input with all transistors saturated, stable or not",
        lambda d: d.amplifier.highest_saturated_input,
    ),
    Figure("largest_force_n", "N", "largest force within the ranges of amplifier and ADC", lambda d: d.largest_force),
    Figure("power_w", "W", "power at rest", lambda d: d.power),
    Figure("area_m2", "m2", "area of film and gates", lambda d: d.area),
    Figure("noise_bias_v", "V", "noise of the bias resistor in the band", lambda d: d.noise.bias),
    Figure("noise_thermal_v", "V", "thermal noise of the input stage", lambda d: d.noise.thermal),
    Figure("noise_flicker_v", "V", "1/f noise of the input stage", lambda d: d.noise.flicker),
    Figure("noise_sampling_v", "V", "kT/C noise of the ADC", lambda d: d.noise.sampling),
    Figure("noise_quantisation_v", "V", "quantisation noise of the ADC", lambda d: d.noise.quantisation),
    Figure("noise_total_v", "V", "sum of all sources, at the top electrode", lambda d: d.noise.total),
    Figure("snr_db", "dB", "signal of signal_force to noise", lambda d: d.signal_to_noise),
    Figure("smallest_force_n", "N", "smallest detectable force", lambda d: d.smallest_force),
)
"""Figures of arrays of designs, in the order in which they are printed."""

KEYS: Final = tuple(figure.key for figure in FIGURES)


def _slew_rates(design: PosfetDesign) -> tuple[float, float]:
    """Return rise and fall [V/s] of a step within the input's range; NaN where there is none, or they are unknown."""
    low, high = float(design.amplifier.lowest_input), float(design.amplifier.highest_input)
    if not low < 0 < high or not design.slew_rate_known:
        return math.nan, math.nan
    return slew_rates(design.follower(), max(SLEWING_STEP[0], low), min(SLEWING_STEP[1], high))


INTEGRATED: Final = {
    "overshoot_small_signal_pct": Figure(
        "overshoot_pct", "%", "overshoot of a step of 50 mV", lambda d: 100 * step_test(d.follower()).overshoot
    ),
    "slew_hand_v_per_s": Figure("slew_v_per_s", "V/s", "slew rate of a rise, of a step", lambda d: _slew_rates(d)[0]),
    "falling_slew_hand_v_per_s": Figure(
        "falling_slew_v_per_s", "V/s", "slew rate of a fall, of a step", lambda d: _slew_rates(d)[1]
    ),
}
"""Figures of single designs only, since the circuit is integrated, before those that take their place in arrays."""

REPORT: Final = tuple(one for figure in FIGURES for one in (INTEGRATED.get(figure.key), figure) if one is not None)
"""Figures of the report of a single design, in the order in which they are printed."""

_PREFIXES: Final = {-15: "f", -12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
_PLAIN: Final = {"1", "%", "dB", "degrees", "V/V", "m2"}


def values(design: PosfetDesign, keys: Iterable[str] = KEYS) -> dict[str, FloatArray]:
    """Return figures of merit by key, each broadcast to the shape of the design.

    Parameters
    ----------
    design : PosfetDesign
        One design or arrays.
    keys : iterable of str, optional
        Keys of `FIGURES`; all by default.

    Returns
    -------
    dict of str to ndarray
        Values, NaN where unknown.

    Raises
    ------
    ValueError
        A key is unknown.
    """
    by_key = {figure.key: figure for figure in FIGURES}
    chosen = list(keys)
    unknown = [key for key in chosen if key not in by_key]
    if unknown:
        raise ValueError(f"figures must be of {', '.join(KEYS)}, got {unknown[0]}")
    with np.errstate(divide="ignore", invalid="ignore"):
        return {key: np.broadcast_to(by_key[key].value(design), design.shape) for key in chosen}


def _of_single(design: PosfetDesign) -> dict[str, float]:
    """Return the figures of a single design; overshoot and slew rates are those of steps, by integration."""
    known = {key: float(value) for key, value in values(design).items()}
    with np.errstate(divide="ignore", invalid="ignore"):  # transistors in cut-off
        overshoot = 100 * step_test(design.follower()).overshoot if design.amplifier.stable else math.nan
        known["slew_v_per_s"], known["falling_slew_v_per_s"] = _slew_rates(design)
    known["overshoot_pct"] = overshoot
    return {figure.key: known[figure.key] for figure in REPORT}


def as_json(design: PosfetDesign) -> dict[str, Any]:
    """Return the report of a single design for JSON: a value that is unknown or infinite is None.

    Parameters
    ----------
    design : PosfetDesign
        The design.

    Returns
    -------
    dict
        Every figure by key, and ``valid``, ``stable``, ``reasons``.

    Raises
    ------
    ValueError
        The design has arrays.
    """
    _require_single(design)
    numbers = _of_single(design)
    return {
        "valid": bool(design.valid),
        "stable": bool(design.amplifier.stable),
        "reasons": design.reasons,
        "stages": design.stages,
        "slew_rate_known": design.slew_rate_known,
        "poles_known": design.poles_known,
        "film_geometry": design.film_geometry.value,
        **{key: value if math.isfinite(value) else None for key, value in numbers.items()},
    }


def as_text(design: PosfetDesign) -> str:
    """Return the report of a single design as aligned lines of key, value, unit and meaning.

    Parameters
    ----------
    design : PosfetDesign
        The design.

    Returns
    -------
    str
        Lines, without a final line break.

    Raises
    ------
    ValueError
        The design has arrays.
    """
    _require_single(design)
    numbers = _of_single(design)
    shown = [(figure, readable(numbers[figure.key], figure.unit)) for figure in REPORT]
    lines = [f"{figure.key:27}{text:>18}  {figure.meaning}" for figure, text in shown]
    verdict = "valid" if design.valid else f"not valid: {'; '.join(design.reasons)}"
    return "\n".join([*lines, verdict])


def readable(value: float, unit: str) -> str:
    """Return a number with a unit for people, with four digits and an SI prefix.

    Parameters
    ----------
    value : float
        Value in the unit.
    unit : str
        Unit.

    Returns
    -------
    str
        The text.

    Examples
    --------
    >>> readable(42.5e-12, "F"), readable(float("nan"), "Hz"), readable(1.05e-6, "m2")
    ('42.5 pF', 'unknown', '1.05 mm2')
    """
    if math.isnan(value):
        return "unknown"
    if unit == "m2":
        return f"{value * 1e6:.4g} mm2"
    if unit in _PLAIN or value == 0 or math.isinf(value):
        return f"{value:.4g} {unit if unit != '1' else ''}".rstrip()
    exponent = min(max(3 * math.floor(math.log10(abs(value) * (1 + 1e-12)) / 3), min(_PREFIXES)), max(_PREFIXES))
    return f"{value / 10.0**exponent:.4g} {_PREFIXES[exponent]}{unit}"


def _require_single(design: PosfetDesign) -> None:
    if design.shape:
        raise ValueError(f"design must be a single one, got arrays of shape {design.shape}; use design.at(...)")
