# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Checks of a calibration fit: each refuses one part with one line that names it and says what to do.

Residuals need not be white to the last microvolt, as no film is exactly as modelled: the bounds are noise plus a share
of the force or temperature that caused them, stated with each check. Residuals are judged with their correlation
(`correlated_variance`), so that a small error that lasts counts like a large one that does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.bending_fit import BendingFit
from posfet_model.calibration.leaky_response import block_means, high_pass
from posfet_model.calibration.response_fit import (
    RATE_RANGE,
    ResponseFit,
    Segment,
    TaxelResponse,
    block_size,
    correlated_variance,
)
from posfet_model.calibration.temperature_fit import TemperatureFit
from posfet_model.sensor.description import Sensor

GAIN_RANGE: Final = (0.25, 4.0)
"""Plausible gains relative to nominal [1]: of films of another thickness or polarisation, assumed."""

LEAK_RANGE: Final = (0.2, 5.0)
"""Plausible leakage time constants relative to nominal [1]: resistors of 10 Gohm are within a factor of five."""

LEAK_DEVIATION: Final = 0.1
"""Largest relative standard deviation of a leakage time constant that presses alone may leave [1], assumed: presses and
pauses of 1.6 time constants leave 0.02, those of 1.1 time constants three times the time constant."""

PRESS_TIME: Final = 2.0
"""Presses and pauses that are long enough [leakage time constants]."""

MAX_BENDING: Final = 0.03
"""Largest plausible bending of a chip, and of its gradients [1], assumed: four times that of a poor mount."""

MAX_WARMTH: Final = 0.2
"""Largest temperature rise of touched taxels by the ball [K]: twice as much as hides the force of a contact."""

PRESS_SHARE: Final = 0.01
"""Residuals of a press may be this share of its force [1]: they would change the gain by as much."""

HALVES_SHARE: Final = 0.02
"""The gains of the first and the second half of a taxel's presses may differ by this share [1]: each to 1 %."""

HOLD_SHARE: Final = 0.01
"""Residuals of a long hold may be this share of its force [1]."""

TEMPERATURE_SHARE: Final = 0.02
"""Residuals of the temperature may be this share of its range [1]."""

TEMPERATURE_NOISE: Final = 5e-3
"""Residuals of the temperature may be as large as this, too [K]: the noise and resolution of a sensor."""

NOISES: Final = 5.0
"""Residuals may be this many times the noise, as it is correlated at low frequencies [1]."""

OFFSET_CHANGE: Final = 0.02
"""The offsets of a taxel in the segments of a recording may differ by this share of its largest force [1]."""


class FitError(ValueError):
    """A part of a calibration cannot be fitted; one line with the part, the reason and the remedy."""


def check_ranges(sensor: Sensor, found: ResponseFit, dead: Mask) -> None:
    """Refuse implausible gains and leakage time constants.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.
    found : ResponseFit
        The fit.
    dead : ndarray
        Taxels that do not respond, shape [taxels].

    Raises
    ------
    FitError
        A parameter is out of range.
    """
    nominal = sensor.device.leak_time_constant
    for taxel in np.flatnonzero(~dead).tolist():
        each = found.taxels[taxel]
        if not GAIN_RANGE[0] <= each.gain <= GAIN_RANGE[1]:
            raise FitError(
                f"gain of taxel {taxel}: must be {GAIN_RANGE[0]:g} to {GAIN_RANGE[1]:g} times nominal, "
                f"got {each.gain:.3g}: compare the reference force and the place of the ball with the recording"
            )
        ratio = 1.0 / (each.rate * nominal)
        if not LEAK_RANGE[0] <= ratio <= LEAK_RANGE[1]:
            at_limit = " or beyond" if not 1.01 / RATE_RANGE[1] < ratio < 0.99 / RATE_RANGE[0] else ""
            raise FitError(
                f"leakage of taxel {taxel}: must be {LEAK_RANGE[0]:g} to {LEAK_RANGE[1]:g} times nominal, "
                f"got {ratio:.3g}{at_limit}: compare leak_time_constant_s of the sensor file with the board"
            )


