# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The server of the browser view, with a plain HTTP client."""

from __future__ import annotations

import json
import math
import socket
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import replace
from http.client import HTTPConnection, HTTPResponse
from typing import Any

import numpy as np
import pytest

from posfet.diagnosis import Diagnosis
from posfet.web import server as web_server
from posfet.web.server import MOST_STREAMS, WebServer
from support.web_sensors import SNAPSHOT, TOKEN, FakeRecordings, FakeSensor

TIMEOUT = 60.0


@pytest.fixture
def sensor() -> FakeSensor:
    return FakeSensor()


@pytest.fixture
def server(sensor: FakeSensor) -> Iterator[WebServer]:
    with WebServer([sensor.viewed], TOKEN, scenes=["press", "hold"]) as made:
        yield made


def ask(
    server: WebServer, path: str, body: Any = None, headers: dict[str, str] | None = None, method: str = ""
) -> HTTPResponse:
    """Return the response to one request, with the headers of the page unless given otherwise."""
    connection = HTTPConnection("127.0.0.1", server.guard.port, timeout=TIMEOUT)
    text = body if body is None or isinstance(body, str) else json.dumps(body)
    connection.request(method or ("GET" if body is None else "POST"), path, text, headers or {})
    return connection.getresponse()


def events(response: HTTPResponse) -> Iterator[tuple[str, Any]]:
    """Yield kind and content of each event of a stream."""
    kind = ""
    while line := response.readline():
        name, _, value = line.decode().rstrip("\n").partition(": ")
        if name == "event":
            kind = value
        elif name == "data":
            yield kind, json.loads(value)


def stream(server: WebServer) -> Iterator[tuple[str, Any]]:
    return events(ask(server, f"/stream?token={TOKEN}"))


def first(found: Iterator[tuple[str, Any]], wanted: str) -> Any:
    return next(content for kind, content in found if kind == wanted)


def floats(text: str) -> list[float]:
    return np.frombuffer(b64decode(text), "<f4").tolist()


def test_what_is_streamed_equals_the_snapshot(server: WebServer) -> None:
    found = stream(server)
    kind, setup = next(found)
    assert kind == "setup"  # the page cannot draw without it
    assert setup["sensors"][0]["namespace"] == "tactile"
    assert setup["sensors"][0]["array"]["cols"] == 3
    assert setup["sensors"][0]["array"]["bend_radius"] is None
    assert setup["scenes"] == ["press", "hold"]
    assert setup["statuses"]["1"] == "dead"
    (frame,) = first(found, "frame")
    np.testing.assert_array_equal(floats(frame["force"]), SNAPSHOT.force)
    np.testing.assert_array_equal(floats(frame["deviation"]), SNAPSHOT.standard_deviation)
    assert list(b64decode(frame["status"])) == [0, 0, 3, 0, 1, 0]
    assert (frame["total"], frame["total_deviation"], frame["valid"]) == (1.25, 0.016, True)
    assert (frame["scans"], frame["frames_lost"], frame["scans_lost"]) == (1000, 3, 2)
    assert frame["stamp"] == pytest.approx(SNAPSHOT.stamp * 1e-6)
    assert frame["contacts"] == [
        {
            "id": 7,
            "state": "moving",
            "x": 1e-3,
            "y": -0.5e-3,
            "force": 1.25,
            "deviation": 0.004,
            "area": 9e-6,
            "age": 2.5,
            "major": [0.6e-3, 0.0],
            "minor": [0.0, 0.5e-3],
            "velocity": [0.02, 0.0],
        }
    ]
    assert frame["truth"] == [{"x": 1.03e-3, "y": -0.46e-3, "force": 1.25}]


def test_what_is_unknown_is_null_and_never_zero(sensor: FakeSensor, server: WebServer) -> None:
    contact = replace(SNAPSHOT.contacts[0], standard_deviation=math.nan, velocity=(math.nan, math.nan))
    sensor.shown = replace(
        SNAPSHOT, total_force=math.nan, standard_deviation=None, data_valid=False, contacts=(contact,)
    )
    (frame,) = first(stream(server), "frame")
    assert frame["total"] is None
    assert frame["contacts"][0]["deviation"] is None
    assert frame["contacts"][0]["velocity"] == [None, None]
    assert all(map(math.isnan, floats(frame["deviation"])))


def test_before_the_first_scan_there_is_a_page_without_values(sensor: FakeSensor, server: WebServer) -> None:
    sensor.array = sensor.shown = None
    found = stream(server)
    assert first(found, "setup")["sensors"] == [{"namespace": "tactile", "array": None}]
    assert first(found, "frame") == [None]


