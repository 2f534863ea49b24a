# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Kalman filter of the force errors: states that all taxels share, and four of each taxel; linear in the taxels.

Given the shared states s, the errors of the taxels are independent: with t_i = (d_i, o_i, r_i, p_i), error of the
force, offset of the signal, small force beside a contact and relative error of the pyroelectric response of taxel i,

    t_i = m_i + G_i*(s - s^) + e_i,    cov(e_i) = V_i,    cov(s) = S.

A known force of taxel i measures ``z_i = d_i + r_i + h_i.s + noise`` (docs/estimation.md).

Compiled: `posfet_core`, estimation/belief.hpp and estimation/force_error_filter.hpp.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_core import scan_path
from posfet_model._lib.types import Array

OWN: Final = scan_path.OWN_STATES
"""Number of states of each taxel."""

NEGLIGIBLE: Final = scan_path.NEGLIGIBLE_CORRELATION
"""Added to the correlation of each shared state with itself [1]: correlations are positive within rounding, then."""

Belief = scan_path.Belief

ForceErrorFilter = scan_path.ForceErrorFilter


def start_belief(taxels: int, shared: Array, covariance: Array) -> Belief:
    """Return a belief without force errors.

    Parameters
    ----------
    taxels : int
        Number of taxels.
    shared : ndarray of float64, shape [shared]
        Shared states.
    covariance : ndarray of float64, shape [shared, shared]
        Their covariance.
    """
    size = len(shared)
    return Belief(
        shared, covariance, np.zeros((taxels, OWN)), np.zeros((taxels, OWN, size)), np.zeros((taxels, OWN, OWN))
    )
