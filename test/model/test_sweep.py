# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One sweep over the whole range of use, corners first: each result against 40 digits, with the error per region."""

import importlib.util
import itertools
import math
import sys
from collections.abc import Callable
from functools import cache
from types import ModuleType

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_model.amplifier.follower import OnePoleFollower, SquareLawFollower, TwoPoleFollower
from posfet_model.device import charge, film, noise, paper, transistor
from support.sweep import CALL_ULPS, DATA, EPS, ErrorMap, assert_finite, assert_monotone, decades, signed_decades

FILM = paper.FILM
BETA = 9.3446e-4
QUALITY = 0.4
OVERDRIVE = 0.4
DTYPES = (np.float64, np.float32)

STEPS, TIME_CONSTANTS = (1e-9, 1e3), (1e-9, 1e9)
FORCES, CELSIUS, FIELDS, VOLTS = (0.0, 1e4), (-60.0, 150.0), (-1e12, 1e12), (0.0, 1e3)
CORNERS = list(itertools.product(DTYPES, STEPS, TIME_CONSTANTS, FORCES, CELSIUS, (0.0, *FIELDS), VOLTS))

Found = dict[type, ErrorMap]


@cache
def _equations(script: str) -> ModuleType:
    """Return the module with the equations of the reference tables, in mpmath."""
    sys.path.insert(0, str(DATA))
    try:
        spec = importlib.util.spec_from_file_location(f"device_{script}", DATA / f"{script}.py")
        assert spec is not None and spec.loader is not None
        module = sys.modules[f"device_{script}"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(DATA))
    return module


def _exact(function: Callable[..., object], *values: float) -> list[mpmath.mpf]:
    return list(function(*(mpmath.mpf(float(value)) for value in values)))


def _error(computed, exact, scale) -> float:
    """Return the error relative to the scale, NaN and overflow included."""
    assert_finite(computed)
    return float(abs(mpmath.mpf(float(computed)) - exact) / mpmath.mpf(float(scale))) if scale else abs(float(computed))


def _charge(errors: ErrorMap, dtype: type, step: float, time_constant: float, force: float, celsius: float) -> None:
    equations = _equations("generate")
    arguments = [dtype(value) for value in (-force / 1e-6, celsius - 20, -38e-12, -40e-6)]
    source = charge.source_charge(*arguments)
    stress, change, piezo, pyro = map(float, arguments)
    exact = _exact(equations.source, stress, change, 0.0, piezo, pyro, 12.0)[0]
    errors.add("source charge", _error(source, exact, abs(piezo * stress) + abs(pyro * change)))

    charges = [dtype(1e-5), dtype(0), dtype(source)]
    after = charge.propagate_first_order_hold(*charges, step, time_constant)
    exact = _exact(equations.first_order_hold, *charges, step, time_constant)[0]
    errors.add(f"charge, {_decade(step / time_constant)}", _error(after, exact, np.max(np.abs(charges))))


def _decade(ratio: float) -> str:
    return f"step/tau from 1e{6 * math.floor(math.log10(ratio) / 6)}"


def _follower(errors: ErrorMap, dtype: type, step: float, time_constant: float, volts: float) -> None:
    """A jump, and a ramp over the step: the input is float32, the state float64."""
    bandwidth = 1 / (2 * math.pi * time_constant)
    volts = float(dtype(volts))
    equations = _equations("generate_follower")
    one = OnePoleFollower(gain=1.0, bandwidth=bandwidth)
    ratio = step / one.time_constant
    lag = one.advance(one.start(dtype(0)), dtype(volts), step).lags[-1]
    errors.add(
        f"one pole from {dtype.__name__}, {_decade(ratio)}",
        _error(lag, volts * _exact(equations.decay, ratio)[0], volts),
    )

    two = TwoPoleFollower(gain=1.0, natural_frequency=bandwidth, quality=QUALITY)
    phase = step * (2 * math.pi * two.natural_frequency)
    lag = two.advance(two.start(dtype(0)), dtype(volts), step).lags[-1].real
    errors.add(
        f"two poles from {dtype.__name__}, {_decade(phase)}",
        _error(lag, volts * _exact(equations.two_pole, phase, QUALITY)[0], 2 * volts),  # three complex means, not two
    )

    pair = SquareLawFollower(gain=1.0, bandwidth=bandwidth, overdrive=OVERDRIVE)
    lags = [float(pair.advance(pair.start(dtype(0)), dtype(volts), step * part).lags[-1]) for part in (0.5, 1.0, 2.0)]
    assert_finite(lags)
    rounding = 8 * EPS * (volts + OVERDRIVE)
    assert_monotone(lags, rising=False, slack=rounding)  # the slower the ramp, the smaller the lag
    # Between the input and the lag of the small-signal pole: the pair never settles faster than that.
    assert max(lags) <= volts + rounding
    assert lags[1] >= volts * float(_exact(equations.decay, ratio)[0]) - rounding


