# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Write what the dependencies of the packages resolve to on Ubuntu 24.04: `tools/rosdep_keys.py FOLDER`.

FOLDER is a clone of the repository rosdistro of GitHub's organisation ros. The result is reference data of the tests.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import yaml

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "test/data/release/rosdep_keys.yaml"


def main(rosdistro: str) -> int:
    """Write the file; return 1, with one line, if a key is unknown."""

    def read(name: str) -> dict:
        command = ["git", "-C", rosdistro, "show", f"HEAD:{name}"]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))

    system = read("rosdep/base.yaml") | read("rosdep/python.yaml")
    repositories = read("jazzy/distribution.yaml")["repositories"]
    released = {
        package
        for name, repository in repositories.items()
        for package in repository.get("release", {}).get("packages", [name] if "release" in repository else [])
    }
    manifests = list(ROOT.glob("src/*/package.xml"))
    own = {path.parent.name for path in manifests}
    keys = {
        each.text for path in manifests for each in ElementTree.parse(path).getroot() if each.tag.endswith("depend")
    }
    found = {}
    for key in sorted(keys - own):
        ubuntu = system.get(key, {}).get("ubuntu")
        packages = ubuntu.get("noble", ubuntu.get("*")) if isinstance(ubuntu, dict) else ubuntu
        if key in released:
            found[key] = f"ros-jazzy-{key.replace('_', '-')}"
        elif isinstance(packages, list):
            found[key] = " ".join(packages)
        else:  # unknown, or only from pip, which a released package must not need
            print(f"{key}: no package of Ubuntu 24.04 or ROS 2 Jazzy", file=sys.stderr)
            return 1
    date = subprocess.run(
        ["git", "-C", rosdistro, "log", "-1", "--format=%cs"], check=True, capture_output=True, text=True
    ).stdout.strip()
    rows = "".join(f"{key}: {package}\n" for key, package in found.items())
    RESULT.write_text(f"# Made by tools/rosdep_keys.py from rosdistro of {date}: keys and packages.\n{rows}", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