def check_responses(
    segments: Sequence[Segment], found: ResponseFit, noise: Array, hold: tuple[float, float] | None
) -> None:
    """Refuse presses and a long hold whose residuals are not noise, and gains that differ from time to time.

    Parameters
    ----------
    segments : sequence of Segment
        Segments that were fitted.
    found : ResponseFit
        The fit.
    noise : ndarray
        Standard deviation of a block mean of each taxel [N], shape [taxels].
    hold : tuple of float, optional
        Begin and end of the long hold [s].

    Raises
    ------
    FitError
        A part does not fit; the worst taxel is named.
    """
    of_taxel: dict[int, list[Segment]] = {}
    for segment in segments:
        of_taxel.setdefault(segment.taxel, []).append(segment)
    held, pressed, halves, offsets = [], [], [], []
    for taxel, parts in of_taxel.items():
        each = found.taxels[taxel]
        force = max(float(part.sources[:, 0].max()) for part in parts) * each.gain
        presses: list[tuple[Segment, Array]] = []
        for part, residuals in zip(parts, each.residuals, strict=True):
            if hold is not None and part.time[-1] > hold[0] and part.time[0] < hold[1]:
                held.append((_excess(residuals, noise[taxel], HOLD_SHARE * force), taxel))
            else:
                presses.append((part, residuals))
        if presses:
            left = np.concatenate([residuals for _, residuals in presses])
            pressed.append((_excess(left, noise[taxel], PRESS_SHARE * force), taxel))
            halves.append((_difference_of_halves(presses, each), taxel))
        change = float(np.ptp(each.offsets))
        offsets.append((change / (NOISES * float(noise[taxel]) + OFFSET_CHANGE * force), taxel))
    worst, taxel = max(held, default=(0.0, 0))
    if worst > 1.0:
        raise FitError(
            f"long hold: residuals of taxel {taxel} are {worst:.1f} times the bound ({HOLD_SHARE:.0%} of the force): "
            "hold the ball still and its force constant, or leave the long hold out"
        )
    worst, taxel = max(pressed, default=(0.0, 0))
    if worst > 1.0:
        raise FitError(
            f"presses of taxel {taxel}: residuals are {worst:.1f} times the bound ({PRESS_SHARE:.0%} of the force): "
            "compare force, place and clock of the reference with the recording"
        )
    worst, taxel = max(halves, default=(0.0, 0))
    if worst > HALVES_SHARE:
        raise FitError(
            f"gain of taxel {taxel}: differs by {worst:.1%} between the halves of its presses, more than "
            f"{HALVES_SHARE:.0%}: press it again, both times alike"
        )
    worst, taxel = max(offsets, default=(0.0, 0))
    if worst > 1.0:
        raise FitError(
            f"offset of taxel {taxel}: drifts by {worst:.1f} times the bound ({OFFSET_CHANGE:.0%} of the force): "
            "let the board warm up, and keep its temperature"
        )


def check_leakage(sensor: Sensor, presses: ResponseFit, dead: Mask) -> None:
    """Refuse presses that are too short to tell the leakage from the gain.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.
    presses : ResponseFit
        Fit of the presses alone.
    dead : ndarray of bool
        Taxels that measure nothing, shape [taxels].

    Raises
    ------
    FitError
        The time constant of a taxel is not known.
    """
    worst, taxel = leakage_deviation(presses, dead)
    if worst > LEAK_DEVIATION:
        needed = PRESS_TIME * sensor.device.leak_time_constant
        raise FitError(
            f"leakage of taxel {taxel}: its presses tell the time constant to {worst:.0%} only, more than "
            f"{LEAK_DEVIATION:.0%}: press each taxel for {needed:.1g} s, and leave it for as long, "
            "or compare leak_time_constant_s of the sensor file with the board"
        )


