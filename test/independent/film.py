# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A plant of its own: the film on its transistors with board and ADC, from forces on the taxels to codes.

Nothing here is shared with `posfet_sim`: only the values of the sensor file are read. So what the model of the stack
and the simulated board of the stack have both wrong, shows.

Voltages are those at the output of the followers. A force F on a taxel makes the charge ``-d33*F``, hence the voltage
``-d33/A*F/C`` on the film's capacitance per area C. In the order of the signal:

1. Charge per force: gain of each taxel; stiffening of the piezoelectric coefficient with the preload; hysteresis of
   Prandtl and Ishlinskii (play operators); viscoelastic creep (lags); bending of the chip, which all taxels feel.
2. Pyroelectric charge of the film, whose temperature follows the chip, and is raised under what touches.
3. Electric circuit of the gate: the capacitance at high frequency, a resistor to the bias (leakage), and one branch of
   a resistor in series with a capacitor for each half decade of dielectric relaxation: an RC network with real modes,
   which are computed exactly for charges that are linear between two scans. Dielectric relaxation so lowers the voltage
   of a held force, while creep raises it.
4. Offset, 1/f noise, white noise, hum, bursts, telegraph noise; rails; ADC with a stuck bit; lost scans.

Magnitudes without another source are assumed. Those of `MODERATE` and `HARD` are the values for which the model is
designed, as far as the sensor file has none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Sensor

Array: TypeAlias = NDArray[np.float64]

VACUUM_PERMITTIVITY: Final = 8.8541878128e-12
"""[F/m]."""
REST: Final = 4.0
"""Time without force that is computed before the first scan [s]: 15 leakage time constants."""
ROOM_TEMPERATURE: Final = 25.0
"""Chip temperature at the beginning [degC], assumed."""

GAIN_SPREAD: Final = 0.05
"""Standard deviation of the taxels' gains [1]: thickness and poling of the film, assumed."""
PYROELECTRIC_SPREAD: Final = 0.05
"""Standard deviation of pyroelectric over piezoelectric gain [1], assumed."""
LEAK_SPREAD: Final = 0.02
"""Standard deviation of the taxels' leakage time constants [1], assumed."""
COMMON_LEAK: Final = 0.07
"""Standard deviation of the leakage time constants of a board [1]: tolerance of the resistors, assumed."""
OFFSET_SPREAD: Final = 5e-3
"""Standard deviation of the offsets of the followers [V]: unmatched transistors of that size, assumed."""
FLICKER_TIMES: Final = (0.03, 0.3, 3.0, 30.0)
"""Correlation times of the random processes that make up the 1/f noise [s]: 5 mHz to 5 Hz."""

RELAXATION_TIMES: Final = tuple(3e-3 * 10.0 ** (0.5 * np.arange(9)))
"""Time constants of dielectric relaxation, one for each half decade from 3 ms to 30 s [s]."""
CREEP_TIMES: Final = (1.0, 3.0, 10.0)
"""Time constants of the creep of film and cover, with equal shares [s]: elastomers, assumed."""
CREEP_SPREAD: Final = 0.2
"""Standard deviation of the taxels' creep, relative [1], assumed."""
TOUCHED: Final = 2e-3
"""Total force above which an object touches; the next one does so when it has left [N]."""
PLAY_SIZES: Final = tuple(np.geomspace(0.002, 0.2, 8))
"""Half widths of the play operators, relative to the maximum force [1], with equal weights: loops of all sizes."""
PLAY_TEST: Final = np.geomspace(0.05, 5.0, 60)
"""Loops from 0 to these forces [N]; `Effects.hysteresis` is the opening of the widest, relative to its force."""
WARMTH_TIME: Final = 0.5
"""Time constant of the warmth of touched taxels [s]."""
CHIP_TIME: Final = 5.0
"""Time constant with which an object warms the chip [s]: heat capacity of a package, assumed."""
SENSOR_RATE: Final = 10.0
"""Temperature readings per second [Hz]: status frames."""
SENSOR_STEP: Final = 1.0 / 256.0
"""Resolution of a temperature reading [K]: status frames."""
SENSOR_NOISE: Final = 2e-3
"""Standard deviation of a temperature reading [K], assumed."""
HUM_HARMONICS: Final = ((1, 1.0), (3, 0.2), (5, 0.1))
"""Harmonics of the mains hum, and their amplitudes relative to the first [1]."""
MAINS: Final = 50.0
"""[Hz]."""
_CHUNK: Final = 2048
"""Scans of which the distances of play operators are summed at once."""
_BLOCK: Final = 64
"""Scans of a block of which linear states are computed at once."""


