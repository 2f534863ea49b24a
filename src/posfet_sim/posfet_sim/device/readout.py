# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""From gate charge to ADC codes: crosstalk, follower, noise, mains hum and ADC of the simulated board.

Every quantity between gate and ADC is in least significant bits (LSB) of the ADC, so that a scan takes few passes over
the array. Noise and hum are computed in blocks of scans, together with the codes of an unloaded array; only taxels with
charge are converted again.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array
from posfet_model.amplifier.closed_loop import close_loop
from posfet_model.device import adc
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import EDGE_NEIGHBOURS, neighbour_table
from posfet_model.sensor.signal_chain import SCALE_BITS
from posfet_sim.device.board_effects import affected_taxels
from posfet_sim.device.code_errors import CodeErrors, to_scale
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.flicker_noise import FlickerNoise
from posfet_sim.device.interference import Interference
from posfet_sim.device.mains_hum import MainsHum
from posfet_sim.device.sample_clock import SampleClock
from posfet_sim.device.taxel_variation import TaxelParameters, TaxelStatus
from posfet_sim.device.white_noise import DrawnNoise, TabulatedNoise, WhiteNoise

BLOCK: Final = 64
"""Scans whose noise, and whose codes without charge, are computed at once."""
SMALL_ARRAY: Final = 512
"""Number of taxels up to which every number of the white noise is drawn; above, it is read from a table."""


