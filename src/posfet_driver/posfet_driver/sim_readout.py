"""From charge at the gates to codes: crosstalk, follower, noise, mains hum and converter of the simulated board.

Everything between gate and converter is reckoned in steps of the converter above its low end, so that a scan costs few
passes over the array. Noise and hum come in blocks of scans; while nothing changes, a whole block is converted at once.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.imperfections import Imperfections
from posfet_driver.sim_clock import SimClock
from posfet_driver.sim_noise import FlickerNoise
from posfet_driver.sim_random import Stream, generator
from posfet_driver.sim_spread import TaxelSpread, TaxelStatus
from posfet_model import adc
from posfet_model.chain import SCALE_BITS
from posfet_model.follower import close_loop
from posfet_model.sensor import Sensor

SMALL_ARRAY: Final = 512
"""Up to so many taxels a block is 64 scans, else 16."""

Float64Array = NDArray[np.float64]


class Readout:
    """Turns charge into counts.

    Thermal noise of the amplifier is added behind its rails, in one draw with the converter's, so a taxel at a rail
    keeps it. 1/f noise and hum come before the rails.
    """

    def __init__(
        self, sensor: Sensor, imperfections: Imperfections, spread: TaxelSpread, clock: SimClock, seed: int
    ) -> None:
        """Take what the board is made of."""
        amplifier, converter = sensor.amplifier, sensor.adc
        taxels = sensor.layout.taxels
        self._imperfections = imperfections
        self._spread = spread
        self._neighbour_weights = np.full(4, imperfections.crosstalk)
        self._clock = clock
        self._seed = seed
        self._bits = converter.bits
        self._lsb = adc.lsb(converter.bits, converter.low, converter.high)
        self._low = converter.low
        self._top = float((1 << converter.bits) - 1)
        low, high = amplifier.rail_low - converter.low, amplifier.rail_high - converter.low
        self._rails = low / self._lsb, high / self._lsb
        loop = close_loop(amplifier.open_loop_gain, amplifier.gain_bandwidth)
        self._lag_time = 1 / (2 * math.pi * loop.bandwidth) if imperfections.amplifier_pole else 0.0
        self._slew = imperfections.slew_rate / self._lsb
        self._slews = 0 < self._slew * clock.interval < self._rails[1] - self._rails[0]
        self._steps_per_charge = spread.volts_per_charge / self._lsb
        self._at_rest = (spread.offset - converter.low) / self._lsb
        self._signal = self._at_rest.copy()  # output without noise, before the rails
        self._row = np.empty(taxels)
        self._stuck = np.flatnonzero(spread.status == TaxelStatus.STUCK)
        gain = amplifier.follower_gain
        flicker = (imperfections.flicker_noise * gain) ** 2
        folded = flicker * FlickerNoise.folded_variance(1 / clock.interval, loop.bandwidth)
        thermal = (imperfections.thermal_noise * gain) ** 2 * (math.pi / 2 * loop.bandwidth)
        own = converter.noise**2 if imperfections.adc_noise else 0.0
        self._white_steps = math.sqrt(own + thermal + (folded if flicker else 0.0)) / self._lsb * spread.noise_factor
        # No normal number is 40 standard deviations off: between such rails nothing is left for the converter to clip.
        clear = 40 * self._white_steps.max()
        self._clips = self._rails[0] < clear or self._rails[1] > self._top - clear
        self._flicker_steps = math.sqrt(flicker) / self._lsb
        self._hum_steps = spread.hum / self._lsb
        self.block = 64 if taxels <= SMALL_ARRAY else 16
        """Scans of a block."""
        self._flicker = FlickerNoise(seed, taxels, self.block) if flicker else None
        self._number = -1  # of the block whose noise is held
        self._white: Float64Array | None = None
        self._slow: Float64Array | None = None
        self._converted: NDArray[np.uint16] | None = None  # the block's counts while the signal rests
        self._make_neighbours(sensor.layout.rows, sensor.layout.cols, np.arange(0))
        self._last_shift: Float64Array = np.zeros(0)

    def wake(self, rows: int, cols: int, awake: NDArray[np.intp]) -> None:
        """Take note that other taxels are awake: their numbers, and the array's shape."""
        self._signal[self._awake] = self._at_rest[self._awake]
        before = np.zeros(rows * cols)
        before[self._awake] = self._last_shift
        self._make_neighbours(rows, cols, awake)
        self._last_shift = before[awake]
        self._converted = None

    def take(self, charge: Float64Array, step: float) -> None:
        """Take the charge [C/m2] of the taxels awake, `step` [s] after the last."""
        shift = charge * self._per_charge
        if self._lag_time:
            # One pole and a straight piece of input: the lag is slope*tau*(1 - exp(-h/tau)), and what was before is
            # forgotten, as the interval between scans is hundreds of time constants.
            lag = min(self._lag_time / step, 1.0) * (shift - self._last_shift)
            self._last_shift, shift = shift, shift - lag
        if self._imperfections.crosstalk:
            self._padded[self._inside] = shift
            shift = shift + self._neighbour_weights @ self._padded[self._beside]
        shift += self._rest_awake
        if self._slews:
            most = self._slew * step
            before = np.clip(self._signal[self._awake], *self._rails)
            shift = np.clip(shift, before - most, before + most)
        self._signal[self._awake] = shift
        self._converted = None

    def volts(self) -> Float64Array:
        """Return the output of the followers without noise [V], shape [rows * cols]."""
        volts: Float64Array = np.clip(self._signal, *self._rails) * self._lsb + self._low
        return volts

    def counts(self, index: int, out: NDArray[np.uint16], *, resting: bool) -> None:
        """Write scan number `index`; with `resting` the charge will be the same for some more scans."""
        number, row = divmod(index, self.block)
        if number != self._number:
            self._begin(number)
        if resting and self._converted is None:
            rows = [self._signal] * self.block if self._slow is None else self._slow + self._signal
            self._converted = np.empty((self.block, self._signal.size), np.uint16)
            self._convert(np.array(rows), self._white, self._converted)
        if self._converted is not None:
            out[:] = self._converted[row]
            return
        if self._slow is None:
            np.copyto(self._row, self._signal)
        else:
            np.add(self._signal, self._slow[row], out=self._row)
        self._convert(self._row, None if self._white is None else self._white[row], out)

    def _convert(self, volts: Float64Array, white: Float64Array | None, out: NDArray[np.uint16]) -> None:
        """Write the counts of outputs before the rails, in steps of the converter; `volts` is overwritten."""
        np.maximum(volts, self._rails[0], out=volts)
        np.minimum(volts, self._rails[1], out=volts)
        if white is not None:
            volts += white
        np.rint(volts, out=volts)
        if self._clips:
            np.maximum(volts, 0, out=volts)
            np.minimum(volts, self._top, out=volts)
        np.copyto(out, volts, casting="unsafe")
        if self._bits < SCALE_BITS:
            out[...] = out << (SCALE_BITS - self._bits) | out >> (2 * self._bits - SCALE_BITS)
        if self._stuck.size:
            out[..., self._stuck] = self._spread.stuck_counts[self._stuck]

    def _begin(self, number: int) -> None:
        """Draw the noise of a block."""
        self._number = number
        self._converted = None
        first, taxels = number * self.block, self._signal.size
        if self._white_steps.any():
            self._white = generator(self._seed, Stream.WHITE, number).standard_normal((self.block, taxels))
            self._white *= self._white_steps
        weights, rows = [], []
        if self._flicker:
            weights.append(self._flicker.weights * self._flicker_steps)
            rows.append(self._flicker.rows(number))
        if self._imperfections.hum_amplitude:
            turns = self._imperfections.hum_frequency * self._clock.times(first, self.block)
            weights.append(np.sin(2 * math.pi * turns)[:, None])
            rows.append(self._hum_steps[None])
        if rows:
            self._slow = np.concatenate(weights, axis=1) @ np.concatenate(rows)

    def _make_neighbours(self, rows: int, cols: int, awake: NDArray[np.intp]) -> None:
        """Find, for the taxels awake, their places on a padded array, and those of their four neighbours."""
        wide = cols + 2
        self._awake: slice | NDArray[np.intp] = slice(None) if awake.size == rows * cols else awake  # a slice is faster
        self._per_charge = self._steps_per_charge[awake]
        self._rest_awake = self._at_rest[awake]
        self._padded = np.zeros((rows + 2) * wide)
        self._inside = (awake // cols + 1) * wide + awake % cols + 1
        self._beside = np.stack([self._inside + offset for offset in (-1, 1, -wide, wide)])
