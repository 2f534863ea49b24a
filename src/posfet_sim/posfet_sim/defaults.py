# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.


"""Names and limits that commands and parameters have before a simulated board is made."""

from __future__ import annotations

from typing import Final

DEFAULT_SCENE: Final = "press_slide_lift"
"""Name of the default scene."""
DEFAULT: Final = "default"
"""Name of the sensor error model with every default."""
SEED_MAX: Final = 1_000_000_000
"""Greatest seed of a random stream."""
