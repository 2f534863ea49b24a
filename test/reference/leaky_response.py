# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the response of a leaking taxel to its sources, in NumPy: exact for what is linear between scans."""

from __future__ import annotations

import numpy as np

from posfet_model._lib.types import Array


def high_pass(time: Array, source: Array, time_constant: float) -> Array:
    """Return y with ``dy/dt = du/dt - y/tau`` of sources u, from no charge at the first scan."""
    ratio = np.diff(time) / time_constant
    left = -np.expm1(-ratio) / np.maximum(ratio, 1e-300)
    response = np.zeros_like(source, np.float64)
    for step, kept in enumerate(np.exp(-ratio)):
        response[step + 1] = kept * response[step] + left[step] * (source[step + 1] - source[step])
    return response


def low_pass(time: Array, source: Array, time_constant: float) -> Array:
    """Return y with ``dy/dt = (u - y)/tau`` of sources u, from 0 at the first scan."""
    change = source - source[:1]
    risen = -np.expm1(-(time - time[0]) / time_constant).reshape(-1, *(1,) * (source.ndim - 1))
    response: Array = change - high_pass(time, change, time_constant) + source[:1] * risen
    return response


def play_distance(force: Array, half_width: float) -> Array:
    """Return the distance F - P of forces from play operators P, which begin at 0."""
    play, distance = np.zeros_like(force[0]), np.empty_like(force)
    for scan, now in enumerate(force):
        play = np.minimum(np.maximum(play, now - half_width), now + half_width)
        distance[scan] = now - play
    return distance


def fit_columns(
    time: Array,
    source: Array,
    time_constant: float,
    coefficients: Array,
    start: float,
    first_signal: int,
    end_of_signals: int,
    block: int,
) -> Array:
    """Return means of blocks of the responses, of the charge's derivative by the leakage rate, and of the decay."""
    response = high_pass(time, source, time_constant)
    response[:, first_signal:end_of_signals] = source[:, first_signal:end_of_signals]
    decay = np.exp(-(time - time[0]) / time_constant)
    slope = -time_constant * low_pass(time, response @ coefficients + start * decay, time_constant)
    columns = np.column_stack([response, slope, decay])
    blocks = len(time) // block
    means: Array = columns[: blocks * block].reshape(blocks, block, -1).mean(axis=1)
    return means
