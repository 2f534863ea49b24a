# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Functions of rcl that publish serialised messages, for compiled code.

rclpy has them loaded, whether from .venv or a sourced ROS 2; nothing is linked to a second copy.
"""

from __future__ import annotations

import ctypes
from typing import Final, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation

PUBLISH: Final = "rcl_publish_serialized_message"
RESET_ERROR: Final = "rcutils_reset_error"


class RclFunctions(NamedTuple):
    """Addresses of functions."""

    publish: int
    reset_error: int


def rcl_functions() -> RclFunctions | None:
    """Return the functions that rclpy itself calls, or None where its extension does not lead to them."""
    try:
        library = ctypes.CDLL(rclpy_implementation.__file__)
        return RclFunctions(_address(library, PUBLISH), _address(library, RESET_ERROR))
    except (OSError, AttributeError):
        return None


def _address(library: ctypes.CDLL, name: str) -> int:
    return ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
