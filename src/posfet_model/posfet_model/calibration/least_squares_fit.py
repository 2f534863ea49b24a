"""Calibration of each taxel from a recording with known forces.

A taxel's signal x, as a force of the description, follows the source of charge and leaks: ``dx/dt = g*dF/dt + p*dT/dt -
(x - o)/tau``. Integrated from the start of a recording that is linear in what is looked for,

    x(t) = g*F(t) + p*T(t) - (1/tau)*I(t) + (o/tau)*t + c,    I(t) = integral of x

so that one linear least-squares fit a taxel gives gain g, pyroelectric gain p, time constant tau and offset o. T is the
film's temperature, which lags behind the chip's: the lag that leaves the smallest residuals is taken. What a taxel
shows of its four neighbours is fitted beside them, and undone before the fit that counts.

The film's hysteresis leaves some charge behind when a force has gone, which would pass for leak, drift or warmth. So
the distance F - P of the force from a play P of half width r (the simplest loop there is: P is dragged along at the
distance r at most) is a column, too: x has ``g1*F + w*(F - P)``, and the gain is that of the line through it,
``g = g1 + w*sum((F - P)*F)/sum(F^2)``, for presses as strong as a fingertip's (`USUAL`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array
from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton

LEAST_FORCE: Final = 0.2
"""Every taxel has to be pressed with this force at least [N]."""

LEAST_WARMING: Final = 0.5
"""The temperature has to change by this much for the pyroelectric gain to be fitted [K]."""

DEAD_GAIN: Final = 0.1
"""A taxel with less gain does not answer [1]."""

PLAY: Final = 0.1
"""Half width r of the play that stands for the film's loops, in the greatest force [1], assumed."""

USUAL: Final = 0.1
"""The gain is that of presses as strong as this, in the greatest force [1], assumed: small changes of force count less
in the film's loops than great ones, and a fingertip gives no taxel more."""

HELD_OUT: Final = 5
"""One stretch in this many is held out of the fit."""

STRETCH: Final = 0.25
"""Length of a stretch [s]."""

LAGS: Final = tuple(np.geomspace(0.5, 2.0, 13).tolist())
"""Lags of the film that are tried, in that of the description [1]."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Scans with the forces that pressed; the first is taken at rest."""

    time: NDArray[np.float64]
    """[s], shape [scans], ascending."""
    counts: NDArray[np.uint16]
    """Shape [scans, rows * cols]."""
    temperature: NDArray[np.float64]
    """Mean of the chip's sensors [degC], shape [scans]."""
    force: NDArray[np.float64]
    """On each taxel [N], shape [scans, rows * cols]."""


