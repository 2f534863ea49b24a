# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Headless Chromium for tests and screenshots, by the DevTools protocol through a pair of pipes; needs no package."""

from __future__ import annotations

import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
"""Path of the browser; None where there is none."""
TIMEOUT = 120.0
"""Time-out for whatever a test waits for [s]; a machine with nothing else to do needs a fraction of a second."""
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--force-color-profile=srgb",
    "--remote-debugging-pipe",
)
_KEYS = {" ": (32, "Space"), "ArrowRight": (39, "ArrowRight"), "ArrowUp": (38, "ArrowUp"), "Tab": (9, "Tab")}
"""Codes of keys without a letter."""


class Page:
    """One page in a browser of its own."""

    def __init__(self, commands: int, replies: int) -> None:
        self._commands, self._replies = commands, replies
        self._number = 0
        self._buffer = b""
        self._session = ""
        self.errors: list[str] = []
        """Errors of the console and of scripts since the start."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            reply = self._next()
            if reply.get("id") == self._number:
                assert "error" not in reply, reply
                return reply["result"]

    def open(self, link: str, width: int = 1280, height: int = 900, dark: bool = True, scale: float = 1.0) -> None:
        """Open a link at a size of the window in CSS pixels."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=False
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Page.navigate", url=link)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait(self, expression: str) -> Any:
        """Return the value of an expression once it is true; fail after `TIMEOUT`."""
        end = time.monotonic() + TIMEOUT
        value = self.evaluate(f"(() => {{ try {{ return {expression} }} catch {{ return null }} }})()")
        while not value:
            assert time.monotonic() < end, f"{expression} is still {value!r}; errors: {self.errors}"
            select.select([self._replies], [], [], 0.02)
            value = self.evaluate(f"(() => {{ try {{ return {expression} }} catch {{ return null }} }})()")
        return value

    def press(self, key: str) -> None:
        """Press and release a key."""
        code, name = _KEYS.get(key, (ord(key.upper()[0]), f"Key{key.upper()}"))
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=name, windowsVirtualKeyCode=code, **text)

    def screenshot(self, path: str | Path) -> None:
        """Write what is visible as a PNG file."""
        Path(path).write_bytes(b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def _next(self) -> dict[str, Any]:
        """Return the next message; take note of errors."""
        end = time.monotonic() + TIMEOUT
        while b"\0" not in self._buffer:
            assert select.select([self._replies], [], [], max(end - time.monotonic(), 0.0))[0], "the browser is silent"
            received = os.read(self._replies, 1 << 20)
            assert received, "the browser has ended"
            self._buffer += received
        text, self._buffer = self._buffer.split(b"\0", 1)
        message: dict[str, Any] = json.loads(text)
        method, details = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(str(details["exceptionDetails"]))
        elif method == "Log.entryAdded" and details["entry"]["level"] == "error":
            self.errors.append(details["entry"]["text"])
        elif method == "Runtime.consoleAPICalled" and details["type"] in {"error", "assert"}:
            self.errors.append(str(details["args"]))
        return message


@contextmanager
def browser() -> Iterator[Page]:
    """Start Chromium, and end it after the block."""
    assert CHROMIUM, "chromium is missing"
    ours, theirs = os.pipe(), os.pipe()
    # The browser reads commands from descriptor 3 and replies on 4: first away from those numbers.
    ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (ours[0], theirs[1])]

    def pass_on() -> None:
        os.dup2(ends[0], 3)
        os.dup2(ends[1], 4)

    with tempfile.TemporaryDirectory(prefix="posfet-browser-", ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [CHROMIUM, *FLAGS, f"--user-data-dir={profile}"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            preexec_fn=pass_on,  # noqa: PLW1509  # makes two system calls and nothing else
            pass_fds=(3, 4),
            start_new_session=True,
        )
        for end in (ours[0], theirs[1], *ends):
            os.close(end)
        try:
            yield Page(ours[1], theirs[0])
        finally:
            process.kill()
            process.wait()
            os.close(ours[1])
            os.close(theirs[0])
