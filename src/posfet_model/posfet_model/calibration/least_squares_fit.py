"""Least-squares calibration of every taxel from a recording with known forces.

The signal x of a taxel, expressed as a nominal force, follows its source and leaks: ``dx/dt = g*dF/dt + p*dT/dt -
(x - o)/tau``. Integrated from the start of a recording, the equation is linear in the parameters:

    x(t) = g*F(t) + p*T(t) - (1/tau)*I(t) + (o/tau)*t + c,    I(t) = integral of x

One linear least-squares fit per taxel therefore gives its gain g, pyroelectric gain p, time constant tau and offset o.
T is the temperature of the film, which lags behind that of the chip; the lag with the smallest residuals is used. A
first fit has the force on the four neighbours as a further regressor, from which the crosstalk follows. The signals are
compensated for it before the final fit.

The film's hysteresis leaves residual charge when a force has gone, which a fit without it would attribute to leakage,
drift or temperature. So the distance F - P of the force from a play operator P of half width r (the elementary
hysteresis loop: P is dragged along, never further than r from F) is a regressor, too. The signal contains
``g1*F + w*(F - P)``, and the gain is that of the regression line through the loop,
``g = g1 + w*sum((F - P)*F)/sum(F^2)``, for presses of typical strength (`TYPICAL_FORCE`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import EDGE_NEIGHBOURS, neighbour_lists
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton

MIN_FORCE: Final = 0.2
"""Every taxel has to be pressed with at least this force [N]."""

MIN_TEMPERATURE_RANGE: Final = 0.5
"""The temperature has to vary by at least this much for the pyroelectric gain to be fitted [K]."""

DEAD_GAIN: Final = 0.1
"""A taxel with a smaller gain is dead [1]."""

PLAY_HALF_WIDTH: Final = 0.1
"""Half width r of the play operator that models the film's hysteresis, relative to the maximum force [1], assumed."""

TYPICAL_FORCE: Final = 0.1
"""The gain is that of presses of this strength, relative to the maximum force [1], assumed: hysteresis attenuates small
changes of force more than large ones, and a fingertip presses no taxel harder."""

FOLDS: Final = 5
"""One segment in this many belongs to the hold-out set."""

SEGMENT: Final = 0.25
"""Length of a segment [s]."""

LAGS: Final = tuple(np.geomspace(0.5, 2.0, 13).tolist())
"""Thermal lags that are tried, relative to that in the sensor file [1]."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Scans with the forces applied; the first scan is taken at rest."""

    time: Array
    """[s], shape [scans], ascending."""
    counts: NDArray[np.uint16]
    """ADC counts, shape [scans, rows * cols]."""
    temperature: Array
    """Mean of the chip's temperature sensors [degC], shape [scans]."""
    force: Array
    """Force on each taxel [N], shape [scans, rows * cols]."""


