# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Which follower models are valid on a run: whether what a model leaves out matters there, whatever its error."""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model.amplifier.closed_loop import ClosedLoop
from posfet_model.amplifier.follower import IdealFollower, OnePoleFollower, SquareLawFollower, StaticFollower
from posfet_model.amplifier.follower_base import Follower
from posfet_model.spice.model_comparison import slews
from posfet_model.spice.run_file import FollowerRun

NEGLIGIBLE: Final = 0.005
"""What a valid model may leave out [full scale]."""

GAIN: Final = "the gain differs from 1 by more than 0.5 % of full scale"
LAG: Final = "the output lags by more than 0.5 % of full scale"
SLEWING: Final = "the run slews, and the model is linear"
BEYOND: Final = "samples are beyond the range or the slew rate of the model"


def reasons(run: FollowerRun, model: Follower, loop: ClosedLoop) -> list[str]:
    """Return why a model is not valid on a run, by gain and bandwidth of the follower; empty if it is.

    Ringing does not follow from gain and bandwidth, and is no reason.

    Parameters
    ----------
    run : FollowerRun
        The run; its output only gives the full scale.
    model : Follower
        The model.
    loop : ClosedLoop
        Gain and bandwidth of the follower.

    Returns
    -------
    list of str
        `GAIN`, `LAG`, `SLEWING` and `BEYOND`, as they apply.
    """
    scale = float(np.ptp(run.v_out))
    one_pole = OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth).run(run.time, run.v_in).v_out
    lag = float(np.abs(loop.gain * run.v_in - one_pole).max())
    gain = abs(1 - loop.gain) * float(np.abs(run.v_in - run.v_in[0]).max())
    found = {
        GAIN: type(model) is IdealFollower and gain > NEGLIGIBLE * scale,
        LAG: type(model) in (IdealFollower, StaticFollower) and lag > NEGLIGIBLE * scale,
        SLEWING: not isinstance(model, SquareLawFollower) and slews(run, loop),
        BEYOND: not model.run(run.time, run.v_in).valid.all(),
    }
    return [reason for reason, applies in found.items() if applies]