@dataclass(frozen=True)
class Effects:
    """What film and board do beyond gain, leakage, offset, noise and ADC. 0: nothing."""

    flicker: float = 10e-6
    """1/f noise of each taxel, RMS per decade of frequency [V]: ten times that of the input transistors of a follower,
    1000 um2 with 1 fF/um2 and a flicker coefficient of 1e-25 V2 F, for bias resistor and ADC; assumed."""
    relaxation: float = 0.0
    """Dielectric relaxation, share of the capacitance per decade of time [1]."""
    creep: float = 0.0
    """Viscoelastic creep: charge that comes in with lags of 1, 3 and 10 s, over that at once [1]."""
    hysteresis: float = 0.0
    """Opening of the widest loop of charge against force, relative [1]."""
    nonlinearity: float = 0.0
    """Change of the piezoelectric coefficient per preload [1/N]."""
    leak_halving: float = math.inf
    """Rise of temperature that halves the leakage time constant [K]."""
    warmth: float = 0.0
    """Temperature rise of the film under what touches [K]."""
    warmth_force: float = 0.03
    """Force on a taxel at which 63 % of its warmth are reached [N]: thermal contact saturates, assumed."""
    warmth_step: float = 0.0
    """Force on a taxel from which on it has all of its warmth [N]; 0: it saturates, with `warmth_force`."""
    warmth_spread: float = 0.0
    """Standard deviation of the warmth of each object that touches, relative to it [1]; the stand has one object."""
    warmth_on_stand: bool = True
    """Whether the ball of the calibration stand warms the film as the objects do."""
    drift: float = 0.0
    """Drift of the chip temperature [K/s]; not on the stand, which is at rest."""
    drift_under_way: bool = False
    """Whether the drift has begun before the first scan, as on a robot in use; else it begins with that scan."""
    sensor_lag: float = 0.0
    """Lag of the temperature sensors behind the chip [s]."""
    sensor_dead_time: float = 0.0
    """Dead time of the temperature sensors before that lag [s]."""
    sensor_offset: float = 0.0
    """Error of the temperature sensors, one up, the other one half as much down [K]."""
    chip_warming: float = 0.0
    """Rise of the chip temperature per force, with a lag of 5 s [K/N]."""
    bending: float = 0.0
    """Charge on every taxel by the bending of the chip, as a force per total force [1]."""
    bending_dome: float = 0.0
    """By how much the chip bends more in the middle than on average, and less at the corners, relative [1]."""
    hum: float = 0.0
    """Amplitude of the mains hum [V]."""
    hum_wander: float = 0.0
    """Largest error of its frequency, with a period of 7 s [Hz]."""
    bursts: float = 0.0
    """Height of bursts of interference on single scans [V]."""
    burst_rate: float = 0.1
    """Bursts per second [Hz]."""
    stuck_bit: int | None = None
    """Bit of the codes of one taxel that is always set."""
    telegraph: float = 0.0
    """Height of the telegraph noise of one taxel [V]."""
    gain_drift: float = 0.0
    """Change of the gains since the calibration, relative; in common, and half as much for each taxel [1]."""
    jitter: float = 0.0
    """Standard deviation of the time of a scan [s]."""
    skew: float = 0.0
    """Time between the first and the last taxel of a scan [s]."""
    lost: float = 0.0
    """Share of scans that get lost [1]."""


MODERATE: Final = Effects(
    relaxation=0.02,
    creep=0.04,
    hysteresis=0.015,
    nonlinearity=0.01,
    leak_halving=15.0,
    warmth=0.03,
    drift=0.5 / 60.0,
    sensor_lag=0.1,
    sensor_offset=0.3,
    chip_warming=0.05,
    bending=2e-3,
    hum=0.5e-3,
    hum_wander=0.1,
    bursts=20e-3,
    stuck_bit=1,
    telegraph=1e-3,
    gain_drift=0.01,
    jitter=5e-6,
    skew=0.5e-3,
    lost=1e-3,
)
"""Everything at once, as on an ordinary film and board; the drift of the chip temperature is assumed."""

