# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a page of the browser view receives, for tests without a browser."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from http.client import HTTPConnection
from typing import Any

from support.expectations import TIMEOUT


def link_in(text: str) -> tuple[int, str] | None:
    """Return port and token of the link in a text, None without one."""
    found = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", text)
    return (int(found[1]), found[2]) if found else None


def frames(port: int, token: str) -> Iterator[list[dict[str, Any] | None]]:
    """Yield the frames of a stream: for each sensor the newest, None before its first."""
    connection = HTTPConnection("127.0.0.1", port, timeout=TIMEOUT)
    try:
        connection.request("GET", f"/stream?token={token}")
        response = connection.getresponse()
        assert response.status == 200
        kind = ""
        while line := response.readline().decode():
            name, _, value = line.partition(": ")
            kind = value.strip() if name == "event" else kind
            if name == "data" and kind == "frame":
                yield json.loads(value)
    finally:
        connection.close()


def first_frame(port: int, token: str, wanted: Callable[[list[dict[str, Any] | None]], Any]) -> list[dict[str, Any]]:
    """Return the first frame of a stream for which `wanted` is true; fail after TIMEOUT."""
    end = time.monotonic() + TIMEOUT
    for frame in frames(port, token):
        if wanted(frame):
            return frame
        assert time.monotonic() < end, frame
    raise AssertionError("the stream has ended")
