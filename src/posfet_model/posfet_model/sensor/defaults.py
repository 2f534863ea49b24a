# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.


"""Names that commands and parameters have before a sensor file is read."""

from __future__ import annotations

from typing import Final

DEFAULT_SENSOR: Final = "posfet_5x5"
"""Name of the default sensor file."""
FRAME_CHOICES: Final = ("auto", "true", "false")
"""Type of the board's CAN frames: as in the sensor file, CAN FD, or classic CAN."""