def fit(sensor: Sensor, recording: Recording, date: str) -> Calibration:
    """Return the calibration of `sensor` by a recording made at `date` (ISO 8601).

    Raises ValueError, one line, when the recording does not show a taxel enough to know it.
    """
    _check(sensor, recording)
    signal = _signal(sensor, recording)
    temperature = recording.temperature - recording.temperature[0]
    warmed = bool(np.ptp(temperature) >= LEAST_WARMING)
    lag = sensor.device.thermal_time_constant
    if warmed and lag > 0:
        lag *= _best_lag(sensor, recording, signal, temperature)
    film = _film(recording.time, temperature, lag) if warmed else None
    first = _fit(sensor, recording, signal, film, neighbours=True)
    crosstalk = _crosstalk(sensor, first)
    undone = CrosstalkCompensator(sensor.layout, crosstalk)
    signal = np.stack([undone.apply(row) for row in signal])
    found = _fit(sensor, recording, signal, film, neighbours=False)
    tau = 1.0 / np.maximum(found.leak, 1e-9)
    gain = _line_gain(sensor, recording, found)
    dead = gain < DEAD_GAIN
    if dead.all():
        raise ValueError("no taxel answers to the force: nothing to calibrate")
    nominal = sensor.device.leak_time_constant
    usual = sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)
    return Calibration(
        gain=np.where(dead, np.nan, gain),
        pyroelectric_gain=np.where(dead, 1.0, found.warmth / usual) if warmed and usual else np.ones(len(dead)),
        leak_time_constant=np.where(dead, nominal, np.clip(tau, 0.1 * nominal, 10.0 * nominal)),
        offset=np.where(dead, 0.0, found.drift * tau) * sensor.volts_per_newton,
        crosstalk=crosstalk,
        thermal_time_constant=lag,
        date=date,
        residuals=_residuals(sensor, recording, signal, film, found, dead),
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """Coefficients of each taxel, shape [taxels]."""

    gain: Array
    leak: Array
    """1/tau [1/s]."""
    drift: Array
    """o/tau [N/s]."""
    start: Array
    warmth: Array
    """[N/K]"""
    beside: Array
    """Signal per force on the four neighbours [1]."""
    loop: Array
    """w: signal per distance of the force from its play [1]."""
    squares: float
    """Sum of the squared residuals."""


def _check(sensor: Sensor, recording: Recording) -> None:
    taxels, scans = sensor.layout.taxels, len(recording.time)
    if recording.counts.shape != (scans, taxels) or recording.force.shape != (scans, taxels):
        raise ValueError(f"counts and force must have shape ({scans}, {taxels}), got {recording.counts.shape}")
    if scans < 2 or recording.time[-1] - recording.time[0] < 4 * sensor.device.leak_time_constant:
        raise ValueError("the recording must last at least four time constants of the leak")
    if not np.isfinite(recording.force).all() or not np.isfinite(recording.temperature).all():
        raise ValueError("force and temperature must be finite")
    weak = np.flatnonzero(recording.force.max(axis=0) < LEAST_FORCE)
    if len(weak):
        raise ValueError(f"every taxel must be pressed with {LEAST_FORCE:g} N, but taxel {weak[0]} was not")


def _signal(sensor: Sensor, recording: Recording) -> Array:
    """Return the charge of every scan as a force [N]."""
    inverse = InverseSignalChain(sensor)
    charge = np.empty(recording.counts.shape)
    return inverse.charge(recording.counts, charge) / charge_per_newton(sensor)


def _film(time: Array, temperature: Array, lag: float) -> Array:
    """Return the temperature of the film that follows the chip's in straight lines [K]."""
    film = np.zeros(len(time))
    behind = 0.0
    for index, (step, change) in enumerate(zip(np.diff(time), np.diff(temperature), strict=True), 1):
        ratio = step / lag
        behind = behind * np.exp(-ratio) + change * -np.expm1(-ratio) / ratio
        film[index] = temperature[index] - behind
    return film


def _best_lag(sensor: Sensor, recording: Recording, signal: Array, temperature: Array) -> float:
    """Return the lag, in that of the description, with which the signals are explained best."""
    thinned = slice(None, None, max(1, len(recording.time) // 4000))
    few = Recording(recording.time[thinned], recording.counts[thinned], temperature[thinned], recording.force[thinned])
    integral = _integral(recording.time, signal)[thinned]

    def misfit(lag: float) -> float:
        film = _film(few.time, few.temperature, lag * sensor.device.thermal_time_constant)
        return _fit(sensor, few, signal[thinned], film, neighbours=False, integral=integral).squares

    misfits = [misfit(lag) for lag in LAGS]
    best = int(np.argmin(misfits))
    if best in (0, len(LAGS) - 1):
        return float(LAGS[best])
    # The lowest point of the parabola through the best and its neighbours, which are evenly apart as logarithms.
    before, lowest, after = misfits[best - 1 : best + 2]
    bend = before - 2.0 * lowest + after
    shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(LAGS[best] * (LAGS[1] / LAGS[0]) ** shift)


def _integral(time: Array, signal: Array) -> Array:
    """Return the integral of the signal from the first scan on, by trapezoids [N s]."""
    pieces = 0.5 * (signal[1:] + signal[:-1]) * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, signal.shape[1])), np.cumsum(pieces, axis=0)])


def _seen(time: Array) -> NDArray[np.bool_]:
    """Return which scans are fitted; the others are held out."""
    mask: NDArray[np.bool_] = ((time - time[0]) / STRETCH).astype(np.intp) % HELD_OUT != HELD_OUT - 1
    return mask


def _columns(
    sensor: Sensor,
    recording: Recording,
    integral: Array,
    loop: Array,
    film: Array | None,
    taxel: int,
    neighbours: bool,
) -> Array:
    """Return the columns of one taxel's fit, shape [scans, columns]."""
    elapsed = recording.time - recording.time[0]
    force = recording.force[:, taxel]
    columns = [force, -integral[:, taxel], elapsed, np.ones(len(elapsed)), loop[:, taxel]]
    if film is not None:
        columns.append(film)
    if neighbours:
        columns.append(recording.force[:, _beside(sensor, taxel)].sum(axis=1))
    return np.stack(columns, axis=1)


