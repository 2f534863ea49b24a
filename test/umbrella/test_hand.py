# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The file of a hand: which arguments each sensor gets, and what is refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from posfet.arguments import check, defaults
from posfet.graph import graph
from posfet.hand import read_hand, seed_of
from posfet_model.config import ConfigError
from support.paths import SOURCES

SHIPPED = SOURCES / "posfet/config/hand.yaml"
PARAMETERS = str(SOURCES / "posfet/config/parameters.yaml")


def hand(folder: Path, text: str) -> list[dict[str, str]]:
    path = folder / "hand.yaml"
    path.write_text(text, encoding="utf-8")
    return read_hand(path)


def test_the_shipped_hand_has_five_fingers_and_a_palm_each_with_a_graph_of_its_own() -> None:
    sensors = read_hand(SHIPPED)
    fingers = ["thumb", "index", "middle", "ring", "little"]
    assert [sensor["namespace"] for sensor in sensors] == [f"hand/{name}" for name in (*fingers, "palm")]
    assert len({sensor["serial"] for sensor in sensors}) == 6
    assert [sensor["sensor_file"] for sensor in sensors] == [*["posfet_5x5"] * 5, "posfet_16x16"]
    for sensor in sensors:
        model, board = graph(check(sensor), PARAMETERS)
        assert model.namespace == sensor["namespace"]
        assert model.parameters["serial"] == board.parameters["serial"] == sensor["serial"]


def test_a_sensor_overrides_what_is_common_and_names_files_beside_the_list(tmp_path: Path) -> None:
    (tmp_path / "thumb.yaml").write_text("", encoding="utf-8")
    thumb, palm = hand(
        tmp_path,
        "common: {source: emulator, scene: hold, can_bitrate: 500000, can_fd: true, autostart: false, "
        "max_relative_uncertainty: 0.5}\n"
        "sensors:\n- {name: a/thumb, scene: idle, calibration_file: thumb.yaml, serial: '0712'}\n- {name: palm}\n",
    )
    changed = {"namespace": "palm", "source": "emulator", "scene": "hold", "can_bitrate": "500000", "can_fd": "true"}
    changed |= {"autostart": "false", "max_relative_uncertainty": "0.5"}
    changed["params_namespaces"] = "a/thumb,palm"
    assert palm == {**defaults(), **changed, "seed": str(seed_of("palm"))}
    assert thumb == {
        **palm,
        "namespace": "a/thumb",
        "seed": str(seed_of("a/thumb")),
        "scene": "idle",
        "serial": "0712",
        "calibration_file": str(tmp_path / "thumb.yaml"),
    }


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("sensors: []", "sensors: must be a list of at least one sensor"),
        ("sensors: [{serial: A}]", "sensors[0].name: missing, must be text"),
        ("sensors: [{name: 9}]", "sensors[0].name: must be text, got 9"),
        ("sensors: [{name: a__b}]", "sensors[0]: 'a__b': namespace: must be names of"),
        ("sensors: [{name: a, scenes: hold}]", "sensors[0].scenes: unknown key, did you mean scene?"),
        ("sensors: [{name: a, namespace: b}]", "sensors[0].namespace: unknown key"),
        ("sensors: [{name: a, source: usb}]", "sensors[0]: 'a': source: must be one of sim, can, emulator"),
        ("sensors: [{name: a, mount: [1, 2]}]", "sensors[0].mount: must be text, got [1, 2] without quotes"),
        ("sensors: [{name: a, serial: 712}]", "sensors[0].serial: must be text, got 712 without quotes"),
        ("sensors: [{name: a, serial: 0712}]", "write it without the zero, or a text in quotes"),
        ("sensors: [{name: a, scene: on}]", "sensors[0].scene: must be text, got True without quotes"),
        (
            "sensors: [{name: a, frame_id: no}]",
            "sensors[0].frame_id: must be text without a slash at its front, got False without quotes",
        ),
        ("sensors: [{name: a, can_bitrate: yes}]", "sensors[0].can_bitrate: must be a whole number"),
        ("common: {can_bitrate: fast}\nsensors: [{name: a}]", "'a': can_bitrate: must be a whole number"),
        ("sensors: [{name: a}, {name: a}]", "sensors: 2 of them have the namespace 'a': each needs its own"),
        ("common: {serial: S}\nsensors: [{name: a}, {name: b}]", "sensors: 2 of them have the serial 'S'"),
        ("sensors: [{name: a}]\nfingers: 5", "fingers: unknown key"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(ConfigError) as caught:
        hand(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'hand.yaml'}: ")
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_simulated_sensors_are_boards_of_their_own_and_real_ones_have_no_seed(tmp_path: Path) -> None:
    assert len({sensor["seed"] for sensor in read_hand(SHIPPED)}) == 6
    assert [sensor["seed"] for sensor in read_hand(SHIPPED)] == [sensor["seed"] for sensor in read_hand(SHIPPED)]
    text = "common: {source: SOURCE}\nsensors:\n- {name: a}\n- {name: b, seed: 7}\n"
    assert [each["seed"] for each in hand(tmp_path, text.replace("SOURCE", "sim"))] == [str(seed_of("a")), "7"]
    assert [each["seed"] for each in hand(tmp_path, "common: {source: can}\nsensors: [{name: a}, {name: b}]")] == [
        "0"
    ] * 2
    with pytest.raises(ConfigError, match=r"sensors\[1\]: 'b': seed: needs source:=sim or source:=emulator"):
        hand(tmp_path, text.replace("SOURCE", "can"))


def test_what_is_common_counts_for_the_sensors_whose_source_it_goes_with(tmp_path: Path) -> None:
    file = tmp_path / "hand.yaml"
    file.write_text("common: {source: can, can_channel: can1}\nsensors: [{name: a}, {name: b, source: sim}]\n")
    real, simulated = read_hand(file)
    assert (real["can_channel"], simulated["can_channel"]) == ("can1", "can0")


def test_the_sensors_of_a_hand_may_share_a_parameter_file_with_sections_for_each(tmp_path: Path) -> None:
    file = tmp_path / "parameters.yaml"
    text = "common: {params_file: parameters.yaml}\nname: hand\nsensors:\n- {name: thumb}\n- {name: palm}\n"
    file.write_text("/hand/thumb/model_node:\n  ros__parameters: {contact_threshold: 0.1}\n", encoding="utf-8")
    for sensor in hand(tmp_path, text):
        graph(check(sensor), sensor["params_file"])
    file.write_text("/hand/thum/model_node:\n  ros__parameters: {contact_threshold: 0.1}\n", encoding="utf-8")
    for sensor in hand(tmp_path, text):
        with pytest.raises(ConfigError, match="/hand/thum/model_node: none of the nodes /hand/"):
            graph(check(sensor), sensor["params_file"])