HARD: Final = replace(
    MODERATE,
    relaxation=0.03,
    creep=0.06,
    hysteresis=0.03,
    nonlinearity=0.02,
    leak_halving=10.0,
    warmth=0.1,
    drift=2.0 / 60.0,
    sensor_lag=1.0,
    chip_warming=0.2,
    bending=8e-3,
    hum=5e-3,
    hum_wander=0.2,
    bursts=50e-3,
    stuck_bit=7,
    telegraph=3e-3,
)
"""Everything at once, on a poor film and board."""


@dataclass(frozen=True, eq=False)
class Load:
    """What acts on the array, at the times of the scans from the first one on."""

    force: Array
    """Force on each taxel [N], shape [scans, taxels]; 0 in the first scan."""
    applied: Array
    """Force of all objects together, also beside the array [N], shape [scans]."""
    chip: Array
    """Chip temperature relative to its start, besides drift and what objects warm [K], shape [scans]."""
    on_stand: bool = False
    """Whether this is the calibration stand."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What a board sends, one row for each scan that is not lost."""

    index: NDArray[np.intp]
    """Number of each scan, shape [scans]."""
    counts: NDArray[np.uint16]
    """ADC codes on the 16-bit scale, shape [scans, taxels]."""
    temperatures: NDArray[np.float32]
    """Newest readings of both sensors [degC], shape [scans, 2]."""
    late: Array
    """How long after the time of the scan each taxel is sampled, in periods of the scans [1], shape [taxels]."""


