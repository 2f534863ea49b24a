# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The subscriber in the README works as printed."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from support.bringup_process import needs_installation, running
from support.expectations import TIMEOUT
from support.paths import ROOT

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

README = ROOT / "README.md"


def test_the_readme_subscriber_prints_contacts() -> None:
    program, _ = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(program.splitlines()) == 15
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with running("source:=sim"):
        command = [sys.executable, "-c", program]
        listener = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        try:
            assert select.select([listener.stdout], [], [], TIMEOUT)[0], "no contact was printed"
            line = listener.stdout.readline()
        finally:
            listener.send_signal(signal.SIGKILL)
            listener.communicate()
    assert re.fullmatch(r"#\d+: -?\d\.\d\d N at \([+-]\d\.\d\d, [+-]\d\.\d\d\) mm\n", line), line
