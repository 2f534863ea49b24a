# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every public function and method of the device model rejects values that are no real number, and incompatible shapes.

The functions are collected from the modules, so that a new one without an entry here fails. Ranges are verified by the
tests of each module.
"""

import importlib
import inspect
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from posfet_model.amplifier import closed_loop, follower, two_stage
from posfet_model.amplifier.closed_loop import FollowerLimits
from posfet_model.amplifier.differential_pair import Lead
from posfet_model.device import paper, transistor
from posfet_model.device.mechanics import Layer
from posfet_model.device.taxel import Taxel
from posfet_model.device.taxel_fields import FilmGeometry
from posfet_model.spice.ngspice import SmallSignal
from support.each_row import each_row
from support.sweep import Refusal, assert_all_refused

MODULES = [
    importlib.import_module(f"posfet_model.{room}.{name}")
    for room, names in {
        "amplifier": "closed_loop differential_pair follower follower_base one_stage operating_point pair_settling "
        "slew_identification two_stage",
        "device": "adc as_printed charge film mechanics noise paper taxel taxel_fields threshold_extraction transistor",
        "spice": "ngspice",
    }.items()
    for name in names.split()
]
NUMBERS = {"ArrayLike", "float", "float | None", "float | FloatArray", "Values"}
MASKED = np.ma.masked_array([1.0, 2.0], mask=[False, True])
NO_NUMBERS: tuple[Any, ...] = (
    *(float("nan"), 1 + 1j, "one", True, np.array(["one"]), np.array([1 + 1j]), object()),
    *(MASKED, [MASKED, MASKED]),
)
NO_OBJECTS: tuple[Any, ...] = (0, "one", 1.5, object())
TEXT = {"str", "bytes", "bool", "Callable", "np.random.Generator", "Sequence[Layer]", "Sequence[str]", "History"}
"""Kinds of argument that the tests of their modules verify."""

PLATE = {"pressure": 1e3, "thickness": 5e-5, "young_modulus": 169e9, "poisson_ratio": 0.3}
BENT = {"deflection": 1e-6, "pressure": 1e3, "young_modulus": 169e9, "poisson_ratio": 0.3}
CURRENT = {"gate_voltage": 1.7, "drain_voltage": 5.0, "threshold_voltage": 0.7, "gain_factor": 1e-3}
STEP = {"charge": 0.0, "source_start": 0.0, "source_end": 1e-5, "step": 1e-3, "time_constant": 0.27}
CURVE = {"gate_voltage": np.linspace(1, 2, 9), "drain_current": np.linspace(0.1, 1, 9) ** 2, "drain_voltage": 5.0}
CONVERTER = {"bits": 12, "low": -5.0, "high": 5.0}
BAND = {"low": 0.1, "high": 1e3}
ONE_POLE = follower.OnePoleFollower(gain=0.99, bandwidth=1e6)
FIELDS = {"coercive_field": 160e5, "remnant_polarisation": 0.02, "saturation_polarisation": 0.05}

GOOD: dict[str, dict[str, Any]] = {
    "adc.lsb": CONVERTER,
    "adc.volts_to_counts": {"volts": 0.0, **CONVERTER},
    "adc.counts_to_volts": {"counts": 7, **CONVERTER},
    "two_stage.figures_of_merit": {"bias": two_stage.CIRCUIT_B, "design": two_stage.TABLE_II},
    "two_stage.mismatch_offset": {
        "figures": two_stage.figures_of_merit(),
        **dict.fromkeys(("pair_threshold", "load_threshold", "pair_size", "load_size"), 0.0),
    },
    "as_printed.electric_displacement": {
        "stress": 1e6,
        "piezoelectric_coefficient": -38e-12,
        "relative_permittivity": 12.0,
    },
    "as_printed.branch_steepness": FIELDS,
    "as_printed.threshold_shift": {"charge": 0.07, "stack": paper.STACK},
    "as_printed.signal_current": {
        "charge": 1e-5,
        "overdrive": 1.0,
        "mobility": 0.085,
        "aspect": 273.0,
        "stack": paper.STACK,
    },
    "as_printed.saturation_current": {"gate_voltage": 1.7, "threshold_voltage": 0.7, "gain_factor": 1e-3},
    "as_printed.circular_deflection": {**PLATE, "radius": 5e-3},
    "as_printed.square_deflection": {**{k: v for k, v in PLATE.items() if k != "poisson_ratio"}, "side": 1e-2},
    "charge.source_charge": {
        "stress": 1e6,
        "temperature_change": 1.0,
        "piezoelectric_coefficient": -38e-12,
        "pyroelectric_coefficient": -4e-5,
    },
    "charge.electric_displacement": {
        "stress": 1e6,
        "field": 1e6,
        "piezoelectric_coefficient": -38e-12,
        "relative_permittivity": 12.0,
    },
    "charge.propagate_first_order_hold": STEP,
    "charge.propagate_step": STEP,
    "charge.invert_first_order_hold": {"charge_start": 0.0, "charge_end": 1e-5, "step": 1e-3, "time_constant": 0.27},
    "charge.frequency_response": {"frequency": 1.0, "time_constant": 0.27},
    "charge.step_response": {"time": 1.0, "time_constant": 0.27},
    "differential_pair.pair_current": {"overdrive": 0.3},
    "differential_pair.pair_transconductance": {"overdrive": 0.3},
    "differential_pair.Lead": {"linear": 0.1, "square": 0.1},
    "film.Film": {**FIELDS, "relative_permittivity": 12.0},
    "film.History": {"field": 0.0, "switched": 0.0, "direction": 0, "turning_points": ()},
    "film.branch_steepness": FIELDS,
    "film.rising_branch": {"field": 1e6, "film": paper.FILM},
    "film.falling_branch": {"field": 1e6, "film": paper.FILM},
    "film.saturated": {"film": paper.FILM, "positive": True},
    "film.polarise": {"fields": [0.0, 1e6], "film": paper.FILM},
    "film.remnant_after": {"fields": [0.0, 1e6], "film": paper.FILM},
    "film.piezoelectric_coefficient": {
        "remnant_polarisation": 0.01,
        "film": paper.FILM,
        "saturated_coefficient": -38e-12,
    },
    "closed_loop.close_loop": {"open_loop_gain": 130.0, "gain_bandwidth": 1.5e6},
    "follower.IdealFollower": {"offset": 0.0, "limits": FollowerLimits()},
    "follower.StaticFollower": {"gain": 0.99, "offset": 0.0},
    "follower.OnePoleFollower": {"gain": 0.99, "bandwidth": 1e6},
    "follower.TwoPoleFollower": {"gain": 0.99, "natural_frequency": 1e6, "quality": 0.5},
    "follower.TwoPoleFollower.from_bandwidth": {"gain": 0.99, "bandwidth": 1e6, "quality": 0.5},
    "follower.SquareLawFollower": {"gain": 0.99, "bandwidth": 1e6, "overdrive": 0.4, "lead": Lead()},
    "follower_base.Follower.start": {"v_in": 0.0},
    "follower_base.Follower.advance": {"state": ONE_POLE.start(0.0), "v_in": 0.0, "step": 1.0},
    "follower_base.Follower.advance_series": {"state": ONE_POLE.start(0.0), "v_in": [0.0, 0.0], "step": 1.0},
    "follower_base.Follower.output": {"state": ONE_POLE.start(0.0)},
    "follower_base.Follower.run": {"time": [0.0, 1.0], "v_in": [0.0, 1.0]},
    "follower_base.Follower.response": {"frequency": 1.0},
    "closed_loop.FollowerLimits": {
        "v_low": -5.0,
        "v_high": 5.0,
        "slew_rate": 1e6,
        "falling_slew_rate": 1e6,
        "frequency": 1e6,
    },
    "mechanics.Layer": {"thickness": 2e-5, "young_modulus": 169e9, "poisson_ratio": 0.3},
    "mechanics.mask_opening": {"membrane_width": 1e-2, "etch_depth": 4e-4},
    "mechanics.circular_deflection": {**PLATE, "radius": 5e-3},
    "mechanics.square_deflection": {**PLATE, "side": 1e-2},
    "mechanics.circular_thickness": {**BENT, "radius": 5e-3},
    "mechanics.square_thickness": {**BENT, "side": 1e-2},
    "mechanics.bend_on_cylinder": {"layers": [Layer(2e-5, 169e9, 0.3)], "cylinder_radius": 1e-2},
    "noise.resistor_density": {"resistance": 1e10, "temperature": 300.0},
    "noise.pair_density": {"input_transconductance": 5e-4, "load_transconductance": 3e-4, "temperature": 300.0},
    "noise.flicker_density": {"coefficient": 1e-10, "frequency": 1.0},
    "noise.white_rms": {"density": 1e-16, **BAND},
    "noise.bias_resistor_rms": {"resistance": 1e10, "capacitance": 27e-12, "temperature": 300.0, **BAND},
    "noise.flicker_rms": {"coefficient": 1e-10, **BAND},
    "noise.gate_flicker_coefficient": {"constant": 1e-24, "width": 3e-3, "length": 12e-6, "capacitance": 7.7e-4},
    "noise.sampling_rms": {"capacitance": 1e-11, "temperature": 300.0},
    "noise.quantisation_rms": {"lsb": 1e-3},
    "noise.flicker_sequence": {"coefficient": 1e-10, "rate": 1e3, "samples": 8, "generator": np.random.default_rng(1)},
    "noise.NoiseBudget.minimum_force": {"sigmas": 3.0},
    "noise.NoiseBudget.signal_to_noise": {"force": 1.0},
    "noise.noise_budget": {
        "bias_rms": 1e-5,
        "thermal_density": 1e-16,
        "flicker_coefficient": 1e-10,
        "lsb": 1e-3,
        "volts_per_newton": 0.9,
        "gain": 1.0,
        "sampled_rms": 2e-5,
        **BAND,
    },
    "one_stage.one_stage_figures": {"bias": two_stage.CIRCUIT_B, "design": two_stage.TABLE_II},
    "operating_point.AmplifierBias": {
        "reference_current": 2e-4,
        "supply": 5.0,
        "compensation": 46e-12,
        "zero_resistor": 2631.0,
        "load_capacitance": 1e-11,
        "load_resistance": 1.1e4,
        "modulation": 0.1,
        "threshold": 0.7,
    },
    "operating_point.AmplifierDesign": {
        "sizes": paper.AMPLIFIER_SIZES,
        "stack": paper.STACK,
        "electron_mobility": 0.085,
        "hole_mobility": 0.0283,
        "pair_threshold_shift": 0.0,
    },
    "paper.TransistorSize": {"name": "M1", "width": 3e-3, "length": 12e-6},
    "paper.channel_gain_factor": {"plane": transistor.Plane.GATE},
    "slew_identification.slew_model": {
        "loop": closed_loop.ClosedLoop(0.99, 1.4e6),
        "gain_bandwidth": 1.5e6,
        "stages": 2,
    },
    "slew_identification.two_stage_model": {"bias": two_stage.CIRCUIT_B, "design": two_stage.TABLE_II},
    "slew_identification.one_stage_model": {"bias": two_stage.CIRCUIT_B, "design": two_stage.TABLE_II},
    "slew_identification.SlewModel.follower": {"overdrive": 0.4},
    "ngspice.netlist": {"circuit": "opamp_b"},
    "ngspice.piecewise_linear": {"time": [0.0, 1.0], "volts": [0.0, 1.0]},
    "ngspice.run_follower": {"circuit": "", "source": "", "stop": 1.0, "largest_step": 1e-3},
    "ngspice.run_follower_ac": {"circuit": "", "lowest": 1.0, "highest": 1e8, "per_decade": 50},
    "ngspice.run_open_loop_ac": {"circuit": "", "lowest": 1.0, "highest": 1e8, "per_decade": 50},
    "ngspice.run_loop_gain": {"circuit": "", "lowest": 1.0, "highest": 1e8, "per_decade": 50},
    "ngspice.run_double_injection": {"circuit": "", "lowest": 1.0, "highest": 1e8, "per_decade": 50},
    "ngspice.run_operating_point": {"circuit": "", "quantities": ["v(out)"]},
    "ngspice.closed_loop": {"response": SmallSignal(np.array([1.0, 2.0]), np.array([1 + 0j, 0.1]))},
    "ngspice.read_raw": {"content": b"", "complex_values": False},
    "taxel_fields.TaxelFields": {
        "film_area": 1e-6,
        "film_thickness": 2.5e-6,
        "film_permittivity": 12.0,
        "piezoelectric_coefficient": -38e-12,
        "pyroelectric_coefficient": -4e-5,
        **FIELDS,
        "poling_voltages": (80.0, 0.0),
        "uncompensated_fraction": 6e-4,
        "gate_width": 3e-3,
        "gate_length": 12e-6,
        "oxide_thickness": 45e-9,
        "oxide_permittivity": 3.9,
        "electron_mobility": 0.085,
        "threshold_voltage": 0.7,
        "bias_resistance": 1e10,
        "film_geometry": FilmGeometry.EXTENDED,
    },
    "taxel.Taxel.volts_per_newton": {"plane": transistor.Plane.GATE},
    "taxel.Taxel.gain_factor": {"plane": transistor.Plane.GATE},
    "taxel.Taxel.drain_current": {"gate_voltage": 1.7, "drain_voltage": 5.0, "channel_length_modulation": 0.0},
    "taxel.Taxel.bias_noise": {**BAND, "temperature": 300.0},
    "threshold_extraction.fit_saturation_curve": CURVE,
    "threshold_extraction.fit_linear_curve": {**CURVE, "drain_voltage": 0.05},
    "transistor.Stack": {"oxide": 7.7e-4, "film": 4.2e-5},
    "transistor.Stack.drive": {"plane": transistor.Plane.GATE},
    "transistor.Stack.charge_divisor": {"plane": transistor.Plane.GATE},
    "transistor.capacitance_per_area": {"relative_permittivity": 3.9, "thickness": 45e-9},
    "transistor.threshold_shift": {
        "charge": 0.07,
        "stack": paper.STACK,
        "plane": transistor.Plane.GATE,
        "uncompensated_fraction": 0.01,
    },
    "transistor.uncompensated_fraction": {
        "shift": -1.0,
        "charge": 0.07,
        "stack": paper.STACK,
        "plane": transistor.Plane.OXIDE,
    },
    "transistor.gain_factor": {"mobility": 0.085, "capacitance": 4e-5, "width": 3e-3, "length": 12e-6},
    "transistor.drain_current": {**CURRENT, "channel_length_modulation": 0.0},
    "transistor.transconductance": {**CURRENT, "channel_length_modulation": 0.0},
    "transistor.output_conductance": {**CURRENT, "channel_length_modulation": 0.0},
    "transistor.gate_voltage": {
        **{k: v for k, v in CURRENT.items() if k != "gate_voltage"},
        "drain_current": 1e-3,
        "channel_length_modulation": 0.0,
    },
}
"""A valid call of each public function, except those of ngspice."""

SELVES = {
    "Follower": ONE_POLE,
    "NoiseBudget": None,
    "SlewModel": None,
    "Stack": paper.STACK,
    "Taxel": Taxel(),
}


def _public(module: ModuleType) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield functions, validating classes and their methods; docstrings of internal ones say "unchecked"."""
    short = module.__name__.rpartition(".")[2]
    if "unchecked" in (module.__doc__ or ""):
        members = {n: m for n, m in vars(module).items() if inspect.isclass(m)}
    else:
        members = dict(vars(module))
    for name, member in members.items():
        home = getattr(member, "__module__", None) or ""  # a subpackage shows what its modules define
        if name.startswith("_") or (home != module.__name__ and not home.startswith(f"{module.__name__}.")):
            continue
        if inspect.isclass(member):
            if "__post_init__" in vars(member) and not inspect.isabstract(member):
                yield f"{short}.{name}", member
            if name == "IdealFollower":
                yield f"{short}.{name}", member
            for inner, method in vars(member).items():
                if inner.startswith("_") or "nchecked" in (method.__doc__ or ""):
                    continue
                if isinstance(method, classmethod):
                    yield f"{short}.{name}.{inner}", getattr(member, inner)
                elif inspect.isfunction(method):
                    yield f"{short}.{name}.{inner}", method
        elif inspect.isfunction(member) and "nchecked" not in (member.__doc__ or ""):
            yield f"{short}.{name}", member


