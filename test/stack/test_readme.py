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
