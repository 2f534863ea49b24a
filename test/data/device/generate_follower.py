# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Write the 40-digit reference tables of follower and noise: ``python test/data/device/generate_follower.py``.

As in generate.py: textbook form, mpmath at 80 digits, no code of posfet_model.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterable, Sequence

import mpmath
from generate import VACUUM_PERMITTIVITY, Table, write
from mpmath import mpf

BOLTZMANN = 1.380649e-23  # J/K, exact
RATIOS = [10.0**k for k in range(-18, 19, 2)] + [0.03, 0.3, 0.7, 1.5, 3.0, 7.0, 20.0, 300.0]


def decay_cases() -> Iterable[Sequence[float]]:
    """Ratios over 36 decades, and the neighbourhood of 1."""
    return [(x,) for x in RATIOS]


def decay(x: mpf) -> Sequence[mpf]:
    """(1 - exp(-x))/x."""
    return (-mpmath.expm1(-x) / x,)


def two_pole_cases() -> Iterable[Sequence[float]]:
    """Steps in units of 1/w0 over 15 decades, from two real poles through equal ones to ringing."""
    return itertools.product([1e-9, 1e-6, 1e-3, 0.1, 0.5, 1.0, 3.0, 10.0, 100.0, 1e6], [0.05, 0.4, 0.5, 0.7, 5.0, 50.0])


def two_pole(phase: mpf, quality: mpf) -> Sequence[mpf]:
    """Lag behind an input that rises by 1 over the step, from rest: l'' + l'/Q + l = r/Q with l(0) = 0, l'(0) = r."""
    slope = 1 / phase
    final = slope / quality
    middle = 1 / (2 * quality)
    if middle == 1:
        return (final + (-final + (slope - final) * phase) * mpmath.exp(-phase),)
    root = mpmath.sqrt(mpmath.mpc(middle**2 - 1))
    fast, slow = -middle - root, -middle + root
    weight = (slope + final * fast) / (slow - fast)
    return ((final + weight * mpmath.exp(slow * phase) - (final + weight) * mpmath.exp(fast * phase)).real,)


def pair_current(x: mpf) -> mpf:
    """Difference of drain currents of the pair."""
    return x * mpmath.sqrt(1 - x**2 / 4) if abs(x) < mpmath.sqrt(2) else mpmath.sign(x)


def pair_cases() -> Iterable[Sequence[float]]:
    """Overdrives either side of saturation."""
    return [(sign * x,) for x in (0.0, 1e-9, 1e-3, 0.3, 1.0, 1.41, 1.4142135, 1.5, 30.0) for sign in (1, -1)]


def pair(x: mpf) -> Sequence[mpf]:
    """Current and its derivative."""
    inside = abs(x) < mpmath.sqrt(2)
    return pair_current(x), (1 - x**2 / 2) / mpmath.sqrt(1 - x**2 / 4) if inside else mpf(0)


def settle_cases() -> Iterable[Sequence[float]]:
    """Way from one overdrive to another at a slope, in the direction the pair goes, with and without a lead."""
    for lead in [(0.0, 0.0), (0.07, 0.17), (1.0, -0.5), (0.0, 0.5)]:
        yield from ((*way, *lead) for way in _ways())


def _ways() -> Iterable[Sequence[float]]:
    falling = [(3.0, 1.0), (1.3, 0.9), (1.3, 1e-3), (0.5, 0.1)]
    yield from ((start, end, slope) for slope in (0.0, 1e-6, 5e-4) for start, end in falling)
    rising = [(-3.0, -1.0), (-1.3, 0.2), (0.0, 1e-3), (-0.2, 0.3), (0.2, 0.34)]
    yield from (
        (start, end, slope) for slope in (0.35, 0.9, 0.999999, 1.0, 1.000001, 1.5, 40.0) for start, end in rising
    )
    yield from (
        (start, end, slope) for slope in (1.1, 3.0, 1e4) for start, end in [(-2.0, 2.0), (0.0, 1.5), (1.5, 9.0)]
    )
    yield from [(-0.9, -0.2, -0.1), (0.9, -0.05, -0.1), (2.0, -2.0, -1.5), (0.5, -9.0, -1e3)]


