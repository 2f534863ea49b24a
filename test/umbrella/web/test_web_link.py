# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from __future__ import annotations

import argparse
import socket
from pathlib import Path

import pytest

from posfet.web.link import served
from posfet.web.options import add_web_arguments, chosen_port
from posfet_model.config import ConfigError
from support.web_sensors import FakeRecordings, FakeSensor


@pytest.fixture(autouse=True)
def private(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "posfet"


def link(namespace: str = "tactile", port: int = 0) -> str:
    with served([FakeSensor(namespace).viewed], port=port) as found:
        return found


def test_the_link_is_the_same_after_a_restart_and_another_for_each_sensor(
    private: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = link()
    assert before in capsys.readouterr().out
    assert link() == before
    assert link("hand/thumb").split("token=")[1] != before.split("token=")[1]
    (path,) = private.glob("web-tactile.json")
    assert path.stat().st_mode & 0o777 == 0o600


def test_without_the_last_port_another_one_is_used(private: Path) -> None:
    before = link()
    port = int(before.split(":")[2].split("/")[0])
    with socket.create_server(("127.0.0.1", port)):
        other = link()
        assert other != before
        with pytest.raises(ConfigError, match=f"--web-port: 127.0.0.1:{port} cannot be used: .*; use another"):
            link(port=port)


def test_a_recording_ends_with_the_server(capsys: pytest.CaptureFixture[str]) -> None:
    sensor = FakeSensor(recordings=FakeRecordings())
    assert sensor.recordings is not None
    with served([sensor.viewed]):
        sensor.recordings.start()
    assert not sensor.recordings.running
    assert "thumb.mcap: 2.0 s, 40 messages" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["", "{", "[]", '{"port": 99999, "token": "x"}', '{"port": 80, "token": "short"}'])
def test_a_file_that_is_no_link_is_replaced(private: Path, text: str) -> None:
    private.mkdir(mode=0o700)
    (private / "web-tactile.json").write_text(text, encoding="utf-8")
    assert len(link().split("token=")[1]) > 40
    assert link() == link()


@pytest.mark.parametrize(
    ("words", "port"), [([], None), (["--web"], 0), (["--web-port", "8080"], 8080), (["--web", "--web-port", "1"], 1)]
)
def test_options(words: list[str], port: int | None) -> None:
    parser = argparse.ArgumentParser()
    add_web_arguments(parser)
    assert chosen_port(parser.parse_args(words)) == port


@pytest.mark.parametrize("text", ["0", "65536", "-1", "web", "source:=can"])
def test_a_port_that_is_none_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    add_web_arguments(parser)
    with pytest.raises(SystemExit):
        parser.parse_args([f"--web-port={text}"])
    assert f"must be in [1, 65535], got '{text}'" in capsys.readouterr().err