@dataclass(frozen=True, eq=False)
class Board:
    """One array with its readout board: properties that stay from calibration to use."""

    creep_times: ClassVar[tuple[float, ...]] = CREEP_TIMES
    """Time constants of creep [s]."""
    telegraph_dwells: ClassVar[tuple[float, float]] = (0.05, 1.0)
    """Shortest and longest time for which a level of telegraph noise lasts [s]."""

    sensor: Sensor
    """Sensor file."""
    effects: Effects
    """What the film and the board do."""
    seed: int
    """Number of the board: the same number has the same properties."""
    gain: Array = field(init=False)
    """Gains relative to nominal [1], shape [taxels]."""
    time_constant: Array = field(init=False)
    """Leakage time constants with the capacitance at high frequency [s], shape [taxels]."""

    def __post_init__(self) -> None:
        taxels, rng = self.sensor.layout.taxels, np.random.default_rng([self.seed, 1])
        normal = rng.standard_normal((8, taxels))
        one = np.clip(rng.standard_normal(8), -2.0, 2.0)
        common_leak = 1.0 + COMMON_LEAK * one[0]
        place = self.sensor.layout.positions / np.abs(self.sensor.layout.positions).max(axis=0)
        gradient = 1.0 + 0.3 * (place @ one[1:3])
        set_ = object.__setattr__
        set_(self, "gain", 1.0 + GAIN_SPREAD * normal[0])
        tau = self.sensor.device.leak_time_constant * common_leak
        set_(self, "time_constant", tau * (1.0 + LEAK_SPREAD * normal[1]))
        set_(self, "_pyroelectric", self.gain * (1.0 + PYROELECTRIC_SPREAD * normal[2]))
        set_(self, "_offset", OFFSET_SPREAD * normal[3])
        set_(self, "_creep", np.maximum(1.0 + CREEP_SPREAD * rng.standard_normal((3, taxels)), 0.0) / 3.0)
        set_(self, "_bending", gradient + self.effects.bending_dome * (1.0 - np.square(place).sum(axis=1)))
        set_(self, "_hum", 1.0 + 0.1 * normal[4])
        set_(self, "_later", 1.0 + self.effects.gain_drift * (one[3] + 0.5 * normal[5]))
        set_(self, "_stuck", int(rng.integers(taxels)))
        set_(self, "_telegraph", int(rng.integers(taxels)))

    _pyroelectric: Array = field(init=False, repr=False)
    _offset: Array = field(init=False, repr=False)
    _creep: Array = field(init=False, repr=False)
    _bending: Array = field(init=False, repr=False)
    _hum: Array = field(init=False, repr=False)
    _later: Array = field(init=False, repr=False)
    _stuck: int = field(init=False, repr=False)
    _telegraph: int = field(init=False, repr=False)

    @property
    def stuck_taxel(self) -> int:
        """Index of the taxel with the stuck bit, if there is one."""
        return self._stuck

    @property
    def telegraph_taxel(self) -> int:
        """Index of the taxel with telegraph noise, if there is any."""
        return self._telegraph

    @property
    def _late(self) -> Array:
        """Time of each taxel in a scan [s], shape [taxels]."""
        late: Array = self.effects.skew * np.linspace(0.0, 1.0, self.sensor.layout.taxels)
        return late

    @property
    def volts_per_newton(self) -> float:
        """Nominal voltage of a force before it leaks [V/N]."""
        device, amplifier = self.sensor.device, self.sensor.amplifier
        capacitance = VACUUM_PERMITTIVITY * device.relative_permittivity / device.film_thickness
        follower = amplifier.open_loop_gain / (1.0 + amplifier.open_loop_gain)
        return -device.piezoelectric_coefficient / self.sensor.layout.taxel_area / capacitance * follower

    def record(self, load: Load, seed: int) -> Recording:
        """Return the scans of the board under a load.

        Parameters
        ----------
        load : Load
            What acts on the array.
        seed : int
            Number of the recording, for all that is random in time.

        Returns
        -------
        Recording
            The scans that arrive.
        """
        step = 1.0 / self.sensor.can.scan_rate
        rng = np.random.default_rng([self.seed, 2, seed])
        before = round(REST / step)

        def led(values: Array) -> Array:
            return np.concatenate([np.zeros((before, *values.shape[1:])), values])

        force, applied = led(load.force), led(load.applied)
        chip = self._chip_temperature(applied, led(load.chip), load.on_stand, step)
        charge = self._charge(force, applied, step)
        charge *= self.gain if load.on_stand else self.gain * self._later
        charge += self._pyroelectric_charge(force, chip, load.on_stand, step)
        volts = self.volts_per_newton * self._circuit(charge, chip, step)
        volts = self._sampled(volts, step, rng)[before:]
        volts += self._electronics(len(volts), step, rng)
        counts, readings = self._converted(volts), self._readings(chip, step, rng)[before:]
        kept = np.flatnonzero(rng.random(len(volts)) >= self.effects.lost)
        return Recording(kept, counts[kept], readings[kept], self._late / step)

    def _chip_temperature(self, applied: Array, chip: Array, on_stand: bool, step: float) -> Array:
        """Return the temperature of the chip relative to room temperature [K], shape [scans]."""
        if self.effects.drift and not on_stand:
            begin = 0 if self.effects.drift_under_way else round(REST / step)
            chip = chip + self.effects.drift * step * np.maximum(np.arange(len(chip)) - begin, 0)
        if self.effects.chip_warming:
            chip = chip + self.effects.chip_warming * low_pass(applied[:, None], np.array([CHIP_TIME]), step)[:, 0]
        return chip

    def _charge(self, force: Array, applied: Array, step: float) -> Array:
        """Return the charge of forces, as a force before gain and leakage [N], shape [scans, taxels]."""
        effects, charge = self.effects, np.array(force)
        if effects.nonlinearity:  # d(charge)/d(force) = 1 + k*force
            charge += 0.5 * effects.nonlinearity * force**2
        if effects.hysteresis:
            sizes = np.array(PLAY_SIZES) * self.sensor.device.force_max
            charge += play(force, sizes, np.full(len(sizes), effects.hysteresis / opening(sizes)))
        if effects.creep:
            for share, time in zip(self._creep, self.creep_times, strict=True):
                charge += effects.creep * share * low_pass(force, np.full(force.shape[1], time), step)
        if effects.bending:
            charge += effects.bending * applied[:, None] * self._bending
        return charge

    def _pyroelectric_charge(self, force: Array, chip: Array, on_stand: bool, step: float) -> Array:
        """Return the charge of the film's temperature, as a force [N], shape [scans, taxels]."""
        device = self.sensor.device
        per_kelvin = device.pyroelectric_coefficient * self.sensor.layout.taxel_area / -device.piezoelectric_coefficient
        film = low_pass(chip[:, None], np.array([device.thermal_time_constant]), step)
        if self.effects.warmth and (self.effects.warmth_on_stand or not on_stand):
            contact = self._thermal_contact(force)
            if self.effects.warmth_spread and not on_stand:
                contact *= self._object_warmth(force)[:, None]
            film = film + low_pass(self.effects.warmth * contact, np.full(force.shape[1], WARMTH_TIME), step)
        return per_kelvin * self._pyroelectric * film

    def _thermal_contact(self, force: Array) -> Array:
        """Return the share of its warmth that each taxel has [1], shape [scans, taxels]."""
        step_at, saturating = self.effects.warmth_step, -np.expm1(-force / self.effects.warmth_force)
        return np.where(force >= step_at, 1.0, 0.0) if step_at else saturating

    def _object_warmth(self, force: Array) -> Array:
        """Return the warmth of the object that touches, relative to that of the others [1], shape [scans]."""
        touched = force.sum(axis=1) > TOUCHED
        number = np.cumsum(np.diff(touched.astype(int), prepend=0) == 1)
        each = np.random.default_rng([self.seed, 3]).standard_normal(number[-1] + 1)
        warmth: Array = 1.0 + self.effects.warmth_spread * np.clip(each, -2.0, 2.0)[number]
        return warmth

    def _circuit(self, charge: Array, chip: Array, step: float) -> Array:
        """Return what is left of the charge at the gate, as a voltage per nominal one [N], shape [scans, taxels]."""
        result = gate_voltage(charge, self.time_constant, self.effects.relaxation, step)
        if math.isinf(self.effects.leak_halving) or not np.ptp(chip):
            return result
        # Leakage that changes with temperature draws further charge: a small effect, so that few rounds are enough.
        excess = np.expm1(math.log(2.0) * chip / self.effects.leak_halving)[:, None] / self.time_constant
        for _ in range(4):
            drawn = excess * result
            drawn[1:] = np.cumsum(0.5 * (drawn[1:] + drawn[:-1]) * step, axis=0)
            drawn[0] = 0.0
            result = gate_voltage(charge - drawn, self.time_constant, self.effects.relaxation, step)
        return result

    def _sampled(self, volts: Array, step: float, rng: np.random.Generator) -> Array:
        """Return the voltages when they are sampled: the taxels of a scan one after another, with jitter."""
        if not self.effects.skew and not self.effects.jitter:
            return volts
        late = self._late + self.effects.jitter * rng.standard_normal((len(volts), 1))
        slope = np.zeros_like(volts)
        slope[:-1] = np.diff(volts, axis=0) / step
        moved: Array = volts + slope * late
        return moved

    def _electronics(self, scans: int, step: float, rng: np.random.Generator) -> Array:
        """Return all that the board adds to the voltages [V], shape [scans, taxels]."""
        effects, taxels = self.effects, self.sensor.layout.taxels
        time = step * np.arange(scans)
        added = self._offset + self.sensor.adc.noise * rng.standard_normal((scans, taxels))
        for time_constant in FLICKER_TIMES:
            added += effects.flicker * _ornstein_uhlenbeck(rng, (scans, taxels), time_constant, step)
        if effects.hum:
            wander = 7.0 / (2.0 * math.pi) * effects.hum_wander * (1.0 - np.cos(2.0 * math.pi * time / 7.0))
            phase = 2.0 * math.pi * (MAINS * time + wander) + rng.uniform(0.0, 2.0 * math.pi)
            wave = sum(size * np.sin(order * phase) for order, size in HUM_HARMONICS)
            added += effects.hum * np.asarray(wave)[:, None] * self._hum
        if effects.bursts:
            struck = np.flatnonzero(rng.random(scans) < effects.burst_rate * step)
            signs = rng.choice([-1.0, 1.0], len(struck))[:, None]
            added[struck] += effects.bursts * signs * (1.0 + 0.3 * rng.standard_normal((len(struck), taxels)))
        if effects.telegraph:
            shortest, longest = self.telegraph_dwells
            dwells = np.exp(rng.uniform(math.log(shortest), math.log(longest), int(scans * step / shortest) + 2))
            level = np.searchsorted(np.cumsum(dwells), time) % 2
            added[:, self._telegraph] += effects.telegraph * level
        return added

    def _converted(self, volts: Array) -> NDArray[np.uint16]:
        """Return the codes of voltages on the 16-bit scale."""
        adc, amplifier = self.sensor.adc, self.sensor.amplifier
        clipped = np.clip(volts, amplifier.rail_low, amplifier.rail_high)
        top = (1 << adc.bits) - 1
        codes = np.clip(np.rint((clipped - adc.low) / (adc.high - adc.low) * top), 0, top).astype(np.int64)
        scaled: NDArray[np.uint16] = np.rint(codes * (0xFFFF / top)).astype(np.uint16)
        if self.effects.stuck_bit is not None:
            scaled[:, self._stuck] |= np.uint16(1 << self.effects.stuck_bit)
        return scaled

    def _readings(self, chip: Array, step: float, rng: np.random.Generator) -> NDArray[np.float32]:
        """Return the newest readings of both temperature sensors [degC], shape [scans, 2]."""
        dead = min(round(self.effects.sensor_dead_time / step), len(chip))
        seen = np.concatenate([np.full(dead, chip[0]), chip[: len(chip) - dead]])
        if self.effects.sensor_lag:
            seen = low_pass(seen[:, None], np.array([self.effects.sensor_lag]), step)[:, 0]
        period = round(1.0 / (SENSOR_RATE * step))
        taken = ROOM_TEMPERATURE + seen[::period, None] + self.effects.sensor_offset * np.array([1.0, -0.5])
        taken = taken + SENSOR_NOISE * rng.standard_normal(taken.shape)
        rounded = np.rint(taken / SENSOR_STEP) * SENSOR_STEP
        return np.repeat(rounded, period, axis=0)[: len(chip)].astype(np.float32)