def _film(errors: ErrorMap, dtype: type, field: float) -> None:
    value = dtype(field)
    rising = film.rising_branch(value, FILM)
    inputs = (FILM.coercive_field, FILM.remnant_polarisation, FILM.saturation_polarisation, 12.0)
    exact = _exact(_equations("generate").film_branches, value, *inputs)[1]
    # tanh' is at most 1, and its argument contains the rounding of a field near the coercive one.
    scale = FILM.saturation_polarisation * (1 + FILM.coercive_field / FILM.steepness) + abs(float(exact))
    thousand = 3 * math.ceil(math.log10(max(abs(float(value)), 1)) / 3)
    errors.add(f"film, field to 1e{thousand} V/m", _error(rising, exact, scale))
    assert film.falling_branch(value, FILM) >= rising - 8 * float(np.finfo(dtype).eps) * scale


def _current(errors: ErrorMap, dtype: type, overdrive: float, drain: float, celsius: float) -> None:
    bias = [dtype(overdrive), dtype(drain), dtype(0), dtype(BETA), dtype(0)]
    current = transistor.drain_current(*bias)
    exact = _exact(_equations("generate").transistor, bias[0], bias[1], bias[3], 0)[0]
    errors.add("drain current", _error(current, exact, exact))
    kelvin = dtype(celsius + 273.15)
    density = noise.pair_density(dtype(BETA), dtype(BETA), kelvin)
    exact = _exact(_equations("generate_follower").noise, dtype(BETA), dtype(BETA), kelvin, 1.0, 2.0)[0]
    errors.add("thermal noise", _error(density, exact, exact))


def _everything(
    found: Found,
    dtype: type,
    step: float,
    time_constant: float,
    force: float,
    celsius: float,
    field: float,
    overdrive: float,
    drain: float,
) -> None:
    errors = found[dtype]
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        _charge(errors, dtype, step, time_constant, force, celsius)
        _follower(found[np.float64], dtype, step, time_constant, overdrive)
        _film(errors, dtype, field)
        _current(errors, dtype, overdrive, drain, celsius)


@pytest.mark.filterwarnings("error")
def test_every_step_time_constant_force_temperature_field_and_voltage(record_property) -> None:
    # Two calls and 4 EPS, or one call and as many roundings: the longest chains are the charge
    # (`test_charge.step_error`) and the branch of the film (`test_film.branch_error`).
    found: Found = {dtype: ErrorMap((CALL_ULPS[dtype] + 6) * float(np.finfo(dtype).eps)) for dtype in DTYPES}

    @settings(max_examples=200, deadline=None)
    @given(
        dtype=st.sampled_from(DTYPES),
        step=decades(*STEPS),
        time_constant=decades(*TIME_CONSTANTS),
        force=st.one_of(st.just(0.0), decades(1e-9, FORCES[1])),
        celsius=st.floats(*CELSIUS),
        field=signed_decades(1e-3, FIELDS[1]),
        overdrive=st.one_of(st.just(0.0), decades(1e-9, VOLTS[1])),
        drain=st.one_of(st.just(0.0), decades(1e-9, VOLTS[1])),
    )
    def sweep(**values) -> None:
        _everything(found, **values)

    for corner in CORNERS:
        for drain in VOLTS if corner[-1] else VOLTS[:1]:
            _everything(found, *corner, drain)
    sweep()
    for dtype, errors in found.items():
        errors.worst = {f"{dtype.__name__} {region}": error for region, error in sorted(errors.worst.items())}
        errors.check(record_property)


@pytest.mark.parametrize("size", [0, 1, 25, 1_000_000])
@pytest.mark.parametrize("dtype", DTYPES)
def test_every_array_size_from_empty_to_a_million_taxels(size: int, dtype: type) -> None:
    """Shape and dtype are preserved, and each element equals the result of a scalar call."""
    spread = np.linspace(-1, 1, size, dtype=dtype)
    one = OnePoleFollower(gain=1.0, bandwidth=1.5e6)
    functions: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "charge": lambda x: charge.propagate_first_order_hold(x, dtype(0), x, 1e-3, 0.27),
        "film": lambda x: film.rising_branch(x * dtype(1e12), FILM),
        "current": lambda x: transistor.drain_current(x, dtype(1), dtype(0), dtype(BETA)),
        "noise": lambda x: noise.resistor_density(x + dtype(2), dtype(300)),
        "follower": lambda x: one.output(one.advance(one.start(0 * x), x, 1e-7)).v_out,
    }
    for name, function in functions.items():
        whole = function(spread)
        assert whole.shape == (size,), name
        assert whole.dtype == (np.float64 if name == "follower" else dtype), name
        assert_finite(whole)
        for place in {0, size // 2, size - 1} if size else set():
            alone = float(function(spread[place]))
            assert abs(alone - float(whole[place])) <= 4 * np.finfo(dtype).eps * abs(alone), name