def settle(start: mpf, end: mpf, slope: mpf, linear: mpf, square: mpf) -> Sequence[mpf]:
    """The time of the way, by quadrature of dy/(slope - f(x)) with y = x + linear*f + square*f^2."""
    edges = [edge for edge in (-mpmath.sqrt(2), mpmath.sqrt(2)) if min(start, end) < edge < max(start, end)]
    points = [start, *(edges if end > start else edges[::-1]), end]

    def pace(x: mpf) -> mpf:
        current, transconductance = pair(x)
        return (1 + (linear + 2 * square * current) * transconductance) / (slope - current)

    return (mpmath.quad(pace, points, maxdegree=12),)


def response_cases() -> Iterable[Sequence[float]]:
    """Frequencies over 18 decades about the bandwidth."""
    return itertools.product([0.0] + [1.5e6 * 10.0**k for k in range(-9, 10)], [1.5e6], [0.05, 0.5, 0.7, 50.0])


def response(frequency: mpf, corner: mpf, quality: mpf) -> Sequence[mpf]:
    """Magnitude and phase of one pole, then of two."""
    x = mpmath.mpc(0, frequency / corner)
    one, two = 1 / (1 + x), 1 / (1 + x / quality + x * x)
    return abs(one), mpmath.arg(one), abs(two), mpmath.arg(two)


def noise_cases() -> Iterable[Sequence[float]]:
    """Conductances, temperatures from -60 to 150 degC, bands from narrow to 24 decades."""
    pairs = [(5.7e-4, 2.8e-4), (1e-12, 0.0), (1e3, 1e3)]
    bands = [(1e-12, 1e12), (0.1, 1e3), (10.0, 10.0000001), (1.0, 1.5)]
    return [(*gm, t, *band) for gm, t, band in itertools.product(pairs, [213.15, 300.0, 423.15], bands)]


def noise(gm1: mpf, gm3: mpf, kelvin: mpf, low: mpf, high: mpf) -> Sequence[mpf]:
    """Thermal density of the pair, rms in a band of a density of 1 V2/Hz, and of a flicker coefficient of 1 V2."""
    density = 2 * (4 * mpf(BOLTZMANN) * kelvin * 2 / (3 * gm1)) * (1 + gm3 / gm1)
    return density, mpmath.sqrt(high - low), mpmath.sqrt(mpmath.log(high / low))


def bias_cases() -> Iterable[Sequence[float]]:
    """Corners below, within and above the band; bands from 0 Hz on and narrow ones."""
    loads = [(10e9, 27e-12), (10e9, 42.5e-12), (1e12, 1e-12), (50.0, 1e-12), (1e18, 1.0)]
    bands = [(0.0, 1e3), (0.1, 1e3), (0.0, 1e12), (1e3, 1e6), (10.0, 10.0000001), (0.58, 0.6)]
    return [(*load, t, *band) for load, t, band in itertools.product(loads, [213.15, 300.0, 423.15], bands)]


def bias(ohms: mpf, farad: mpf, kelvin: mpf, low: mpf, high: mpf) -> Sequence[mpf]:
    """Root of the integral of 4*k*T*R/(1 + (2*pi*f*R*C)^2) over the band, by quadrature decade by decade."""
    corner = 1 / (2 * mpmath.pi * ohms * farad)
    between = [corner * mpf(10) ** k for k in range(-6, 41) if low < corner * mpf(10) ** k < high]
    density = 4 * mpf(BOLTZMANN) * kelvin * ohms
    return (mpmath.sqrt(mpmath.quad(lambda f: density / (1 + (f / corner) ** 2), [low, *between, high], maxdegree=10)),)


def amplifier_cases() -> Iterable[Sequence[float]]:
    """Circuit B, and currents, supplies, modulations and loads about it."""
    usual = (200e-6, 5.0, 46.2e-12, 2631.0, 10e-12, 11e3, 0.1, 0.7)
    yield usual
    others = [
        (1e-9, 1e-6, 1e-4),
        (3.3, 50.0),
        (1e-12, 1e-9),
        (0.0, 1e5),
        (0.0, 1e-9),
        (50.0, 1e12),
        (1e-6, 1.0),
        (0.0, 0.5),
    ]
    for place, values in enumerate(others):
        yield from ((*usual[:place], value, *usual[place + 1 :]) for value in values)