def fit(sensor: Sensor, recording: Recording, date: str) -> Calibration:
    """Return the calibration of a sensor from a recording with known forces.

    Parameters
    ----------
    sensor : Sensor
        The sensor file, whose values are the nominal ones.
    recording : Recording
        Scans and forces; at least four leakage time constants long, with at least 0.2 N on every taxel.
    date : str
        When the recording was made, ISO 8601.

    Returns
    -------
    Calibration
        Gain, pyroelectric gain, time constant and offset of every taxel, crosstalk, thermal lag, and the residuals on
        the hold-out set.

    Raises
    ------
    ValueError
        The recording is too short, has the wrong shape, leaves a taxel without force, or no taxel responds; one line.
    """
    _check(sensor, recording)
    signal = _signal(sensor, recording)
    temperature = recording.temperature - recording.temperature[0]
    temperature_varies = bool(np.ptp(temperature) >= MIN_TEMPERATURE_RANGE)
    lag = sensor.device.thermal_time_constant
    if temperature_varies and lag > 0:
        lag *= _best_lag(sensor, recording, signal, temperature)
    film = _film_temperature(recording.time, temperature, lag) if temperature_varies else None
    neighbours = neighbour_lists(sensor.layout, EDGE_NEIGHBOURS)
    crosstalk = _crosstalk(neighbours, _fit(sensor, recording, signal, film, neighbours=neighbours))
    compensator = CrosstalkCompensator(sensor.layout, crosstalk)
    signal = np.stack([compensator.apply(row) for row in signal])
    found = _fit(sensor, recording, signal, film)
    tau = 1.0 / np.maximum(found.leakage_rate, 1e-9)
    gain = _regression_gain(sensor, recording, found)
    dead = gain < DEAD_GAIN
    if dead.all():
        raise ValueError("no taxel responds to the force: nothing to calibrate")
    nominal_tau = sensor.device.leak_time_constant
    nominal = sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)
    pyroelectric = found.pyroelectric / nominal if temperature_varies and nominal else np.ones(len(dead))
    return Calibration(
        gain=np.where(dead, np.nan, gain),
        pyroelectric_gain=np.where(dead, 1.0, pyroelectric),
        leak_time_constant=np.where(dead, nominal_tau, np.clip(tau, 0.1 * nominal_tau, 10.0 * nominal_tau)),
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
    leakage_rate: Array
    """1/tau [1/s]."""
    drift: Array
    """o/tau [N/s]."""
    start: Array
    """c [N]."""
    pyroelectric: Array
    """p [N/K]."""
    neighbour_gain: Array
    """Signal per force on the four neighbours [1]."""
    hysteresis: Array
    """w: signal per distance of the force from its play operator [1]."""
    squares: float
    """Sum of the squared residuals [N2]."""


def _check(sensor: Sensor, recording: Recording) -> None:
    taxels, scans = sensor.layout.taxels, len(recording.time)
    if recording.counts.shape != (scans, taxels) or recording.force.shape != (scans, taxels):
        raise ValueError(f"counts and force must have shape ({scans}, {taxels}), got {recording.counts.shape}")
    if scans < 2 or recording.time[-1] - recording.time[0] < 4 * sensor.device.leak_time_constant:
        raise ValueError("the recording must last at least four leakage time constants")
    if not np.isfinite(recording.force).all() or not np.isfinite(recording.temperature).all():
        raise ValueError("force and temperature must be finite")
    weak = np.flatnonzero(recording.force.max(axis=0) < MIN_FORCE)
    if len(weak):
        raise ValueError(f"every taxel must be pressed with {MIN_FORCE:g} N, but taxel {weak[0]} was not")


def _signal(sensor: Sensor, recording: Recording) -> Array:
    """Return the charge of every scan as a nominal force [N]."""
    inverse = InverseSignalChain(sensor)
    charge = np.empty(recording.counts.shape)
    return inverse.charge(recording.counts, charge) / charge_per_newton(sensor)


def _film_temperature(time: Array, temperature: Array, lag: float) -> Array:
    """Return the temperature [K] of the film, a first-order lag behind a piecewise linear chip temperature."""
    film = np.zeros(len(time))
    behind = 0.0
    for index, (step, change) in enumerate(zip(np.diff(time), np.diff(temperature), strict=True), 1):
        ratio = step / lag
        behind = behind * np.exp(-ratio) + change * -np.expm1(-ratio) / ratio
        film[index] = temperature[index] - behind
    return film


def _best_lag(sensor: Sensor, recording: Recording, signal: Array, temperature: Array) -> float:
    """Return the thermal lag with the smallest residuals, relative to that in the sensor file."""
    thinned = slice(None, None, max(1, len(recording.time) // 4000))
    few = Recording(recording.time[thinned], recording.counts[thinned], temperature[thinned], recording.force[thinned])
    integral = _integral(recording.time, signal)[thinned]

    def misfit(lag: float) -> float:
        film = _film_temperature(few.time, few.temperature, lag * sensor.device.thermal_time_constant)
        return _fit(sensor, few, signal[thinned], film, integral=integral).squares

    misfits = [misfit(lag) for lag in LAGS]
    best = int(np.argmin(misfits))
    if best in (0, len(LAGS) - 1):
        return float(LAGS[best])
    # Vertex of the parabola through the best lag and its neighbours, which are equally spaced on a logarithmic axis.
    before, lowest, after = misfits[best - 1 : best + 2]
    curvature = before - 2.0 * lowest + after
    shift = 0.5 * (before - after) / curvature if curvature > 0.0 else 0.0
    return float(LAGS[best] * (LAGS[1] / LAGS[0]) ** shift)


def _integral(time: Array, signal: Array) -> Array:
    """Return the integral of the signal since the first scan by the trapezoidal rule [N s]."""
    pieces = 0.5 * (signal[1:] + signal[:-1]) * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, signal.shape[1])), np.cumsum(pieces, axis=0)])


def _training_set(time: Array) -> Mask:
    """Return which scans are fitted; the others are the hold-out set."""
    mask: Mask = ((time - time[0]) / SEGMENT).astype(np.intp) % FOLDS != FOLDS - 1
    return mask