class Readout:
    """Converts charge to counts.

    Thermal noise of the amplifier is added after its rails, in one draw with the noise of the ADC, so a taxel at a rail
    keeps it. 1/f noise and hum are added before the rails.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    error_model : ErrorModel
        Noise, hum, crosstalk, and the properties of amplifier and ADC that are on.
    parameters : TaxelParameters
        Properties of each taxel.
    clock : SampleClock
        Sampling times.
    seed : int
        Seed of the noise.
    """

    def __init__(
        self, sensor: Sensor, error_model: ErrorModel, parameters: TaxelParameters, clock: SampleClock, seed: int
    ) -> None:
        amplifier, converter = sensor.amplifier, sensor.adc
        taxels = sensor.layout.taxels
        self._error_model = error_model
        self._parameters = parameters
        self._clock = clock
        self._seed = seed
        self._bits = converter.bits if error_model.quantisation else SCALE_BITS
        self._lsb = adc.lsb(self._bits, converter.low, converter.high)
        self._low = converter.low
        self._top = float((1 << self._bits) - 1)
        low, high = amplifier.rail_low - converter.low, amplifier.rail_high - converter.low
        self._rails = (low / self._lsb, high / self._lsb) if error_model.amplifier_rails else (-math.inf, math.inf)
        loop = close_loop(amplifier.open_loop_gain, amplifier.gain_bandwidth)
        self._lag_time = 1 / (2 * math.pi * loop.bandwidth) if error_model.amplifier_pole else 0.0
        self._slew = error_model.slew_rate / self._lsb
        self._slews = 0 < self._slew * clock.interval < (high - low) / self._lsb
        self._lsb_per_charge = parameters.volts_per_charge / self._lsb
        self._unloaded = (parameters.offset - converter.low) / self._lsb
        self._before = np.clip(self._unloaded, *self._rails)  # output of the last scan; updated if it slews
        self._stuck = np.flatnonzero(parameters.status == TaxelStatus.STUCK)
        gain = amplifier.follower_gain if error_model.amplifier_gain else 1.0
        flicker = (error_model.flicker_noise * gain) ** 2
        folded = flicker * FlickerNoise.folded_variance(1 / clock.interval, loop.bandwidth)
        thermal = (error_model.thermal_noise * gain) ** 2 * (math.pi / 2 * loop.bandwidth)
        own = converter.noise**2 if error_model.adc_noise else 0.0
        self._white_lsb = math.sqrt(own + thermal + (folded if flicker else 0.0)) / self._lsb * parameters.noise_factor
        # No normal number deviates by 40 standard deviations: between such rails the ADC never clips.
        margin = 40 * self._white_lsb.max()
        self._clips = self._rails[0] < margin or self._rails[1] > self._top - margin
        self._flicker_lsb = math.sqrt(flicker) / self._lsb
        kind = DrawnNoise if taxels <= SMALL_ARRAY else TabulatedNoise
        self._noise: WhiteNoise = kind(seed, BLOCK, taxels)
        self._flicker = FlickerNoise(seed, taxels, BLOCK) if flicker else None
        self._delay: Array | None = None
        self._hum: MainsHum | None = None
        self._interference: Interference | None = None
        self._code_errors: CodeErrors | None = None
        self._add_board_effects()
        self._number = -1  # of the block that is stored
        self._white: Array | None = None
        self._slow: Array | None = None
        self._unloaded_codes = np.zeros((BLOCK, taxels), np.uint16)
        self._shape = sensor.layout.rows, sensor.layout.cols
        self._neighbours = neighbour_table(sensor.layout, EDGE_NEIGHBOURS)
        self.active = np.arange(0)
        """Indices of the taxels that have charge."""
        self._active: slice | NDArray[np.intp]
        self.activate(self.active)

    def _add_board_effects(self) -> None:
        """Set up hum, interference, skew and errors of the codes, those that are on."""
        effects, taxels = self._error_model.board, self._unloaded.size
        affected = affected_taxels(self._parameters.status, self._seed)
        if effects.taxel_skew:  # from the sampling of each taxel to the time of the scan [s]
            self._delay = min(effects.taxel_skew, self._clock.interval) * (1 - np.arange(taxels) / taxels)
        if self._error_model.hum_amplitude:
            amplitude = self._parameters.hum / self._lsb
            self._hum = MainsHum(amplitude, self._error_model.hum_frequency, effects, self._delay, self._seed)
        if Interference.is_on(effects):
            self._interference = Interference(effects, taxels, affected.telegraph, self._clock.interval, self._seed)
        if CodeErrors.is_on(effects):
            self._code_errors = CodeErrors(effects, self._bits, affected.stuck_bit, self._seed)

    def activate(self, active: NDArray[np.intp]) -> None:
        """Set which taxels have charge, by their indices, ascending."""
        rows, cols = self._shape
        self.active = active
        self._active = slice(None) if active.size == rows * cols else active  # a slice is faster
        self._per_charge = self._lsb_per_charge[active]
        self._unloaded_active = self._unloaded[active]
        column = np.full(rows * cols + 1, active.size)  # without an active taxel: one column past the last
        column[active] = np.arange(active.size)
        self._beside = [column[neighbours] for neighbours in self._neighbours[active].T]
        still_active = np.zeros(rows * cols, np.bool_)
        still_active[active] = True
        self._before[~still_active] = np.clip(self._unloaded[~still_active], *self._rails)

    def outputs(self, charge: Array, steps: Array) -> Array:
        """Return the response of the follower outputs to charge, without noise and rails.

        Parameters
        ----------
        charge : numpy.ndarray
            Charge density [C/m2], shape [scans + 1, active]; the first row is that of the previous scan.
        steps : numpy.ndarray
            Interval since the previous scan [s], shape [scans].

        Returns
        -------
        numpy.ndarray
            Change of the outputs [LSB], shape [scans, active].
        """
        shift, steps = charge * self._per_charge, steps.astype(charge.dtype, copy=False)
        if self._lag_time or self._delay is not None:
            # One pole and an input that is linear between scans: the lag is slope*tau*(1 - exp(-h/tau)). The initial
            # state has decayed, as the scan interval is hundreds of time constants. A taxel that is sampled before the
            # time of the scan lags by that delay.
            behind = np.array(self._lag_time, charge.dtype)
            if self._delay is not None:
                behind = (behind + self._delay[self.active]).astype(charge.dtype, copy=False)
            lag = np.diff(shift, axis=0) * np.minimum(behind / steps[:, None], 1.0)
            shift = shift[1:] - lag
        else:
            shift = shift[1:]
        if self._error_model.crosstalk:
            padded = np.concatenate([shift, np.zeros((len(shift), 1), shift.dtype)], axis=1)
            above, below, left, right = (padded.take(columns, axis=1) for columns in self._beside)
            shift = shift + self._error_model.crosstalk * (left + right + above + below)
        return self._slew_limited(shift, steps) if self._slews else shift

    def volts(self, active: NDArray[np.intp], output: Array) -> Array:
        """Return the output voltages of all followers without noise.

        Parameters
        ----------
        active : numpy.ndarray
            Indices of the taxels with charge.
        output : numpy.ndarray
            One row of `outputs` [LSB], shape [active].

        Returns
        -------
        numpy.ndarray
            Output voltages [V], shape [rows * cols].
        """
        signal = self._unloaded.copy()
        signal[active] += output
        volts: Array = np.clip(signal, *self._rails) * self._lsb + self._low
        return volts

    def counts(self, first: int, outputs: Array) -> NDArray[np.uint16]:
        """Return the codes of several scans of one block.

        Parameters
        ----------
        first : int
            Index of the first scan.
        outputs : numpy.ndarray
            Change of the outputs [LSB], shape [scans, active], from `outputs`.

        Returns
        -------
        numpy.ndarray
            Codes on the 16-bit scale, shape [scans, rows * cols].
        """
        number, row = divmod(first, BLOCK)
        if number != self._number:
            self._start_block(number)
        scans = slice(row, row + len(outputs))
        if not outputs.shape[1]:
            return self._unloaded_codes[scans]
        signal = outputs + self._unloaded_active
        if self._slow is not None:
            signal += self._slow[scans, self._active]
        white = None if self._white is None else self._white[scans, self._active]
        if isinstance(self._active, slice):
            return self._with_stuck(self._convert(signal, white))
        counts = self._unloaded_codes[scans].copy()
        counts[:, self._active] = self._convert(signal, white)
        return self._with_stuck(counts)

    def _slew_limited(self, shift: Array, steps: Array) -> Array:
        """Return the outputs limited to the slew rate of the amplifier."""
        limited = shift + self._unloaded_active
        before = self._before[self._active]
        for row, step in zip(limited, steps.tolist(), strict=True):
            np.clip(row, before - self._slew * step, before + self._slew * step, out=row)
            before = np.clip(row, *self._rails)
        self._before[self._active] = before
        limited -= self._unloaded_active
        return limited

    def _convert(self, signal: Array, white: Array | None) -> NDArray[np.uint16]:
        """Return the codes of outputs before the rails [LSB]; `signal` is overwritten."""
        np.maximum(signal, self._rails[0], out=signal)
        np.minimum(signal, self._rails[1], out=signal)
        if white is not None:
            signal += white
        np.rint(signal, out=signal)
        if self._clips:
            np.maximum(signal, 0, out=signal)
            np.minimum(signal, self._top, out=signal)
        codes = signal.astype(np.uint16)
        if self._code_errors:
            codes = self._code_errors.convert(codes)
        return to_scale(codes, self._bits)

    def _with_stuck(self, codes: NDArray[np.uint16]) -> NDArray[np.uint16]:
        if self._code_errors:
            self._code_errors.stick(codes)
        if self._stuck.size:
            codes[:, self._stuck] = self._parameters.stuck_counts[self._stuck]
        return codes

    def _start_block(self, number: int) -> None:
        """Draw the noise of a block, and convert the unloaded array."""
        self._number = number
        first, taxels = number * BLOCK, self._unloaded.size
        if self._white_lsb.any():
            self._white = self._noise.block(number, self._white_lsb)
        weights, rows = [], []
        if self._flicker:
            weights.append(self._flicker.weights * self._flicker_lsb)
            rows.append(self._flicker.rows(number))
        if self._hum:
            weights.append(self._hum.weights(self._clock.times(first, BLOCK)))
            rows.append(self._hum.rows)
        unloaded = np.tile(self._unloaded, (BLOCK, 1))
        if rows:
            self._slow = np.concatenate(weights, axis=1) @ np.concatenate(rows)
        if self._interference:
            if not rows:
                self._slow = np.zeros((BLOCK, taxels))
            assert self._slow is not None
            self._interference.add(self._slow, number, self._clock.times(first, BLOCK), self._lsb)
        if self._slow is not None:
            unloaded += self._slow
        self._unloaded_codes = self._with_stuck(self._convert(unloaded, self._white))