def amplifier(
    current: mpf, supply: mpf, cc: mpf, rz: mpf, load_c: mpf, load_r: mpf, lam: mpf, vth: mpf
) -> Sequence[mpf]:
    """The two-stage op-amp of Table II: Kirchhoff's and the square law solved together, then the two-node circuit."""
    oxide = mpf(3.9) * mpf(VACUUM_PERMITTIVITY) / mpf(45e-9)
    film = mpf(12) * mpf(VACUUM_PERMITTIVITY) / mpf(2.5e-6)
    stack = 1 / (1 / oxide + 1 / film)
    length = mpf(12e-6)
    n80, n60 = (mpf(850e-4) * oxide * mpf(width) / length for width in (80e-6, 60e-6))
    p160, p240 = (mpf(283e-4) * oxide * mpf(width) / length for width in (160e-6, 240e-6))
    pair = mpf(850e-4) * stack * mpf(3276e-6) / length
    common, load, tail, out = _rest(current, supply, lam, vth, (n80, n60, p160, pair))
    gm1, gm3, half = tail / common, tail / load, tail / 2
    second = mpmath.sqrt(2 * out / (p240 * (1 + lam * supply)))
    gm7 = 2 * out / second
    node1 = lam * half / (1 + lam * (supply - load + common)) + lam * half / (1 + lam * (vth + load))
    node2 = 2 * lam * out / (1 + lam * supply) + 1 / load_r
    c1 = mpf(2) / 3 * mpf(240e-6) * length * oxide
    c2 = load_c + mpf(1) / 3 * mpf(3276e-6) * length * stack
    # Determinant of the admittances of the two nodes: 1 + a1*s + a2*s^2, Rz left out; p1 = 1/a1, p2 = a1/a2.
    a1 = (node2 * (c1 + cc) + node1 * (c2 + cc) + gm7 * cc) / (node1 * node2)
    a2 = ((c1 + cc) * (c2 + cc) - cc**2) / (node1 * node2)
    # M7 with the tail current on top: its overdrive, transconductance, and the rate at which Cc is charged then.
    pushed = mpmath.sqrt(2 * (out + tail) / (p240 * (1 + lam * supply)))
    share = 1 / (1 + node2 * pushed / (2 * (out + tail)))
    rise = share * tail / cc
    fall = min(rise, out / (cc * (1 + node2 / gm7) + c2))
    return (
        *(tail, out, common, gm1, gm3, gm1 / node1, gm7 / node2),
        *(1 / (2 * mpmath.pi * a1), a1 / (2 * mpmath.pi * a2), 1 / (2 * mpmath.pi * cc * (rz - 1 / gm7))),
        *(rise, fall, share * (tail / gm7 - (pushed - second)), (load - second) * node1 / gm1),
    )


def one_stage_cases() -> Iterable[Sequence[float]]:
    """Circuit C, and currents, supplies, compensations, loads and modulations about it."""
    usual = (100e-6, 5.0, 33e-12, 0.0, 10e-12, 1e15, 0.0248, 0.7)
    yield usual
    others = {0: (1e-9, 3e-4), 1: (4.0, 50.0), 2: (1e-12, 1e-9), 4: (0.0, 1e-9), 5: (1e3, 1e5), 6: (1e-6, 0.3)}
    for place, values in others.items():
        yield from ((*usual[:place], value, *usual[place + 1 :]) for value in values)


def one_stage(
    current: mpf, supply: mpf, cc: mpf, rz: mpf, load_c: mpf, load_r: mpf, lam: mpf, vth: mpf
) -> Sequence[mpf]:
    """The one-stage op-amp with its n-channel output follower: the square law solved with Kirchhoff's, two nodes."""
    del rz
    oxide = mpf(3.9) * mpf(VACUUM_PERMITTIVITY) / mpf(45e-9)
    film = mpf(12) * mpf(VACUUM_PERMITTIVITY) / mpf(2.5e-6)
    stack = 1 / (1 / oxide + 1 / film)
    length = mpf(12e-6)
    n80, n60, n240 = (mpf(850e-4) * oxide * mpf(width) / length for width in (80e-6, 60e-6, 240e-6))
    p160 = mpf(283e-4) * oxide * mpf(160e-6) / length
    common, _, tail, out = _rest(current, supply, lam, vth, (n80, n60, p160, mpf(850e-4) * stack * 3276 / 12))
    gate = mpmath.sqrt(2 * out / n240 / (1 + lam * supply))
    gm1, gm7 = tail / common, n240 * gate * (1 + lam * supply)
    node1 = lam * tail / 2 * (1 / (1 + lam * (2 * vth + gate + common)) + 1 / (1 + lam * (supply - vth - gate)))
    node2 = gm7 + 2 * lam * out / (1 + lam * supply) + 1 / load_r
    c7 = mpf(2) / 3 * mpf(240e-6) * length * oxide
    c1 = cc + c7 * (node2 - gm7) / node2
    c2 = load_c + mpf(1) / 3 * mpf(3276e-6) * length * stack + c7
    return (
        *(tail, common, gm1, gm1 / node1, gm7 / node2),
        *(node1 / (2 * mpmath.pi * c1), node2 / (2 * mpmath.pi * c2), tail / c1),
    )