FUNCTIONS = {name: function for module in MODULES for name, function in _public(module)}


def _parameters(function: Callable[..., Any]) -> dict[str, str]:
    """Return names and kinds of the parameters, without self."""
    parameters = inspect.signature(function).parameters.values()
    return {p.name: str(p.annotation) for p in parameters if p.name != "self"}


def _bound(name: str) -> Callable[..., Any]:
    """Return the function; a method is bound to an object of its class."""
    function = FUNCTIONS[name]
    if "self" not in inspect.signature(function).parameters:
        return function
    return getattr(_selves()[name.split(".")[1]], name.split(".")[2])


def _selves() -> dict[str, Any]:
    noise = importlib.import_module("posfet_model.device.noise")
    slew_model = importlib.import_module("posfet_model.amplifier.slew_identification")
    return {
        **SELVES,
        "NoiseBudget": noise.noise_budget(**GOOD["noise.noise_budget"]),
        "SlewModel": slew_model.slew_model(**GOOD["slew_identification.slew_model"]),
    }


def test_every_function_has_an_entry_here() -> None:
    wanted = {name for name, function in FUNCTIONS.items() if _parameters(function)}
    assert wanted == set(GOOD)
    assert len(GOOD) > 70
    for name, arguments in GOOD.items():
        assert set(arguments) <= set(_parameters(FUNCTIONS[name])), name


