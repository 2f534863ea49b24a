# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The configuration of diagnostic_aggregator finds every status that the stack publishes, by the aggregator's rules."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from support.paths import ROOT

CONFIGURATION = ROOT / "src" / "posfet" / "config" / "diagnostics.yaml"
GROUP: dict[str, Any] = yaml.safe_load(CONFIGURATION.read_text(encoding="utf-8"))["/**"]["ros__parameters"]["tactile"]


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("tactile/model_node: reconstruction", "Models"),
        ("robot/hand/thumb/model_node: reconstruction", "Models"),
        ("tactile/driver_node: board", "Boards"),
        ("hand/palm/sim_board_node: board", "Boards"),
        ("tactile/replay_node: board", "Boards"),
        ("arm/driver_node: joints", None),
    ],
)
def test_each_status_belongs_to_one_analyzer(name: str, path: str | None) -> None:
    found = [each["path"] for each in GROUP["analyzers"].values() if any(text in name for text in each["contains"])]
    assert found == ([path] if path else [])


def test_every_analyzer_has_a_type_of_the_aggregator_and_a_time_after_which_it_says_stale() -> None:
    assert GROUP["type"] == "diagnostic_aggregator/AnalyzerGroup"
    for analyzer in GROUP["analyzers"].values():
        assert analyzer["type"] == "diagnostic_aggregator/GenericAnalyzer"
        assert analyzer["timeout"] > 1.0