def _regressors(
    recording: Recording,
    integral: Array,
    hysteresis: Array,
    film: Array | None,
    taxel: int,
    neighbours: Sequence[int] | None = None,
) -> Array:
    """Return the regressors of one taxel's fit, shape [scans, regressors]."""
    elapsed = recording.time - recording.time[0]
    force = recording.force[:, taxel]
    columns = [force, -integral[:, taxel], elapsed, np.ones(len(elapsed)), hysteresis[:, taxel]]
    if film is not None:
        columns.append(film)
    if neighbours is not None:
        columns.append(recording.force[:, neighbours].sum(axis=1))
    return np.stack(columns, axis=1)


def _fit(
    sensor: Sensor,
    recording: Recording,
    signal: Array,
    film: Array | None,
    neighbours: Sequence[Sequence[int]] | None = None,
    integral: Array | None = None,
) -> _Fit:
    """Fit every taxel to the training set; with `neighbours`, their force is a regressor."""
    integral = _integral(recording.time, signal) if integral is None else integral
    used = _training_set(recording.time)
    hysteresis = _hysteresis(sensor, recording.force)
    rows = np.zeros((signal.shape[1], 7))
    squares = 0.0
    for taxel in range(signal.shape[1]):
        near = None if neighbours is None else neighbours[taxel]
        columns = _regressors(recording, integral, hysteresis, film, taxel, near)[used]
        scale = np.maximum(np.abs(columns).max(axis=0), 1e-12)
        found = np.linalg.lstsq(columns / scale, signal[used, taxel], rcond=None)[0] / scale
        error = columns @ found - signal[used, taxel]
        squares += float(error @ error)
        rows[taxel, :5] = found[:5]
        if film is not None:
            rows[taxel, 5] = found[5]
        if near is not None:
            rows[taxel, 6] = found[-1]
    gain, leakage_rate, drift, start, width, pyroelectric, neighbour_gain = np.ascontiguousarray(rows.T)
    return _Fit(gain, leakage_rate, drift, start, pyroelectric, neighbour_gain, width, squares)


def _hysteresis(sensor: Sensor, force: Array) -> Array:
    """Return the distance F - P of each force [N] from its play operator, shape [scans, taxels]."""
    reach = PLAY_HALF_WIDTH * sensor.device.force_max
    play = np.zeros(force.shape[1])
    distance = np.empty(force.shape)
    for index, now in enumerate(force):
        np.clip(play, now - reach, now + reach, out=play)
        np.subtract(now, play, out=distance[index])
    return distance


def _regression_gain(sensor: Sensor, recording: Recording, found: _Fit) -> Array:
    """Return each taxel's gain [1]: slope of the line through the hysteresis loops that typical forces make."""
    force = recording.force * (TYPICAL_FORCE * sensor.device.force_max / recording.force.max(axis=0))
    share = (_hysteresis(sensor, force) * force).sum(axis=0) / (force * force).sum(axis=0)
    gain: Array = found.gain + found.hysteresis * share
    return gain


def _crosstalk(neighbours: Sequence[Sequence[int]], found: _Fit) -> float:
    """Return the share of each neighbour's signal that a taxel picks up: the median over the taxels, not below 0."""
    gains = np.where(found.gain < DEAD_GAIN, np.nan, found.gain)
    shares = [
        found.neighbour_gain[taxel] / np.nanmean(gains[near])
        for taxel, near in enumerate(neighbours)
        if near and np.isfinite(gains[near]).any()
    ]
    return float(np.clip(np.median(shares), 0.0, 0.2)) if shares else 0.0


def _residuals(
    sensor: Sensor,
    recording: Recording,
    signal: Array,
    film: Array | None,
    found: _Fit,
    dead: Mask,
) -> Residuals:
    """Return the prediction error on the hold-out set as forces, with the fit and with nominal parameters."""
    integral = _integral(recording.time, signal)
    hysteresis = _hysteresis(sensor, recording.force)
    held_out = ~_training_set(recording.time)
    pyroelectric = sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)
    after, before = [], []
    for taxel in np.flatnonzero(~dead):
        columns = _regressors(recording, integral, hysteresis, film, int(taxel))[held_out]
        fitted = [
            found.gain[taxel],
            found.leakage_rate[taxel],
            found.drift[taxel],
            found.start[taxel],
            found.hysteresis[taxel],
        ]
        nominal = [1.0, 1.0 / sensor.device.leak_time_constant, 0.0, 0.0, 0.0]
        if film is not None:
            fitted.append(found.pyroelectric[taxel])
            nominal.append(pyroelectric)
        after.append((columns @ fitted - signal[held_out, taxel]) / found.gain[taxel])
        before.append(columns @ nominal - signal[held_out, taxel])
    return Residuals(
        force_rms=float(np.sqrt(np.mean(np.square(after)))),
        force_rms_before=float(np.sqrt(np.mean(np.square(before)))),
        samples=sum(len(row) for row in after),
    )
