# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Variants of the estimator that the fronts compare: the one place that knows their names and settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

from posfet_model.estimation import force_estimator
from posfet_model.estimation.error_states import BENDS, ErrorPriors
from posfet_model.reconstruction.settings import ReconstructionSettings

STACK = "this stack"

BLOCKS = (0.01, 0.02, 0.05, 0.1)
"""Blocks [s]. Shorter ones than 20 ms, one period of the mains, see its hum as forces; one of 5 ms never settles."""

TINY = 1e-9
"""Standard deviation of a state that is left out: nothing is learnt of it."""

WITHOUT_STATES: Mapping[str, Mapping[str, Any]] = {
    "no bending": {"bend": (TINY,) * BENDS, "bend_share": 0.0},
    "no warmth": {"warmth": TINY, "warmth_least": TINY, "warmth_spread": TINY},
    "no leakage error": {"leak": TINY, "leak_calibrated": TINY},
    "no creep": {"creep": (TINY, TINY, TINY), "creep_least": TINY},
    "film noise fixed": {"rate_change": TINY},
}
"""Groups of states, left out by their priors."""


@dataclass(frozen=True)
class Variant:
    """The estimator with other settings."""

    settings: ReconstructionSettings = field(default_factory=ReconstructionSettings)
    block: float | None = None
    """Block, for which there is no setting [s]; None: as shipped."""

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Have the variant's block within the context."""
        if self.block is None:
            yield
            return
        with patch.object(force_estimator, "BLOCK", self.block):
            yield


def variants() -> dict[tuple[str, str], Variant]:
    """Return every block and every group left out, by series and parameter."""
    found = {
        (STACK, _block(block)): Variant(block=None if block == force_estimator.BLOCK else block) for block in BLOCKS
    }
    for name, priors in WITHOUT_STATES.items():
        settings = ReconstructionSettings(priors=replace(ErrorPriors(), **priors))
        found[f"{STACK} with less", name] = Variant(settings)
    return found


def shipped_variant() -> tuple[str, str]:
    """Return series and parameter of the variant that is shipped."""
    return STACK, _block(force_estimator.BLOCK)


def _block(seconds: float) -> str:
    return f"block {seconds * 1e3:g} ms"
