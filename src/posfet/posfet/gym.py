# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The environment `posfet/Grasp-v0` for gymnasium: importing this module registers it. Needs the package gymnasium.

>>> import gymnasium
>>> import posfet.gym
>>> env = gymnasium.make("posfet/Grasp-v0")
>>> observation, info = env.reset(seed=1)
>>> observation["force"].shape  # [fingertips, rows, cols]
(2, 5, 5)
"""

from __future__ import annotations

try:
    import gymnasium
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
    raise ModuleNotFoundError(
        "posfet.gym needs the package gymnasium: pip install gymnasium", name="gymnasium"
    ) from error

from posfet_sim.grasp.environment import ENVIRONMENT, GraspEnv

__all__ = ["ENVIRONMENT", "GraspEnv"]

if ENVIRONMENT not in gymnasium.registry:
    gymnasium.register(ENVIRONMENT, entry_point="posfet_sim.grasp.environment:GraspEnv")
