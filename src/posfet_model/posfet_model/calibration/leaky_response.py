# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Response of a leaking taxel to its sources, and the columns of a linear fit of it; exact for first-order holds.

Sources are piecewise linear between scans. The charge x of a taxel, as a nominal force, follows its source u and leaks:
``dx/dt = du/dt - rate*(x - o)``, rate = 1/tau.
"""

from __future__ import annotations

import numpy as np

from posfet_core import scan_path
from posfet_model._lib.types import Array


def high_pass(time: Array, source: Array, time_constant: float) -> Array:
    """Return what a source leaves after leakage, from no charge at the first scan.

    Parameters
    ----------
    time : ndarray
        [s], ascending, shape [scans].
    source : ndarray
        Any unit, shape [scans] or [scans, columns].
    time_constant : float
        Time constant tau of the leakage [s].

    Returns
    -------
    ndarray
        Response y with ``dy/dt = du/dt - y/tau``, in the unit and shape of the source.
    """
    return scan_path.high_pass(time, source, time_constant)


def low_pass(time: Array, source: Array, time_constant: float) -> Array:
    """Return a first-order lag behind a source, from 0 at the first scan.

    Parameters
    ----------
    time : ndarray
        [s], ascending, shape [scans].
    source : ndarray
        Any unit, shape [scans] or [scans, columns].
    time_constant : float
        Time constant of the lag [s]; 0: none.

    Returns
    -------
    ndarray
        Response y with ``dy/dt = (u - y)/tau``, in the unit and shape of the source.
    """
    if time_constant <= 0.0:
        change: Array = source - source[:1]
        return change
    return scan_path.low_pass(time, source, time_constant)


def compensated(time: Array, signal: Array, time_constant: float) -> Array:
    """Return a signal with the leakage compensated since the first scan.

    Parameters
    ----------
    time : ndarray
        [s], ascending, shape [scans].
    signal : ndarray
        Any unit, shape [scans].
    time_constant : float
        Time constant tau of the leakage [s].

    Returns
    -------
    ndarray
        In the unit and shape of the signal.
    """
    lost = 0.5 * (signal[1:] + signal[:-1]) * np.diff(time) / time_constant
    whole: Array = signal + np.concatenate([[0.0], np.cumsum(lost)])
    return whole


def block_means(values: Array, size: int) -> Array:
    """Return the means of consecutive blocks of scans; an incomplete last block is left out.

    Parameters
    ----------
    values : ndarray
        Shape [scans] or [scans, columns].
    size : int
        Number of scans in a block.

    Returns
    -------
    ndarray
        Shape [blocks] or [blocks, columns].
    """
    blocks = len(values) // size
    means: Array = values[: blocks * size].reshape(blocks, size, *values.shape[1:]).mean(axis=1)
    return means


def play_distance(force: Array, half_width: float) -> Array:
    """Return the distance F - P of a force from its play operator, which starts at 0.

    Parameters
    ----------
    force : ndarray
        Force F [N], shape [scans, taxels].
    half_width : float
        Half width r of the play operator [N]: P is dragged along, never further than r from F.

    Returns
    -------
    ndarray
        [N], shape [scans, taxels].
    """
    return scan_path.play_distance(force, half_width)
