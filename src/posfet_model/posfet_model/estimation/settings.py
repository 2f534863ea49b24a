# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Limits and constants of the force estimator; all values are assumed unless stated."""

from __future__ import annotations

from typing import Final

MAX_RELATIVE_UNCERTAINTY: Final = 0.2
"""Standard deviation of the total force, over that force, above which the forces are not valid [1]: fit for control of
a grip."""

LONG_STEP: Final = 0.05
"""h/tau above which the time of a force change within a step matters [1]."""

RUNAWAY: Final = 4.0
"""A taxel restarts when its force exceeds this many times the greatest force of the device [1]; a saturated taxel may
exceed the greatest force."""

REJECTED: Final = 3.0
"""Factor on the prior deviation of the residual charge after that prior was rejected [1]."""

RESTART_DEVIATION: Final = 0.1
"""Standard uncertainty of an offset that was known when its taxel restarted [contact threshold]."""

OFFSET_SPREAD: Final = 2.0
"""Greatest deviation of an untouched taxel's offset from the median offset [contact threshold]; a larger one requires a
longer rest."""
