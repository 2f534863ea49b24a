# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Where gain, unity crossing and phase margin do not determine the output of a follower.

The same margin belongs to a second pole, to a zero in the right half-plane, or to both with a zero in the left one:
steps of op-amps with the same three figures differ by some per cent while they settle, and the delay of slow inputs by
up to half of itself. Only what lags little behind is certain. Nor do figures at 0 V tell at which inputs the follower
is stable: a load resistor takes the current from the output stage, and the margin with it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model._lib.validation import real_number

POLES_NOT_GIVEN: Final = (
    "second pole and zero not given, and the input changes faster than gain, unity crossing and phase margin determine"
)

LARGEST_LAG: Final = 0.002
"""Lag behind the output at rest that may be wrong by half of itself, as a share of the input's span."""

ROUNDING: Final = 1e-9
"""Lag of an input that rests, by rounding [V]."""

SETTLING: Final = 3.0
"""Time that the output of the real op-amp may need longer, in periods of the unity crossing."""

INPUTS_NOT_GIVEN: Final = (
    "range of inputs not given, and gain, unity crossing and phase margin at 0 V do not tell whether the follower is "
    "stable here"
)

NEAR_REST: Final = (-0.06, 0.06)
"""Inputs [V] for which figures at 0 V are taken to hold where no range is given, assumed: of 2412 random op-amps of two
stages with good margins at 0 V the first is unstable at 0.1 V."""


def undetermined(lag: Array, span: float | Array, step: Array | None, crossing: float | Array) -> Mask:
    """Return where the output depends on more than three figures; unchecked.

    Parameters
    ----------
    lag : ndarray
        Deviation of the output from that at rest at the input of the moment [V], shape [t, ...], or [...] of a moment.
    span : float or ndarray
        Span of the inputs [V], of which the lag has to be a small part.
    step : ndarray or None
        Time from each sample to the next [s], shape [t - 1]; None for a single moment.
    crossing : float or ndarray
        Unity crossing [Hz].

    Returns
    -------
    ndarray
        Mask of the shape of `lag`.
    """
    large: Mask = np.asarray(np.abs(lag) > LARGEST_LAG * np.asarray(span) + ROUNDING)
    if step is None:
        return large
    time = np.concatenate([[0.0], np.cumsum(step)]).reshape(-1, *(1,) * (large.ndim - 1))
    last = np.maximum.accumulate(np.where(large, time, -np.inf), axis=0)
    return np.asarray((time - last) * crossing <= SETTLING)


def check_known_inputs(ends: tuple[float, float]) -> None:
    """Raise ValueError unless a range of inputs has a lowest one in [-1e6, 0] and a highest one in [0, 1e6]."""
    if not isinstance(ends, tuple) or len(ends) != 2:
        raise ValueError(f"known_inputs must be a tuple of the lowest and the highest input, got {ends!r:.60}")
    real_number("known_inputs[0]", ends[0], -1e6, 0)
    real_number("known_inputs[1]", ends[1], 0, 1e6)
