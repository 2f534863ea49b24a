# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Let colcon build against the ROS 2 wheels of this virtual environment.

Their CMake exports and parent_prefix_path entries have the paths of the Python that built them; this replaces these
paths with those of the virtual environment. Running it twice changes nothing more.
"""

from __future__ import annotations

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

BUILD_PREFIX = r"/opt/python/cp3\d+-cp3\d+"


def main() -> int:
    """Rewrite the files below sys.prefix/share and print the number of changed files."""
    prefix = Path(sys.prefix)
    replacements = [
        (rf"{BUILD_PREFIX}/include/python3\.\d+", sysconfig.get_path("include")),
        (rf"{BUILD_PREFIX}/lib/python3\.\d+/site-packages/numpy/_?core/include", np.get_include()),
        (BUILD_PREFIX, str(prefix)),
    ]
    candidates = [
        *prefix.glob("share/*/cmake/*.cmake"),
        *prefix.glob("share/ament_index/resource_index/parent_prefix_path/*"),
    ]
    changed = 0
    for path in candidates:
        text = path.read_text(encoding="utf-8")
        moved = text
        for pattern, replacement in replacements:
            moved = re.sub(pattern, lambda _, to=replacement: to, moved)
        if moved != text:
            path.unlink()  # not in place: the installer's cache may have the same file under another name
            path.write_text(moved, encoding="utf-8")
            changed += 1
    print(f"      {changed} CMake files of the ROS 2 wheels now point at {prefix.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
