# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Quality of service of what the nodes publish for every scan."""

from __future__ import annotations

from rclpy.qos import QoSProfile, ReliabilityPolicy

OUTPUT_DEPTH = 10
"""Queue depth of the topics of the model."""


def output_qos(reliability: str, depth: int) -> QoSProfile:
    """Return the profile of a topic with a message for every scan.

    Parameters
    ----------
    reliability : str
        Value of the parameter `posfet_model.parameters.RELIABILITY`.
    depth : int
        Queue depth.
    """
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy[reliability.upper()])