def test_diagnostics_say_what_to_do(sensor: FakeSensor, server: WebServer) -> None:
    values = {"fault: no traffic": "there is no signal on the bus; check cable", "frames lost": "0"}
    sensor.diagnoses = {"driver_node: board": Diagnosis("driver_node: board", 2, "no traffic", values)}
    (found,) = first(stream(server), "diagnostics")
    assert found["actions"] == ["tare", "scene/load"]
    assert found["nodes"][0]["remedies"] == {"no traffic": "there is no signal on the bus; check cable"}
    assert found["nodes"][0]["level"] == 2


def test_several_sensors_are_side_by_side() -> None:
    sensors = [FakeSensor("hand/thumb"), FakeSensor("hand/palm", shown=None)]
    with WebServer([each.viewed for each in sensors], TOKEN) as server:
        found = stream(server)
        assert [each["namespace"] for each in first(found, "setup")["sensors"]] == ["hand/thumb", "hand/palm"]
        thumb, palm = first(found, "frame")
        assert (thumb["total"], palm) == (1.25, None)
        headers = {"X-Posfet-Token": TOKEN}
        ask(server, "/action", {"sensor": "hand/palm", "action": "tare", "argument": False}, headers)
    assert (sensors[0].requests, sensors[1].requests) == ([], [("tare", False)])


def test_every_file_of_the_page_is_served_with_its_type(server: WebServer) -> None:
    for path, kind in (("/", "text/html"), ("/main.js", "text/javascript"), ("/style.css", "text/css")):
        response = ask(server, path)
        assert response.status == 200
        assert response.getheader("Content-Type", "").startswith(kind)
        assert "default-src 'none'" in response.getheader("Content-Security-Policy", "")
        assert len(response.read()) > 100
    assert ask(server, "/../server.py").status == 404
    assert ask(server, "/nothing").status == 404


@pytest.mark.parametrize(
    ("host", "status"),
    [("127.0.0.1:{port}", 200), ("localhost:{port}", 200), ("evil.example:{port}", 403), ("127.0.0.1", 403), ("", 403)],
)
def test_only_this_machine_is_a_host(server: WebServer, host: str, status: int) -> None:
    response = ask(server, "/", headers={"Host": host.format(port=server.guard.port)})
    assert response.status == status


TARE = {"sensor": "tactile", "action": "tare", "argument": False}


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"X-Posfet-Token": TOKEN}, 200),
        ({"X-Posfet-Token": TOKEN, "Origin": "http://127.0.0.1:{port}"}, 200),
        ({"X-Posfet-Token": TOKEN, "Origin": "http://evil.example"}, 403),
        ({"X-Posfet-Token": TOKEN, "Origin": "null"}, 403),
        ({"X-Posfet-Token": TOKEN, "Host": "evil.example:{port}"}, 403),
        ({"X-Posfet-Token": "wrong"}, 403),
        ({}, 403),
    ],
)
def test_changes_need_the_token_and_the_same_origin(
    sensor: FakeSensor, server: WebServer, headers: dict[str, str], status: int
) -> None:
    sent = {name: value.format(port=server.guard.port) for name, value in headers.items()}
    response = ask(server, "/action", TARE, sent)
    assert response.status == status
    assert sensor.requests == ([("tare", False)] if status == 200 else [])


def test_the_stream_needs_the_token(sensor: FakeSensor, server: WebServer) -> None:
    assert ask(server, "/stream").status == 403
    assert ask(server, "/stream?token=wrong").status == 403
    assert sensor.taken == 0


def test_the_answer_of_a_service_is_passed_on(server: WebServer) -> None:
    headers = {"X-Posfet-Token": TOKEN}
    request = {"sensor": "tactile", "action": "scene/load", "argument": "press"}
    response = ask(server, "/action", request, headers)
    assert (response.status, response.read()) == (200, b"scene/load done")
    assert ask(server, "/action", {**request, "argument": "nowhere"}, headers).status == 409


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ("[]", 400),
        ("{", 400),
        ('{"sensor": "tactile"}', 400),
        ({"sensor": "other", "action": "tare", "argument": False}, 400),
        ({"sensor": "tactile", "action": "tare", "argument": "yes"}, 400),
        ({"sensor": "tactile", "action": "scene/load", "argument": 3}, 400),
        ({"sensor": "tactile", "action": "calibration/load", "argument": "c.yaml"}, 404),
        ("x" * 5000, 400),
    ],
)
def test_malformed_requests_are_refused(sensor: FakeSensor, server: WebServer, body: Any, status: int) -> None:
    assert ask(server, "/action", body, {"X-Posfet-Token": TOKEN}).status == status
    assert sensor.requests == []
    assert ask(server, "/other", TARE, {"X-Posfet-Token": TOKEN}).status == 404


