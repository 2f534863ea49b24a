# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The chip in space, run by Node.js without a browser."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from support.paths import SOURCES

NODE = shutil.which("node")
MODULE = SOURCES / "posfet" / "posfet" / "web" / "page" / "chip_3d.js"

pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js is missing: apt-get install nodejs")


def test_a_chip_that_is_not_known_yet_is_prepared_without_an_error() -> None:
    """As when the browser gives back the graphics processor before the first message of the sensor."""
    script = (
        f"const {{ Chip3d }} = await import({json.dumps(MODULE.as_uri())}); Chip3d.prototype.prepare.call({{}}, null)"
    )
    run = subprocess.run([str(NODE), "--input-type=module", "-e", script], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
