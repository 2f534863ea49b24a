# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The browser view of a running stack, as users start it."""

from __future__ import annotations

import json
import re
import time
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from support.bringup_process import finish, needs_installation, running
from support.expectations import TIMEOUT
from support.long_cases import long_cases
from support.page_stream import first_frame, link_in

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]


def has_contacts(frame: list[dict[str, Any] | None]) -> bool:
    """Return whether the one sensor has valid forces, a contact and its ground truth."""
    (each,) = frame
    return each is not None and all(each[name] for name in ("valid", "contacts", "truth"))


def act(port: int, token: str, action: str, argument: object) -> tuple[int, str]:
    """Return status and text of the answer to an action."""
    connection = HTTPConnection("127.0.0.1", port, timeout=TIMEOUT)
    body = json.dumps({"sensor": "tactile", "action": action, "argument": argument})
    connection.request("POST", "/action", body, {"X-Posfet-Token": token})
    response = connection.getresponse()
    return response.status, response.read().decode()


@pytest.mark.parametrize("composed", long_cases(["true", "false"], ["true"]))
def test_a_stack_is_served_with_its_services(composed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)  # where recordings go
    with running("--web", "scene:=hold", f"composed:={composed}") as process:
        port, token = link_in(process.stdout.readline())
        (frame,) = first_frame(port, token, has_contacts)
        assert frame["total"] == pytest.approx(sum(each["force"] for each in frame["truth"]), abs=0.3)
        assert frame["stamp"] == pytest.approx(time.time() * 1e3, abs=TIMEOUT * 1e3)
        end = time.monotonic() + TIMEOUT
        while (answer := act(port, token, "tare", False))[0] in (404, 504):  # not discovered yet, or no answer in time
            assert time.monotonic() < end
        assert answer[0] == 409
        assert answer[1].startswith("refused under load")
        status, started = act(port, token, "record", True)
        assert status == 200, started
        path = Path(started.removeprefix("recording to "))
        assert path.parent == tmp_path
        while not (path.exists() and path.stat().st_size > 10_000):
            assert time.monotonic() < end
            time.sleep(0.02)
        status, summary = act(port, token, "record", False)
        assert status == 200
        assert re.search(r"\.mcap: [\d.]+ s, \d+ messages of [34] topics", summary), summary
        assert re.search(r"posfet: .* scans/s", finish(process))