def gate_voltage(charge: Array, time_constant: Array, relaxation: float, step: float) -> Array:
    """Return the voltage of a gate that leaks, and whose capacitance relaxes.

    The charge Q is on a capacitance of 1 and on branches of a capacitance c_k in series with a resistor, which follow
    the voltage V with time constants t_k; what has leaked is L::

        V = Q - sum(c_k*V_k) - L,   dV_k/dt = (V - V_k)/t_k,   dL/dt = V/tau

    The modes of this network are real. Exact for charges that are linear between two scans.

    Parameters
    ----------
    charge : ndarray of float64, shape [scans, taxels]
        Charge Q, in any unit; in balance with 0 before the first scan.
    time_constant : ndarray of float64, shape [taxels]
        Leakage time constants tau [s].
    relaxation : float
        Share of the capacitance per decade of time [1].
    step : float
        Time between scans [s].

    Returns
    -------
    ndarray of float64, shape [scans, taxels]
        Voltage V, in the unit of the charge.
    """
    taxels = charge.shape[1]
    times = np.array(RELAXATION_TIMES if relaxation else ())
    branches = len(times)
    taps = np.append(np.full(branches, 0.5 * relaxation), 1.0)
    rates, into, out = (np.zeros((taxels, branches + 1)) for _ in range(3))
    for taxel, tau in enumerate(time_constant):
        drive = np.append(1.0 / times, 1.0 / tau)
        system = -np.outer(drive, taps) - np.diag(np.append(1.0 / times, 0.0))
        values, vectors = np.linalg.eig(system)
        rates[taxel], into[taxel], out[taxel] = values.real, np.linalg.solve(vectors, drive).real, taps @ vectors.real
    left, right, decay = _hold(rates, step)
    return charge - _modes(charge, into * left, into * right, decay, out)


