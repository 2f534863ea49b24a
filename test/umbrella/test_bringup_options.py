"""The command line of `posfet bringup`: options and arguments in any order."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("ament_index_python", reason="needs ROS 2")

from posfet import bringup


@pytest.mark.parametrize(
    "words",
    [
        ["source:=can", "--for", "5", "namespace:=x"],
        ["--for", "5", "source:=can", "namespace:=x"],
        ["source:=can", "namespace:=x", "--for=5", "--ros-args"],
    ],
)
def test_options_may_stand_between_arguments(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[tuple[object, float]] = []
    runner = SimpleNamespace(run=lambda specs, seconds: runs.append((specs, seconds)) or 7)
    monkeypatch.setattr(bringup, "default_params_file", lambda: "file")
    monkeypatch.setattr(bringup, "graph", lambda arguments, *_: (arguments["source"], arguments["namespace"]))
    monkeypatch.setattr(bringup, "import_module", lambda _: runner)
    assert bringup.main(words) == 7
    assert runs == [(("can", "x"), 5.0)]


def test_an_unknown_option_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        bringup.main(["source:=can", "--fort", "5", "namespace:=x"])
    assert "unrecognized arguments: --fort" in capsys.readouterr().err
