# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A scene of one touch, for tests that interrupt it."""

TOUCH = """
name: touch
description: a fingertip presses at once and holds
temperature_degC: 25.0
objects:
  - name: fingertip
    kind: sphere
    radius_mm: 5.0
    effective_modulus_MPa: 2.0
    keyframes:
      - {time_s: 0.05, x_mm: 0.2, y_mm: -0.1, force_N: 0.0}
      - {time_s: 0.1, x_mm: 0.2, y_mm: -0.1, force_N: 2.0}
      - {time_s: 3.0, x_mm: 0.2, y_mm: -0.1, force_N: 2.0}
"""
