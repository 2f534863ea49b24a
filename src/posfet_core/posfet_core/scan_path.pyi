# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_core.contact import Contact, Motion, Region

CORNER_FREQUENCY: Final[float]
ENTER_DEVIATIONS: Final[float]
LAST_ID: Final[int]
POWER_TIME_CONSTANT: Final[float]
SLIP_END_SPEED: Final[float]
SLIP_SPEED: Final[float]

class Layout:
    def __init__(self, rows: int, cols: int, pitch_x: float, pitch_y: float, taxel_area: float) -> None: ...

class ForceEstimate:
    def __init__(
        self,
        force: NDArray[np.float64],
        variance: NDArray[np.float64],
        common_variance: float = 0.0,
        saturated: NDArray[np.bool_] | None = None,
        unlisted: NDArray[np.bool_] | None = None,
        interpolated: NDArray[np.bool_] | None = None,
        correlated_error: NDArray[np.float64] | None = None,
    ) -> None: ...

class ContactFinder:
    def __init__(self, layout: Layout, spread: float, enter: float, release: float) -> None: ...
    @property
    def touched(self) -> NDArray[np.bool_]: ...
    @property
    def regions(self) -> list[NDArray[np.intp]]: ...
    @property
    def patches(self) -> list[NDArray[np.intp]]: ...
    def change_thresholds(self, enter: float, release: float) -> None: ...
    def update_thresholds(
        self, force: ArrayLike, variance: ArrayLike, common_variance: float, usable: ArrayLike | None = None
    ) -> None: ...
    def find(self, force: ArrayLike) -> int: ...
    def measure(self, taxels: ForceEstimate, before: Sequence[Region] = ()) -> tuple[Region, ...]: ...
    def dilated(self, taxels: ArrayLike, distance: int) -> NDArray[np.bool_]: ...

class ContactTracker:
    def __init__(
        self,
        *,
        gate: float,
        smoothing: float,
        start_speed: float,
        stop_speed: float,
        pitch: float,
        threshold: float,
        noise: float,
        first_id: int,
    ) -> None: ...
    @property
    def idle(self) -> bool: ...
    def update(self, regions: Sequence[Region], step: float) -> tuple[Contact, ...]: ...
    def follow(self, finder: ContactFinder, taxels: ForceEstimate, step: float) -> tuple[Contact, ...]: ...

class DynamicChannel:
    def __init__(self, layout: Layout, noise: float) -> None: ...
    @property
    def high_passed(self) -> NDArray[np.float64]: ...
    @property
    def power(self) -> NDArray[np.float64]: ...
    def pause(self) -> None: ...
    def advance(self, change: ArrayLike, step: float) -> None: ...
    def update_power(self, step: float) -> None: ...
    def update(self, tracker: ContactTracker, force: ArrayLike, step: float) -> dict[int, Motion]: ...

def minimum_cost_assignment(costs: Sequence[Sequence[float]], unassigned_cost: float) -> list[tuple[int, int]]: ...
