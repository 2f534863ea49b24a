# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Settings of Fast DDS for the nodes of this stack, so that a new subscriber has data at once (docs/integration.md)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rclpy.utilities import get_rmw_implementation_identifier

PROFILES: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable with the path of the settings; a value set by the user is kept."""
NETWORK: Final = Path(__file__).with_name("middleware.xml")
LOCALHOST: Final = Path(__file__).with_name("middleware_localhost.xml")

_RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_EXTENDING: Final = ("ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY")
"""Environment variables with which the range is not that of `_RANGE` alone."""


def settings(environment: Mapping[str, str], fast_dds_2: bool) -> dict[str, str]:
    """Return the environment variables to set while rclpy starts.

    With the range LOCALHOST, rmw_fastrtps adds its shared-memory transport to any settings. `LOCALHOST` has all that
    it adds but that, and counts in full only if the range is left to the middleware.

    Parameters
    ----------
    environment : mapping of str to str
        Environment of the process.
    fast_dds_2 : bool
        Whether the middleware is Fast DDS 2, which reads `PROFILES`; then the range may be left to it.

    Returns
    -------
    dict of str to str
        Values by name; none if the user has settings.
    """
    given = environment.get(PROFILES)
    if given and not _is_of_this_stack(Path(given)):
        return {}
    local = environment.get(_RANGE) == "LOCALHOST" and not any(environment.get(name) for name in _EXTENDING)
    if fast_dds_2 and local and LOCALHOST.is_file():
        return {PROFILES: str(LOCALHOST), _RANGE: "SYSTEM_DEFAULT"}
    return {PROFILES: str(NETWORK)}


def _is_of_this_stack(path: Path) -> bool:
    """Return whether a parent process of this stack has set the path; its installation may be another one."""
    return path.name in {NETWORK.name, LOCALHOST.name} and path.parts[-3:-1] == NETWORK.parts[-3:-1]


def _fast_dds_2() -> bool:
    """Return whether the middleware that rclpy has loaded is Fast DDS 2; the library of version 3 has another name."""
    maps = Path("/proc/self/maps")
    return "fastrtps" in get_rmw_implementation_identifier() and maps.is_file() and "libfastrtps.so" in maps.read_text()


@contextmanager
def applied() -> Iterator[None]:
    """Start rclpy in this block with the settings; the environment keeps `PROFILES`, which the first node reads."""
    chosen = settings(os.environ, _fast_dds_2())
    before = os.environ.get(_RANGE)
    os.environ.update(chosen)
    try:
        yield
    finally:
        if before is not None:
            os.environ[_RANGE] = before
