# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The link to the browser view: the same after a restart, so that an open page finds the stack again."""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

from posfet.private_folder import private_folder
from posfet.web.viewed import Viewed
from posfet_model.config import ConfigError, read_text
from posfet_sim.scene import SCENE_FOLDER

_TOKEN: Final = re.compile(r"[A-Za-z0-9_-]{22,64}")


@contextmanager
def served(sensors: Sequence[Viewed], scenes: Sequence[str] = (), port: int = 0) -> Iterator[str]:
    """Serve sensors within the block, print the link, and open it in a browser if there is a desktop.

    Parameters
    ----------
    sensors : sequence of Viewed
        Sensors in the order of the page.
    scenes : sequence of str, optional
        Names of the scenes that the page offers.
    port : int, optional
        Port; 0: the one of the last time if it is free, else any.

    Yields
    ------
    str
        The link.

    Raises
    ------
    ConfigError
        One line, if the port is in use.
    """
    from posfet.web.server import ADDRESS, WebServer  # noqa: PLC0415  # a start without a page needs no HTTP

    path = private_folder() / f"web-{'+'.join(each.client.namespace for each in sensors).replace('/', '-')[:100]}.json"
    last_port, token = _remembered(path)
    try:
        server = WebServer(sensors, token, port or last_port, scenes)
    except OSError as error:
        if port:
            raise ConfigError(f"--web-port: {ADDRESS}:{port} cannot be used: {error.strerror}; use another") from error
        server = WebServer(sensors, token, 0, scenes)
    with server:
        if not port:
            _remember(path, server.guard.port, token)
        print(f"posfet: in a browser on this machine: {server.link}", flush=True)
        if sys.stdout.isatty():
            _open(server.link)
        try:
            yield server.link
        finally:
            _end_recordings(sensors)


def _end_recordings(sensors: Sequence[Viewed]) -> None:
    for each in sensors:
        if each.recordings is not None and each.recordings.running:
            try:
                print(each.recordings.stop())
            except ConfigError as error:
                print(error, file=sys.stderr)


def served_link(stack: ExitStack, sensors: Sequence[Viewed], port: int | None) -> str:
    """Serve sensors until the end of a stack of contexts, and return the link; '' without a port.

    Parameters
    ----------
    stack : ExitStack
        Ends the server before what was entered earlier.
    sensors : sequence of Viewed
        Sensors in the order of the page.
    port : int, optional
        Port, see `served`; None: nothing is served.
    """
    if port is None:
        return ""
    scenes = sorted(path.stem for path in SCENE_FOLDER.glob("*.yaml"))
    return stack.enter_context(served(sensors, scenes, port))


def _remembered(path: Path) -> tuple[int, str]:
    """Return port and token of the last time; 0 and a new token if there was none."""
    try:
        known = json.loads(read_text(path))
        port, token = known["port"], known["token"]
    except (ConfigError, ValueError, KeyError, TypeError):
        return 0, secrets.token_urlsafe()
    if not (isinstance(port, int) and 0 < port < 65536 and isinstance(token, str) and _TOKEN.fullmatch(token)):
        return 0, secrets.token_urlsafe()
    return port, token


def _remember(path: Path, port: int, token: str) -> None:
    """Write port and token, for this user only."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o600)
        with open(descriptor, "w", encoding="utf-8") as file:
            os.fchmod(descriptor, 0o600)
            json.dump({"port": port, "token": token}, file)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; remove it") from error


def _open(link: str) -> None:
    """Open the link, if this is a desktop."""
    opener = shutil.which("xdg-open")
    if opener and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        quiet = subprocess.DEVNULL
        subprocess.Popen([opener, link], stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)