def low_pass(signal: Array, time_constant: Array, step: float) -> Array:
    """Return first-order lags of signals that are linear between scans.

    Parameters
    ----------
    signal : ndarray of float64, shape [scans, signals]
        Signals; in balance with 0 before the first scan.
    time_constant : ndarray of float64, shape [signals]
        Time constants [s].
    step : float
        Time between scans [s].

    Returns
    -------
    ndarray of float64, shape [scans, signals]
        The lags, in the unit of the signals.
    """
    rates = -1.0 / time_constant[:, None]
    left, right, decay = _hold(rates, step)
    return _modes(signal, -rates * left, -rates * right, decay, np.ones_like(rates))


def play(force: Array, half_widths: Array, weights: Array) -> Array:
    """Return the weighted sum of play operators, less that of the force itself.

    A play operator P of the half width r is dragged along by the force F, never further than r from it.

    Parameters
    ----------
    force : ndarray of float64, shape [scans, taxels]
        Forces F [N]; 0 before the first scan.
    half_widths : ndarray of float64, shape [operators]
        Half widths r [N].
    weights : ndarray of float64, shape [operators]
        Weights w [1].

    Returns
    -------
    ndarray of float64, shape [scans, taxels]
        ``sum(w*(P - F))`` [N].
    """
    state = np.zeros((force.shape[1], len(half_widths)))
    result: Array = -float(weights.sum()) * force
    moves = np.concatenate([[True], (np.diff(force, axis=0) != 0.0).any(axis=1)])
    for begin in range(0, len(force), _CHUNK):
        part = force[begin : begin + _CHUNK, :, None]
        upper, lower = part + half_widths, part - half_widths
        for index, moving in enumerate(moves[begin : begin + _CHUNK].tolist()):
            if moving:
                np.minimum(state, upper[index], out=state)
                np.maximum(state, lower[index], out=state)
                pulled = state @ weights
            result[begin + index] += pulled
    return result


