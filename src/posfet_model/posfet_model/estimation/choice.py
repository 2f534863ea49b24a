# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The estimators of the forces, the default one, and the limit that decides about valid forces."""

from __future__ import annotations

from enum import Enum
from typing import Final

MAX_RELATIVE_UNCERTAINTY: Final = 0.2
"""Standard deviation of the total force, over that force, above which the forces are not valid [1], assumed: fit for
control of a grip."""


class Estimator(Enum):
    """Ways to estimate forces."""

    OBSERVER = "observer"
    """One filter for each cause of an error (`ForceObserver`): cheaper, for films that neither relax, warm nor bend."""
    ERROR_STATE = "error_state"
    """One filter of all errors, for films that relax, warm and bend as well (`ForceEstimator`)."""


DEFAULT_ESTIMATOR: Final = Estimator.ERROR_STATE
"""The estimator where none is chosen."""
