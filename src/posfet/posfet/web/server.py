# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""HTTP server of the browser view: the page, the stream of snapshots as Server-Sent Events, and the services."""

from __future__ import annotations

import json
import socket
import sys
import threading
from collections.abc import Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Final, cast
from urllib.parse import parse_qs, urlsplit

from posfet.web.feed import Feed
from posfet.web.requests import TOKEN_HEADER, Guard
from posfet.web.sampler import Sampler
from posfet.web.viewed import Recordings, Viewed
from posfet_model.config import ConfigError

ADDRESS: Final = "127.0.0.1"
MOST_STREAMS: Final = 8
"""Greatest number of pages that are served at a time."""
MOST_CONNECTIONS: Final = 32
"""Greatest number of connections at a time; more are closed at once."""
STALLED: Final = 10.0
"""Time after which a client that neither sends nor receives is dropped [s]."""
ANSWER_TIMEOUT: Final = 10.0
"""Time for the answer of a service [s]."""
KEEP_ALIVE: Final = 5.0
"""Time without news after which an empty comment is sent [s], so that a dead connection is noticed."""
SEND_BUFFER: Final = 65536
"""Bytes that the kernel keeps for a client: a slow one is dropped frames for, rather than shown old ones."""
LONGEST_REQUEST: Final = 4096
"""Most bytes of a request's body."""
_TYPES: Final = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
_POLICY: Final = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'"


