# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Comparison of the follower models with a run of any simulator or measurement setup, and the fit of the overdrive."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.minima import golden_section
from posfet_model.amplifier.closed_loop import ClosedLoop, close_loop
from posfet_model.amplifier.follower import (
    IdealFollower,
    OnePoleFollower,
    SquareLawFollower,
    StaticFollower,
    TwoPoleFollower,
)
from posfet_model.amplifier.follower_base import Follower
from posfet_model.amplifier.slew_identification import OVERDRIVE, SlewModel
from posfet_model.device.paper import AMPLIFIER_GAIN, GAIN_BANDWIDTH
from posfet_model.spice.run_file import FollowerRun

SECOND_POLE_QUALITY: Final = 0.4
"""Quality of `TwoPoleFollower` for an unknown second pole, which is assumed at 1/0.4^2 = 6.25 times the gain-bandwidth
product. In circuit C it is at 4 times, in circuit B a zero masks it."""

OVERDRIVE_SEARCH: Final = (0.01, 10.0)
"""Range in which the overdrive is fitted [V]."""


_FIT_ROWS: Final = 20_000
_FIT_SLEW_SHARE: Final = 0.3


@dataclass(frozen=True)
class Deviation:
    """Model error, in percent of the peak-to-peak of the run's output, first values subtracted."""

    max_pct: float
    """Largest absolute error of all samples [%]."""
    rms_pct: float
    """Root mean square error over time (trapezoidal rule), so that uneven steps are weighted by their length [%]."""


def blind_models() -> dict[str, Follower]:
    """Return the models of an amplifier of which only 42.3 dB and 1.5 MHz are known (Sec. V), all else assumed."""
    loop = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
    # The second pole is added to the dominant one, so the lag of slow signals stays 1/(2*pi*bandwidth).
    two_pole = TwoPoleFollower(
        gain=loop.gain, natural_frequency=loop.bandwidth / SECOND_POLE_QUALITY, quality=SECOND_POLE_QUALITY
    )
    return _models(loop, two_pole, SlewModel("nothing known", loop, OVERDRIVE).follower())


def calibrated_models(loop: ClosedLoop, slewing: SquareLawFollower) -> dict[str, Follower]:
    """Return the models of a follower of known gain and bandwidth.

    Parameters
    ----------
    loop : ClosedLoop
        Measured gain and -3 dB frequency of the follower.
    slewing : SquareLawFollower
        Slewing follower, from `slew_model`.

    Returns
    -------
    dict of str to Follower
        Models by name.
    """
    two_pole = TwoPoleFollower.from_bandwidth(loop.gain, loop.bandwidth, SECOND_POLE_QUALITY)
    return _models(loop, two_pole, slewing)


def _models(loop: ClosedLoop, two_pole: TwoPoleFollower, slewing: SquareLawFollower) -> dict[str, Follower]:
    return {
        "ideal": IdealFollower(),
        "static": StaticFollower(gain=loop.gain),
        "one_pole": OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth),
        "two_pole": two_pole,
        "square_law_slew": slewing,
    }


def deviation(run: FollowerRun, model: Follower) -> Deviation:
    """Return the error of a model, started at rest with the run's first input, relative to the run's output.

    Parameters
    ----------
    run : FollowerRun
        Reference run.
    model : Follower
        Model to compare.

    Returns
    -------
    Deviation
        Largest and rms error [%].
    """
    output = model.run(run.time, run.v_in).v_out
    error = (output - output[0]) - (run.v_out - run.v_out[0])
    squares = 0.5 * (error[1:] ** 2 + error[:-1] ** 2) * np.diff(run.time)
    scale = 100 / float(np.ptp(run.v_out))
    return Deviation(
        max_pct=float(np.max(np.abs(error))) * scale,
        rms_pct=math.sqrt(float(np.sum(squares)) / float(run.time[-1] - run.time[0])) * scale,
    )


def deviations(run: FollowerRun, models: Mapping[str, Follower]) -> dict[str, Deviation]:
    """Return the error of each model relative to a run.

    Parameters
    ----------
    run : FollowerRun
        Reference run.
    models : mapping of str to Follower
        Models by name.

    Returns
    -------
    dict of str to Deviation
        Errors by name.
    """
    return {name: deviation(run, model) for name, model in models.items()}


def slews(run: FollowerRun, loop: ClosedLoop) -> bool:
    """Return whether a run needs 0.3 or more of the slew rate at `OVERDRIVE`; with less it cannot be identified.

    Parameters
    ----------
    run : FollowerRun
        The run.
    loop : ClosedLoop
        Gain and bandwidth of the follower.

    Returns
    -------
    bool
        Whether it slews.
    """
    lag = run.v_in - OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth).run(run.time, run.v_in).v_out / loop.gain
    return bool(np.max(np.abs(lag)) >= _FIT_SLEW_SHARE * OVERDRIVE)


def fit_overdrive(run: FollowerRun, model: SlewModel) -> float:
    """Return the overdrive [V], in [0.01, 10], with which the slewing follower has the smallest rms error on a run.

    A small-signal analysis does not show the tail current; only a run that slews does (see `slews`; any other run gives
    a meaningless number). Validate the result on other runs than this. Runs of more than 20000 rows are thinned out.

    Parameters
    ----------
    run : FollowerRun
        Run that slews.
    model : SlewModel
        Slewing follower whose overdrive is to be fitted.

    Returns
    -------
    float
        Overdrive of the pair at balance [V].
    """
    keep = np.unique(np.append(np.arange(0, run.time.size, -(-run.time.size // _FIT_ROWS)), run.time.size - 1))
    thinned = FollowerRun(run.time[keep], run.v_in[keep], run.v_out[keep])

    def rms(log_overdrive: float) -> float:
        return deviation(thinned, model.follower(math.exp(log_overdrive))).rms_pct

    low, high = (math.log(v) for v in OVERDRIVE_SEARCH)
    grid = np.linspace(low, high, 15)
    best = int(np.argmin([rms(float(point)) for point in grid]))
    # To 1/1000 of the bracket.
    return math.exp(golden_section(rms, float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)]), 14))