def test_the_valid_call_of_every_entry_is_accepted() -> None:
    with each_row() as row:
        for name, arguments in GOOD.items():
            if not name.startswith(("ngspice.run", "ngspice.read", "ngspice.closed")):
                with row(name):
                    _bound(name)(**arguments)


def _refused(name: str) -> list[Refusal]:
    """Return the calls that the function must reject, for each argument."""
    return [
        (argument, {**GOOD[name], argument: value})
        for argument, kind in _parameters(FUNCTIONS[name]).items()
        if kind not in TEXT
        for value in (NO_NUMBERS if kind in NUMBERS or kind == "int" else NO_OBJECTS)
    ]


REFUSED = {name: cases for name in GOOD if name != "ngspice.closed_loop" and (cases := _refused(name))}


def test_nearly_two_thousand_values_are_tried() -> None:
    assert sum(len(cases) for cases in REFUSED.values()) >= 1930


@pytest.mark.parametrize("name", REFUSED)
def test_an_invalid_value_is_rejected_by_name(name: str) -> None:
    assert_all_refused(_bound(name), REFUSED[name])


def _shapes() -> Iterator[tuple[str, str, str]]:
    for name, arguments in GOOD.items():
        kinds = _parameters(FUNCTIONS[name])
        arrays = [argument for argument in arguments if kinds.get(argument) == "ArrayLike"]
        for argument in arrays[1:]:
            yield name, arrays[0], argument


def test_incompatible_shapes_are_rejected() -> None:
    """Two elements of one argument and three of another are inconsistent."""
    with each_row() as row:
        for name, first, second in _shapes():
            arguments = GOOD[name]
            wrong = {
                **arguments,
                first: np.resize(np.asarray(arguments[first], float), 2),
                second: np.resize(np.asarray(arguments[second], float), 3),
            }
            with row(f"{name}, {first} and {second}"), pytest.raises(ValueError, match=rf"\b({first}|{second})\b"):
                _bound(name)(**wrong)
