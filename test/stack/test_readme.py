# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The subscriber in README.md, which first-contact.md starts, works as printed."""

from __future__ import annotations

import os
import re
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

LISTENER = ROOT / "examples" / "listener.py"


def test_the_listener_prints_contacts_and_ends_cleanly() -> None:
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with running("source:=sim"):
        listener = subprocess.Popen([sys.executable, str(LISTENER)], stderr=subprocess.PIPE, text=True, env=environment)
        try:
            lines = iter(listener.stderr.readline, "")
            line = next(line for line in lines if "#" in line)
        finally:
            listener.send_signal(signal.SIGINT)
            _, errors = listener.communicate(timeout=TIMEOUT)
    assert re.search(r": #\d+: -?\d\.\d\d N at \([+-]\d\.\d\d, [+-]\d\.\d\d\) mm", line), line
    assert listener.returncode == 0, errors
    assert "Traceback" not in errors, errors
