# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The command line of `posfet bringup`: options and arguments in any order."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("ament_index_python", reason="needs ROS 2")

from posfet import bringup
from posfet.ros_arguments import RosArguments
from posfet.web.options import web_words
from posfet_model.config import ConfigError


@pytest.mark.parametrize(
    ("words", "web_port"),
    [
        (["source:=can", "--for", "5", "namespace:=x"], None),
        (["--for", "5", "source:=can", "namespace:=x"], None),
        (["source:=can", "namespace:=x", "--for=5", "--ros-args"], None),
        (["--web", "source:=can", "--for", "5", "namespace:=x"], 0),
        (["--web-port", "8080", "source:=can", "--for", "5", "namespace:=x"], 8080),
    ],
)
def test_options_may_stand_between_arguments(
    words: list[str], web_port: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[tuple[object, ...]] = []

    def run(arguments: dict[str, str], _: RosArguments, seconds: float, port: int | None) -> int:
        runs.append((arguments["source"], arguments["namespace"], arguments["params_file"], seconds, port))
        return 7

    runner = SimpleNamespace(run=run)
    monkeypatch.setattr(bringup, "default_params_file", lambda: "file")
    monkeypatch.setattr(bringup, "import_module", lambda _: runner)
    assert bringup.main(words) == 7
    assert runs == [("can", "x", "file", 5.0, web_port)]


def test_an_unknown_option_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        bringup.main(["source:=can", "--fort", "5", "namespace:=x"])
    assert "unrecognized arguments: --fort" in capsys.readouterr().err


@pytest.mark.parametrize(("web", "words"), [("true", ["--web"]), ("false", []), ("8080", ["--web-port", "8080"])])
def test_the_launch_argument_of_the_browser_view_becomes_an_option(web: str, words: list[str]) -> None:
    assert web_words(web) == words


@pytest.mark.parametrize("web", ["", "on", "True", "0", "65536", "-1", "80.5", "٨٠", "9" * 5000])
def test_another_text_is_no_port(web: str) -> None:
    with pytest.raises(ConfigError, match=r"^web: must be true, false or a port in \[1, 65535\], got .{0,120}$"):
        web_words(web)