def _fit(
    sensor: Sensor,
    recording: Recording,
    signal: Array,
    film: Array | None,
    neighbours: bool,
    integral: Array | None = None,
) -> _Fit:
    """Fit every taxel to the scans that are not held out."""
    integral = _integral(recording.time, signal) if integral is None else integral
    seen = _seen(recording.time)
    loop = _loop(sensor, recording.force)
    rows = np.zeros((signal.shape[1], 7))
    squares = 0.0
    for taxel in range(signal.shape[1]):
        columns = _columns(sensor, recording, integral, loop, film, taxel, neighbours)[seen]
        scale = np.maximum(np.abs(columns).max(axis=0), 1e-12)
        found = np.linalg.lstsq(columns / scale, signal[seen, taxel], rcond=None)[0] / scale
        error = columns @ found - signal[seen, taxel]
        squares += float(error @ error)
        rows[taxel, :5] = found[:5]
        if film is not None:
            rows[taxel, 5] = found[5]
        if neighbours:
            rows[taxel, 6] = found[-1]
    gain, leak, drift, start, width, warmth, beside = np.ascontiguousarray(rows.T)
    return _Fit(gain, leak, drift, start, warmth, beside, width, squares)


def _loop(sensor: Sensor, force: Array) -> Array:
    """Return by how much each force [N] is ahead of its play, shape [scans, taxels]."""
    reach = PLAY * sensor.device.force_max
    play = np.zeros(force.shape[1])
    ahead = np.empty(force.shape)
    for index, now in enumerate(force):
        np.clip(play, now - reach, now + reach, out=play)
        np.subtract(now, play, out=ahead[index])
    return ahead


def _line_gain(sensor: Sensor, recording: Recording, found: _Fit) -> Array:
    """Return the gain of the straight line through the film's loops that usual forces make, of each taxel [1]."""
    force = recording.force * (USUAL * sensor.device.force_max / recording.force.max(axis=0))
    share = (_loop(sensor, force) * force).sum(axis=0) / (force * force).sum(axis=0)
    gain: Array = found.gain + found.loop * share
    return gain


def _beside(sensor: Sensor, taxel: int) -> list[int]:
    """Return the numbers of the four neighbours, as far as they are on the array."""
    rows, cols = sensor.layout.rows, sensor.layout.cols
    row, col = divmod(taxel, cols)
    near = ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1))
    return [r * cols + c for r, c in near if 0 <= r < rows and 0 <= c < cols]


def _crosstalk(sensor: Sensor, found: _Fit) -> float:
    """Return the share of its neighbours' signal that a taxel shows: the median over the taxels, not below 0."""
    gains = np.where(found.gain < DEAD_GAIN, np.nan, found.gain)
    shares = [
        found.beside[taxel] / np.nanmean(gains[near])
        for taxel in range(len(gains))
        if (near := _beside(sensor, taxel)) and np.isfinite(gains[near]).any()
    ]
    return float(np.clip(np.median(shares), 0.0, 0.2)) if shares else 0.0


def _residuals(
    sensor: Sensor,
    recording: Recording,
    signal: Array,
    film: Array | None,
    found: _Fit,
    dead: NDArray[np.bool_],
) -> Residuals:
    """Return how well the held-out scans are foretold, as forces."""
    integral = _integral(recording.time, signal)
    loop = _loop(sensor, recording.force)
    held = ~_seen(recording.time)
    warmth = sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)
    after, before = [], []
    for taxel in np.flatnonzero(~dead):
        columns = _columns(sensor, recording, integral, loop, film, int(taxel), neighbours=False)[held]
        mine = [found.gain[taxel], found.leak[taxel], found.drift[taxel], found.start[taxel], found.loop[taxel]]
        told = [1.0, 1.0 / sensor.device.leak_time_constant, 0.0, 0.0, 0.0]
        if film is not None:
            mine.append(found.warmth[taxel])
            told.append(warmth)
        after.append((columns @ mine - signal[held, taxel]) / found.gain[taxel])
        before.append(columns @ told - signal[held, taxel])
    return Residuals(
        force_rms=float(np.sqrt(np.mean(np.square(after)))),
        force_rms_before=float(np.sqrt(np.mean(np.square(before)))),
        samples=sum(len(row) for row in after),
    )
