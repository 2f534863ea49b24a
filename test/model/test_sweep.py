"""One sweep over the whole range of use, any combination: each result against 40 digits, the error found per region."""

import importlib.util
import math
import sys
from functools import cache

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from model.sweep import DATA, ErrorMap, assert_finite, decades, signed_decades

from posfet_model import charge, film, paper, transistor

EPS = np.finfo(np.float64).eps
FILM = paper.FILM
BETA = 9.3446e-4


@cache
def _equations():
    """The equations behind the reference tables, in mpmath."""
    spec = importlib.util.spec_from_file_location("device_equations", DATA / "generate.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules["device_equations"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _error(computed, exact, scale) -> float:
    """The error as a share of the scale, NaN and overflow included."""
    assert_finite(computed)
    return float(abs(mpmath.mpf(float(computed)) - exact) / mpmath.mpf(float(scale))) if scale else abs(float(computed))


@pytest.mark.filterwarnings("error")
def test_every_step_force_temperature_field_and_voltage(record_property) -> None:
    found = {np.float64: ErrorMap(8 * EPS), np.float32: ErrorMap(8 * float(np.finfo(np.float32).eps))}
    equations = _equations()

    @settings(max_examples=400, deadline=None)
    @given(
        dtype=st.sampled_from([np.float64, np.float32]),
        step=decades(1e-9, 1e3),
        time_constant=decades(1e-9, 1e9),
        force=st.one_of(st.just(0.0), decades(1e-9, 1e4)),
        celsius=st.floats(-60, 150),
        before=signed_decades(1e-9, 1.0),
        field=signed_decades(1e-3, 1e12),
        overdrive=signed_decades(1e-9, 1e3),
        drain=st.one_of(st.just(0.0), decades(1e-9, 1e3)),
    )
    def sweep(dtype, step, time_constant, force, celsius, before, field, overdrive, drain) -> None:
        errors = found[dtype]
        arguments = [dtype(value) for value in (-force / 1e-6, celsius - 20, -38e-12, -40e-6)]
        source = charge.source_charge(*arguments)
        stress, change, piezo, pyro = map(float, arguments)
        exact = equations.source(stress, change, 0.0, piezo, pyro, 12.0)[0]
        errors.add("source charge", _error(source, exact, abs(piezo * stress) + abs(pyro * change)))

        charges = [dtype(before), dtype(0), dtype(source)]
        after = charge.propagate_first_order_hold(*charges, step, time_constant)
        exact = equations.first_order_hold(*(mpmath.mpf(float(v)) for v in (*charges, step, time_constant)))[0]
        decade = 6 * math.floor(math.log10(step / time_constant) / 6)
        errors.add(f"charge, step/tau from 1e{decade}", _error(after, exact, np.max(np.abs(charges))))

        field = dtype(field)
        rising = film.rising_branch(field, FILM)
        inputs = (FILM.coercive_field, FILM.remnant_polarisation, FILM.saturation_polarisation, 12.0)
        exact = equations.film_branches(*(mpmath.mpf(float(v)) for v in (field, *inputs)))[1]
        # tanh' is at most 1, and its argument carries the rounding of a field near the coercive one.
        scale = FILM.saturation_polarisation * (1 + FILM.coercive_field / FILM.steepness) + abs(float(exact))
        errors.add(
            f"film, field to 1e{3 * math.ceil(math.log10(max(abs(field), 1)) / 3)} V/m", _error(rising, exact, scale)
        )

        bias = [dtype(overdrive), dtype(drain), dtype(0), dtype(BETA), dtype(0)]
        current = transistor.drain_current(*bias)
        exact = equations.transistor(*(mpmath.mpf(float(v)) for v in (bias[0], bias[1], bias[3], 0)))[0]
        errors.add("drain current", _error(current, exact, exact))

    sweep()
    for dtype, errors in found.items():
        errors.worst = {f"{dtype.__name__} {region}": error for region, error in sorted(errors.worst.items())}
        errors.check(record_property)