def test_a_recording_is_started_once_and_stopped(sensor: FakeSensor) -> None:
    headers, request = {"X-Posfet-Token": TOKEN}, {"sensor": "tactile", "action": "record", "argument": True}
    with WebServer([sensor.viewed], TOKEN) as server:  # without a recorder there is nothing to press
        assert ask(server, "/action", request, headers).status == 404
    sensor.recordings = FakeRecordings()
    with WebServer([sensor.viewed], TOKEN) as server:
        found = stream(server)
        (before,) = first(found, "diagnostics")
        assert (before["recording"], before["actions"]) == (False, ["tare", "scene/load", "record"])
        response = ask(server, "/action", request, headers)
        assert (response.status, response.read()) == (200, b"recording to thumb.mcap")
        assert first(found, "diagnostics")[0]["recording"]
        assert ask(server, "/action", request, headers).status == 409
        response = ask(server, "/action", {**request, "argument": False}, headers)
        assert (response.status, response.read()) == (200, b"thumb.mcap: 2.0 s, 40 messages")
        assert ask(server, "/action", {**request, "argument": "yes"}, headers).status == 400


def test_a_service_that_does_not_answer_is_reported(
    sensor: FakeSensor, server: WebServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_server, "ANSWER_TIMEOUT", 0.01)
    monkeypatch.setattr(sensor, "request", lambda *_: None)
    response = ask(server, "/action", TARE, {"X-Posfet-Token": TOKEN})
    assert (response.status, response.read()) == (504, b"no answer within 0 s")


def test_a_stalled_client_holds_up_nobody(sensor: FakeSensor, server: WebServer) -> None:
    """One client reads nothing; another one gets new frames, far more than the kernel keeps for the first."""
    force = np.linspace(0, 1, 64 * 64, dtype=np.float32)
    sensor.shown = replace(SNAPSHOT, rows=64, cols=64, force=force, standard_deviation=force, status=None)
    stalled = socket.create_connection(("127.0.0.1", server.guard.port), timeout=TIMEOUT)
    stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    host = server.guard.hosts[0]
    stalled.sendall(f"GET /stream?token={TOKEN} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    frames = (frame for kind, (frame, *_) in stream(server) if kind == "frame")
    sequences = [next(frames)["sequence"] for _ in range(12)]
    assert sequences == sorted(set(sequences))
    assert server.feed.readers == 2
    stalled.close()


def test_the_number_of_pages_is_limited(server: WebServer) -> None:
    open_pages = [stream(server) for _ in range(MOST_STREAMS)]
    assert [next(page)[0] for page in open_pages] == ["setup"] * MOST_STREAMS
    response = ask(server, f"/stream?token={TOKEN}")
    assert response.status == 503
    assert b"pages are open already" in response.read()


def test_connections_that_ask_for_nothing_are_limited(server: WebServer, monkeypatch: pytest.MonkeyPatch) -> None:
    address = ("127.0.0.1", server.guard.port)
    idle = [socket.create_connection(address, timeout=TIMEOUT) for _ in range(web_server.MOST_CONNECTIONS)]
    with socket.create_connection(address, timeout=TIMEOUT) as late:
        assert late.recv(1) == b""
    for each in idle:
        each.close()


def test_snapshots_are_taken_only_while_somebody_looks(sensor: FakeSensor, server: WebServer) -> None:
    assert ask(server, "/").status == 200
    assert sensor.taken == 0
    assert first(stream(server), "frame")
    assert sensor.taken > 0


def test_a_stream_goes_on_after_a_restart(sensor: FakeSensor) -> None:
    with WebServer([sensor.viewed], TOKEN) as server:
        port = server.guard.port
        found = stream(server)
        assert first(found, "frame")
    assert all(kind for kind, _ in found)  # it ends, and does not raise
    with WebServer([sensor.viewed], TOKEN, port) as again:
        assert again.link == f"http://127.0.0.1:{port}/?token={TOKEN}"
        assert first(stream(again), "frame")


def test_an_address_that_is_none_is_refused(server: WebServer) -> None:
    response = ask(server, "http://[", headers={"Host": f"127.0.0.1:{server.guard.port}"})
    assert (response.status, response.read()) == (400, b"malformed request")