def leakage_deviation(presses: ResponseFit, dead: Mask) -> tuple[float, int]:
    """Return the greatest relative standard deviation of a leakage time constant [1], and its taxel.

    Parameters
    ----------
    presses : ResponseFit
        Fit of the presses alone.
    dead : ndarray of bool
        Taxels that measure nothing, shape [taxels].
    """
    return max((each.deviations[-1] / each.rate, taxel) for taxel, each in presses.taxels.items() if not dead[taxel])


def check_bending(bending: BendingFit) -> None:
    """Refuse a bending that no chip has.

    Parameters
    ----------
    bending : BendingFit
        The bending.

    Raises
    ------
    FitError
        It is out of range.
    """
    sizes = np.append(bending.sizes, bending.sizes[0] * bending.profile)
    largest = float(sizes[np.argmax(np.abs(sizes))])
    if abs(largest) > MAX_BENDING:
        raise FitError(
            f"bending: must be within +-{MAX_BENDING * 1e3:g} mN per newton on every taxel, got {largest * 1e3:.3g}: "
            "let nothing but the ball touch the array, and compare the places that it presses with the recording"
        )


def check_warmth(warmth: float) -> None:
    """Refuse a ball that warms or cools the film too much.

    Parameters
    ----------
    warmth : float
        Temperature rise of the taxels that it touches [K].

    Raises
    ------
    FitError
        It is out of range.
    """
    if abs(warmth) > MAX_WARMTH:
        raise FitError(
            f"warmth: the ball changes the temperature of the taxels that it touches by {warmth:.2g} K, more than "
            f"{MAX_WARMTH:g} K: press with an object as warm as the chip"
        )


def check_temperature(thermal: TemperatureFit, temperature: Array) -> None:
    """Refuse a temperature that does not explain what the untouched taxels have in common.

    Parameters
    ----------
    thermal : TemperatureFit
        The fit.
    temperature : ndarray
        Temperature of the chip's sensors [K], shape [blocks].

    Raises
    ------
    FitError
        The lag is out of range, or the residuals are not noise.
    """
    if thermal.at_limit:
        raise FitError(
            f"temperature part: the film's lag behind the sensors is {thermal.lag:g} s or beyond: "
            "change the temperature more slowly, or check the chip's sensors"
        )
    rms = float(np.sqrt(np.mean(np.square(thermal.residuals))))
    bound = TEMPERATURE_NOISE + TEMPERATURE_SHARE * float(np.ptp(temperature))
    if rms > bound:
        raise FitError(
            f"temperature part: the chip's sensors differ from the film by {rms * 1e3:.0f} mK, more than "
            f"{bound * 1e3:.0f} mK: keep objects of another temperature off the chip, or check its sensors"
        )


def _excess(residuals: Array, noise: float, allowed: float) -> float:
    """Return the residuals relative to their bound [1]."""
    return float(np.sqrt(correlated_variance(residuals)) / (NOISES * noise + allowed))


def _difference_of_halves(presses: Sequence[tuple[Segment, Array]], response: TaxelResponse) -> float:
    """Return by how much the gains that the two halves of the presses' time would have by themselves differ [1]."""
    columns, left = [], []
    for part, residuals in presses:
        signal = high_pass(part.time, part.sources[:, 0], 1.0 / response.rate)
        columns.append(block_means(signal, block_size(part.time)))
        left.append(residuals)
    column, residual = np.concatenate(columns), np.concatenate(left)
    # Half of the information on the gain is in each half.
    weight = np.cumsum(column**2)
    middle = int(np.searchsorted(weight, 0.5 * weight[-1]))
    changes = [
        float(column[part] @ residual[part]) / float(column[part] @ column[part])
        for part in (slice(0, middle), slice(middle, None))
        if column[part].any()
    ]
    return abs(changes[0] - changes[-1]) / response.gain