def _rest(current: mpf, supply: mpf, lam: mpf, vth: mpf, betas: Sequence[mpf]) -> Sequence[mpf]:
    """Overdrives of pair and load [V], currents of tail and output stage [A] at balance, by Newton's method."""
    n80, n60, p160, pair = betas

    def drain(beta: mpf, overdrive: mpf, voltage: mpf) -> mpf:
        return beta / 2 * overdrive**2 * (1 + lam * voltage)

    def wrong(mirror: mpf, common: mpf, load: mpf) -> Sequence[mpf]:
        tail = drain(n80, mirror, supply - vth - common)
        return (
            drain(n80, mirror, vth + mirror) / current - 1,
            drain(pair, common, supply - load + common) / (tail / 2) - 1,
            drain(p160, load, vth + load) / (tail / 2) - 1,
        )

    guess = [mpmath.sqrt(2 * current / n80), mpmath.sqrt(current / pair), mpmath.sqrt(current / p160)]
    mirror, common, load = mpmath.findroot(wrong, guess, maxsteps=50)
    return common, load, drain(n80, mirror, supply - vth - common), drain(n60, mirror, supply)


TABLES = {
    "mean_decay": Table("(1 - exp(-x))/x", ("x",), ("mean_decay",), decay_cases, decay),
    "two_pole_step": Table(
        "lag of two poles after a step of the given length [1/w0] in which the input rises by 1, from rest",
        ("phase", "quality"),
        ("lag",),
        two_pole_cases,
        two_pole,
    ),
    "pair_current": Table(
        "current and transconductance of the differential pair in units of the tail current and Vov",
        ("overdrive",),
        ("current", "transconductance"),
        pair_cases,
        pair,
    ),
    "pair_settling": Table(
        "time [time constants] that a follower's pair takes from one overdrive to another at a slope of the input",
        ("start", "end", "slope", "linear", "square"),
        ("duration",),
        settle_cases,
        settle,
    ),
    "follower_response": Table(
        "gain and phase of a pole at `corner` [Hz], and of two with that natural frequency",
        ("frequency", "corner", "quality"),
        ("one_gain", "one_phase", "two_gain", "two_phase"),
        response_cases,
        response,
    ),
    "bias_noise": Table(
        "rms [V] of a resistor [ohm] on a capacitance [F] at a temperature [K] between two frequencies [Hz]",
        ("resistance", "capacitance", "temperature", "low", "high"),
        ("bias_rms",),
        bias_cases,
        bias,
    ),
    "amplifier": Table(
        "op-amp of Table II: current [A], supply [V], Cc [F], Rz [ohm], load [F], load [ohm], lambda [1/V], Vth [V]",
        ("current", "supply", "cc", "rz", "load_c", "load_r", "modulation", "threshold"),
        (
            *("tail_current", "output_current", "overdrive", "input_transconductance", "load_transconductance"),
            *("first_gain", "second_gain", "dominant_pole", "second_pole", "zero"),
            *("slew_rate", "falling_slew_rate", "bend", "systematic_offset"),
        ),
        amplifier_cases,
        amplifier,
    ),
    "one_stage": Table(
        "op-amp of one stage and an output follower: as above, the resistor of no effect",
        ("current", "supply", "cc", "rz", "load_c", "load_r", "modulation", "threshold"),
        (
            *("tail_current", "overdrive", "input_transconductance", "first_gain", "second_gain"),
            *("dominant_pole", "second_pole", "slew_rate"),
        ),
        one_stage_cases,
        one_stage,
    ),
    "noise": Table(
        "thermal density [V2/Hz] of a pair; rms [V] between two frequencies of 1 V2/Hz, and of 1 V2/f",
        ("gm1", "gm3", "temperature", "low", "high"),
        ("pair_density", "white_rms", "flicker_rms"),
        noise_cases,
        noise,
    ),
}


if __name__ == "__main__":
    sys.exit(write(TABLES, "generate_follower.py"))
