# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The library imports nothing that it does not need. The layers are defined by the contracts in pyproject.toml."""

from __future__ import annotations

import subprocess
import sys

from support.paths import SOURCES


def test_the_model_loads_neither_ros_nor_matplotlib() -> None:
    modules = [
        "posfet_model.reconstruction.reconstructor",
        "posfet_model.device.transistor",
        "posfet_model.device.film",
        "posfet_model.amplifier.follower",
    ]
    program = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    command = [sys.executable, "-c", program]
    result = subprocess.run(command, capture_output=True, text=True, check=True, cwd=SOURCES / "posfet_model")
    loaded = result.stdout.split()
    assert set(modules) <= set(loaded)
    assert not {"rclpy", "matplotlib", "scipy", "can"} & set(loaded)
