"""From charge at the gates to codes: crosstalk, follower, noise, mains hum and converter of the simulated board.

Everything between gate and converter is reckoned in steps of the converter, so that a scan costs few passes over the
array. Noise and hum come in blocks of scans, with the codes of an array at rest; only taxels with charge are converted
again.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.amplifier.closed_loop import close_loop
from posfet_model.device import adc
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import EDGE_NEIGHBOURS, neighbour_table
from posfet_model.sensor.signal_chain import SCALE_BITS
from posfet_sim.device.flicker_noise import FlickerNoise
from posfet_sim.device.imperfections import Imperfections
from posfet_sim.device.random_streams import Stream, generator
from posfet_sim.device.sample_clock import SimClock
from posfet_sim.device.taxel_variation import TaxelSpread, TaxelStatus

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
        self._clock = clock
        self._seed = seed
        self._bits = converter.bits if imperfections.quantisation else SCALE_BITS
        self._lsb = adc.lsb(self._bits, converter.low, converter.high)
        self._low = converter.low
        self._top = float((1 << self._bits) - 1)
        low, high = amplifier.rail_low - converter.low, amplifier.rail_high - converter.low
        self._rails = (low / self._lsb, high / self._lsb) if imperfections.amplifier_rails else (-math.inf, math.inf)
        loop = close_loop(amplifier.open_loop_gain, amplifier.gain_bandwidth)
        self._lag_time = 1 / (2 * math.pi * loop.bandwidth) if imperfections.amplifier_pole else 0.0
        self._slew = imperfections.slew_rate / self._lsb
        self._slews = 0 < self._slew * clock.interval < (high - low) / self._lsb
        self._steps_per_charge = spread.volts_per_charge / self._lsb
        self._at_rest = (spread.offset - converter.low) / self._lsb
        self._before = np.clip(self._at_rest, *self._rails)  # output of the last scan; kept up to date if it slews
        self._stuck = np.flatnonzero(spread.status == TaxelStatus.STUCK)
        gain = amplifier.follower_gain if imperfections.amplifier_gain else 1.0
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
        self._resting = np.zeros((self.block, taxels), np.uint16)
        self._shape = sensor.layout.rows, sensor.layout.cols
        self._neighbours = neighbour_table(sensor.layout, EDGE_NEIGHBOURS)
        self.awake = np.arange(0)
        """Numbers of the taxels that have charge."""
        self._awake: slice | NDArray[np.intp]
        self.wake(self.awake)

    def wake(self, awake: NDArray[np.intp]) -> None:
        """Take note which taxels have charge, by their numbers."""
        rows, cols = self._shape
        self.awake = awake
        self._awake = slice(None) if awake.size == rows * cols else awake  # a slice is faster
        self._per_charge = self._steps_per_charge[awake]
        self._rest_awake = self._at_rest[awake]
        place = np.full(rows * cols + 1, awake.size)  # where there is no taxel awake: what comes behind the last
        place[awake] = np.arange(awake.size)
        self._beside = [place[neighbours] for neighbours in self._neighbours[awake].T]
        still_awake = np.zeros(rows * cols, np.bool_)
        still_awake[awake] = True
        self._before[~still_awake] = np.clip(self._at_rest[~still_awake], *self._rails)

    def outputs(self, charge: Float64Array, steps: Float64Array) -> Float64Array:
        """Return what charge [C/m2] adds to the followers' outputs, in steps of the converter, without noise and rails.

        `charge` has the shape [scans + 1, awake], the first row that of the scan before; the result has [scans, awake].
        `steps` [s] are the times from scan to scan.
        """
        shift, steps = charge * self._per_charge, steps.astype(charge.dtype, copy=False)
        if self._lag_time:
            # One pole and a straight piece of input: the lag is slope*tau*(1 - exp(-h/tau)), and what was before is
            # forgotten, as the interval between scans is hundreds of time constants.
            lag = np.diff(shift, axis=0) * np.minimum(self._lag_time / steps, 1.0)[:, None]
            shift = shift[1:] - lag
        else:
            shift = shift[1:]
        if self._imperfections.crosstalk:
            ended = np.concatenate([shift, np.zeros((len(shift), 1), shift.dtype)], axis=1)
            above, below, left, right = (ended.take(places, axis=1) for places in self._beside)
            shift = shift + self._imperfections.crosstalk * (left + right + above + below)
        return self._slew_limited(shift, steps) if self._slews else shift

    def volts(self, awake: NDArray[np.intp], output: Float64Array) -> Float64Array:
        """Return the output of all followers without noise [V], shape [rows * cols], of one row of `outputs`."""
        signal = self._at_rest.copy()
        signal[awake] += output
        volts: Float64Array = np.clip(signal, *self._rails) * self._lsb + self._low
        return volts

    def counts(self, first: int, outputs: Float64Array) -> NDArray[np.uint16]:
        """Return the codes of the scans from `first` on, all of one block, shape [scans, rows * cols]."""
        number, row = divmod(first, self.block)
        if number != self._number:
            self._begin(number)
        scans = slice(row, row + len(outputs))
        if not outputs.shape[1]:
            return self._resting[scans]
        steps = outputs + self._rest_awake
        if self._slow is not None:
            steps += self._slow[scans, self._awake]
        white = None if self._white is None else self._white[scans, self._awake]
        if isinstance(self._awake, slice):
            return self._stuck_in(self._convert(steps, white))
        counts = self._resting[scans].copy()
        counts[:, self._awake] = self._convert(steps, white)
        return self._stuck_in(counts)

    def _slew_limited(self, shift: Float64Array, steps: Float64Array) -> Float64Array:
        """Return outputs that move no faster than the amplifier can."""
        limited = shift + self._rest_awake
        before = self._before[self._awake]
        for row, step in zip(limited, steps.tolist(), strict=True):
            np.clip(row, before - self._slew * step, before + self._slew * step, out=row)
            before = np.clip(row, *self._rails)
        self._before[self._awake] = before
        limited -= self._rest_awake
        return limited

    def _convert(self, steps: Float64Array, white: Float64Array | None) -> NDArray[np.uint16]:
        """Return the codes of outputs before the rails, in steps of the converter; `steps` is overwritten."""
        np.maximum(steps, self._rails[0], out=steps)
        np.minimum(steps, self._rails[1], out=steps)
        if white is not None:
            steps += white
        np.rint(steps, out=steps)
        if self._clips:
            np.maximum(steps, 0, out=steps)
            np.minimum(steps, self._top, out=steps)
        codes = steps.astype(np.uint16)
        if self._bits < SCALE_BITS:
            codes[...] = codes << (SCALE_BITS - self._bits) | codes >> (2 * self._bits - SCALE_BITS)
        return codes

    def _stuck_in(self, codes: NDArray[np.uint16]) -> NDArray[np.uint16]:
        if self._stuck.size:
            codes[:, self._stuck] = self._spread.stuck_counts[self._stuck]
        return codes

    def _begin(self, number: int) -> None:
        """Draw the noise of a block, and convert an array at rest."""
        self._number = number
        first, taxels = number * self.block, self._at_rest.size
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
        at_rest = np.tile(self._at_rest, (self.block, 1))
        if rows:
            self._slow = np.concatenate(weights, axis=1) @ np.concatenate(rows)
            at_rest += self._slow
        self._resting = self._stuck_in(self._convert(at_rest, self._white))
