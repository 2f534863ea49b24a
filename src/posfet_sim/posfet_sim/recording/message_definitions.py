# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Definitions of ROS messages that are written to files: installed, in the Python package, or in the source tree."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from typing import Final

from posfet_model.config import ConfigError
from posfet_sim.recording.ros2msg import PRIMITIVES, RULE, Field, fields

OWN_PACKAGE: Final = "posfet_msgs"
"""Package whose definitions are also found without ROS."""
_WITHOUT_ROS: Final = (Path(__file__).parent / "msg", Path(__file__).parents[3] / OWN_PACKAGE / "msg")
"""In the Python package without ROS, and in the source tree."""

STANDARD: Final = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
}
"""Definitions of the common ROS 2 interfaces in the messages of `OWN_PACKAGE`, without their comments."""


@lru_cache
def definition(name: str) -> str:
    """Return the text of a message definition.

    Parameters
    ----------
    name : str
        Type of the message, package/Name. It is read from the installed package (AMENT_PREFIX_PATH), else from the
        Python package or the source tree.

    Raises
    ------
    ConfigError
        There is no such definition.
    """
    if name in STANDARD:
        return STANDARD[name]
    package, _, message = name.partition("/")
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    folders = [prefix / "share" / package / "msg" for prefix in prefixes] + [*_WITHOUT_ROS] * (package == OWN_PACKAGE)
    for folder in folders:
        path = folder / f"{message}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8").rstrip("\n")
    raise ConfigError(f"{name}: no such message definition; is {package} built and sourced?")


@lru_cache
def message_fields(name: str) -> tuple[Field, ...]:
    """Return the fields of a message in their order, without constants.

    Parameters
    ----------
    name : str
        Type of the message, package/Name.

    Raises
    ------
    ConfigError
        There is no such definition, or a field has an unsupported type.
    """
    try:
        return fields(name, definition(name))
    except ValueError as error:
        raise ConfigError(str(error)) from error


def schema_text(name: str) -> str:
    """Return the definition of a message, package/Name, and of all types in it, in the MCAP encoding `ros2msg`."""
    names = [name]
    for known in names:
        for field in message_fields(known):
            if field.type not in PRIMITIVES and field.type not in names:
                names.append(field.type)  # the loop reaches it, too
    return f"\n{RULE}\n".join([definition(name), *(f"MSG: {other}\n{definition(other)}" for other in names[1:])])