def opening(half_widths: Array) -> float:
    """Return the opening of the widest loop from 0 to a force and back, relative to it [1].

    Parameters
    ----------
    half_widths : ndarray of float64, shape [operators]
        Half widths of play operators with weights of 1 [N].
    """
    widest = 0.0
    for top in PLAY_TEST:
        # On the way down an operator has passed from F - r to F + r, if the loop is wide enough.
        rise = np.linspace(0.0, top, 101)
        up = np.maximum(rise[:, None] - half_widths, 0.0)
        down = np.minimum(rise[:, None] + half_widths, np.maximum(top - half_widths, 0.0))
        widest = max(widest, float((down - up).sum(axis=1).max()) / top)
    return widest


def _hold(rates: Array, step: float) -> tuple[Array, Array, Array]:
    """Return the shares of the signals at both ends of a step in a mode at its end [s], and the mode's decay [1]."""
    product = np.minimum(rates * step, -1e-12)
    decay = np.exp(product)
    mean = np.expm1(product) / product
    right = (mean - 1.0) / product
    return step * (mean - right), step * right, decay


def _modes(signal: Array, left: Array, right: Array, decay: Array, out: Array) -> Array:
    """Return weighted sums of first-order modes, shape [scans, signals]; coefficients have shape [signals, modes].

    A block of scans is the response to its own signal and to what the signal before it left in the modes at its start.
    """
    scans, signals = signal.shape
    into = decay * right + left
    powers = decay[:, :, None] ** np.arange(_BLOCK + 1)
    later = np.einsum("sm,smk->sk", out * into, powers[:, :, : _BLOCK - 1])
    own = _triangle(np.concatenate([(out * right).sum(axis=1)[:, None], later], axis=1))
    blocks = _blocks(signal).transpose(2, 1, 0)  # [signals, scans of a block, blocks]
    starts = (
        into[:, :, None] * powers[:, :, _BLOCK - 1 :: -1]
    ) @ blocks  # what each block adds, [signals, modes, blocks]
    state = np.zeros_like(decay)
    for block in range(starts.shape[2]):
        following = powers[:, :, _BLOCK] * state + starts[:, :, block]
        starts[:, :, block], state = state, following
    result = own @ blocks + (out[:, :, None] * powers[:, :, :_BLOCK]).transpose(0, 2, 1) @ starts
    return np.ascontiguousarray(result.transpose(2, 1, 0).reshape(-1, signals)[:scans])


def _triangle(response: Array) -> Array:
    """Return matrices that convolve a block with a response, shape [..., scans, scans]."""
    behind = np.arange(response.shape[-1])
    delay = np.subtract.outer(behind, behind)
    return np.where(delay >= 0, response[..., np.abs(delay)], 0.0)


def _blocks(signal: Array) -> Array:
    """Return a signal in blocks of scans, the last one filled up with 0, shape [blocks, scans of a block, signals]."""
    missing = -len(signal) % _BLOCK
    return np.pad(signal, ((0, missing), (0, 0))).reshape(-1, _BLOCK, signal.shape[1])


def _ornstein_uhlenbeck(rng: np.random.Generator, shape: tuple[int, int], time: float, step: float) -> Array:
    """Return stationary random processes of variance 1 and the correlation time [s], shape [scans, processes]."""
    decay = math.exp(-step / time)
    values = rng.standard_normal(shape)
    values[1:] *= math.sqrt(1.0 - decay * decay)
    powers = decay ** np.arange(_BLOCK + 1)
    blocks = _triangle(powers[:_BLOCK]) @ _blocks(values)
    last = np.zeros(shape[1])
    for block in blocks:
        np.add(block, powers[1:, None] * last, out=block)
        last = block[-1]
    return blocks.reshape(-1, shape[1])[: shape[0]]