class WebServer(ThreadingHTTPServer):
    """Serves sensors on this machine until it is closed; a context manager.

    Parameters
    ----------
    sensors : sequence of Viewed
        Sensors in the order of the page.
    token : str
        Secret in the link.
    port : int, optional
        Port; 0: any free one.
    scenes : sequence of str, optional
        Names of the scenes that the page offers.

    Raises
    ------
    OSError
        If the port is in use.
    """

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = MOST_CONNECTIONS

    def __init__(self, sensors: Sequence[Viewed], token: str, port: int = 0, scenes: Sequence[str] = ()) -> None:
        super().__init__((ADDRESS, port), Handler)
        self.sensors = {each.client.namespace: each for each in sensors}
        self.guard = Guard(self.server_address[1], token)
        page = files(__package__) / "page"
        self.page = {f"/{entry.name}": entry.read_bytes() for entry in page.iterdir() if entry.is_file()}
        """Files of the page by path, all that can be asked for."""
        self.page["/"] = self.page["/index.html"]
        self.feed = Feed()
        self._room = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self._sampler = Sampler(sensors, scenes, self.feed)
        self._thread = threading.Thread(target=self.serve_forever, args=(0.1,), name="web server", daemon=True)
        self._thread.start()

    @property
    def link(self) -> str:
        """Link to the page, with the token."""
        return f"http://{self.guard.hosts[0]}/?token={self.guard.token}"

    def close(self) -> None:
        """End all streams and give the port back."""
        self._sampler.close()
        self.shutdown()
        self._thread.join()
        self.server_close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Handle a connection in a thread of its own, if there is room."""
        if self._room.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Handle a connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore clients that went away; report all else."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """One connection."""

    timeout = STALLED
    server_version = "posfet"
    sys_version = ""

    @property
    def _web(self) -> WebServer:
        return cast(WebServer, self.server)

    def do_GET(self) -> None:
        """Send a file of the page, or the stream."""
        try:
            parts = urlsplit(self.path)
        except ValueError:  # an address that is none
            self._answer(HTTPStatus.BAD_REQUEST, "malformed request")
            return
        token = parse_qs(parts.query).get("token", [""])[0]
        streaming = parts.path == "/stream"
        if self._refused(token, streaming):
            return
        if streaming:
            self._stream()
        elif parts.path in self._web.page:
            kind = _TYPES[(parts.path if parts.path != "/" else "index.html").rsplit(".", 1)[-1]]
            self._send(HTTPStatus.OK, self._web.page[parts.path], f"{kind}; charset=utf-8")
        else:
            self._answer(HTTPStatus.NOT_FOUND, "no such page")

    def do_POST(self) -> None:
        """Call a service of a sensor."""
        if self._refused(self.headers.get(TOKEN_HEADER, ""), True):
            return
        if self.path != "/action":
            self._answer(HTTPStatus.NOT_FOUND, "no such page")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > LONGEST_REQUEST:
            self._answer(HTTPStatus.BAD_REQUEST, "malformed request")
            return
        try:
            wanted = json.loads(self.rfile.read(int(length)))
            sensor, action, argument = (wanted[name] for name in ("sensor", "action", "argument"))
            viewed = self._web.sensors[sensor]
        except (ValueError, KeyError, TypeError):
            self._answer(HTTPStatus.BAD_REQUEST, "malformed request")
            return
        if action not in viewed.actions():
            self._answer(HTTPStatus.NOT_FOUND, "nobody serves this: is the stack still running?")
            return
        if isinstance(argument, bool) != (action in {"tare", "record"}) or not isinstance(argument, (bool, str)):
            self._answer(HTTPStatus.BAD_REQUEST, "malformed request")
            return
        if action == "record" and viewed.recordings is not None:
            self._record(viewed.recordings, bool(argument))
        else:
            self._call(viewed, action, argument)

    def log_message(self, *_: object) -> None:
        """Log nothing: there is one line for each request, and a display on the terminal."""

    def _call(self, viewed: Viewed, action: str, argument: str | bool) -> None:
        answered = threading.Event()
        answer: list[tuple[bool, str]] = []

        def done(success: bool, message: str) -> None:
            answer.append((success, message))
            answered.set()

        viewed.client.request(action, argument, done)
        if not answered.wait(ANSWER_TIMEOUT):
            self._answer(HTTPStatus.GATEWAY_TIMEOUT, f"no answer within {ANSWER_TIMEOUT:.0f} s")
            return
        success, message = answer[0]
        self._answer(HTTPStatus.OK if success else HTTPStatus.CONFLICT, message)

    def _record(self, recordings: Recordings, wanted: bool) -> None:
        try:
            self._answer(HTTPStatus.OK, recordings.start() if wanted else recordings.stop())
        except ConfigError as error:
            self._answer(HTTPStatus.CONFLICT, str(error))

    def _stream(self) -> None:
        feed = self._web.feed
        if not feed.enter(MOST_STREAMS):
            self._answer(HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_STREAMS} pages are open already: close one")
            return
        try:
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
            self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._begin(HTTPStatus.OK, "text/event-stream", None)
            self.wfile.write(b"retry: 500\n\n")
            seen: dict[str, int] = {}
            while not feed.closed:
                found = feed.newer(seen, KEEP_ALIVE)
                seen.update({kind: version for kind, (version, _) in found.items()})
                # The setup first: a page cannot draw without it.
                events = [b"event: %s\ndata: %s\n\n" % (kind.encode(), found[kind][1]) for kind in sorted(found)[::-1]]
                self.wfile.write(b"".join(events) or b": alive\n\n")
        except OSError:
            pass  # the client went away, or stalled
        finally:
            feed.leave()

    def _refused(self, token: str, token_needed: bool) -> bool:
        """Answer a request that is refused; return whether it is."""
        headers = {name.title(): value for name, value in self.headers.items()}
        reason = self._web.guard.refusal(headers, token, token_needed)
        if reason:
            self._answer(HTTPStatus.FORBIDDEN, reason)
        return bool(reason)

    def _answer(self, status: HTTPStatus, text: str) -> None:
        self._send(status, text.encode(), "text/plain; charset=utf-8")

    def _send(self, status: HTTPStatus, content: bytes, kind: str) -> None:
        self._begin(status, kind, len(content))
        self.wfile.write(content)

    def _begin(self, status: HTTPStatus, kind: str, length: int | None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("X-Frame-Options", "DENY")
        self.end_headers()
