"""Write the 40-digit reference tables of follower and noise: ``python test/data/device/generate_follower.py``.

As in generate.py: textbook form, mpmath at 80 digits, no code of posfet_model.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterable, Sequence

import mpmath
from generate import Table, write
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
    """Way from one overdrive to another at a slope, in the direction in which the pair goes."""
    falling = [(3.0, 1.0), (1.3, 0.9), (1.3, 1e-3), (0.5, 0.1)]
    yield from ((start, end, slope) for slope in (0.0, 1e-6, 5e-4) for start, end in falling)
    rising = [(-3.0, -1.0), (-1.3, 0.2), (0.0, 1e-3), (-0.2, 0.3), (0.2, 0.34)]
    yield from (
        (start, end, slope) for slope in (0.35, 0.9, 0.999999, 1.0, 1.000001, 1.5, 40.0) for start, end in rising
    )
    yield from (
        (start, end, slope) for slope in (1.1, 3.0, 1e4) for start, end in [(-2.0, 2.0), (0.0, 1.5), (1.5, 9.0)]
    )


def settle(start: mpf, end: mpf, slope: mpf) -> Sequence[mpf]:
    """The time of the way, by quadrature of dx/(slope - f(x))."""
    edges = [edge for edge in (-mpmath.sqrt(2), mpmath.sqrt(2)) if min(start, end) < edge < max(start, end)]
    points = [start, *(edges if end > start else edges[::-1]), end]
    return (mpmath.quad(lambda x: 1 / (slope - pair_current(x)), points, maxdegree=12),)


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
        ("start", "end", "slope"),
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
