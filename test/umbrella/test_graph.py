# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from __future__ import annotations

import os
import stat
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from posfet.arguments import parse
from posfet.graph import NodeSpec, emulated_adapter, graph
from posfet.ros_arguments import split
from posfet_model.calibration.calibration_file import save_calibration
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor

OURS = "/tactile/model_node, /tactile/sim_board_node, /tactile/driver_node, /tactile/replay_node"


@pytest.fixture
def params_file(tmp_path: Path) -> str:
    path = tmp_path / "parameters.yaml"
    path.write_text("/**:\n  ros__parameters:\n    can_options: [a=1]\n", encoding="utf-8")
    return str(path)


def nodes(params_file: str, *words: str) -> dict[str, NodeSpec]:
    return {spec.executable: spec for spec in graph(parse(words), params_file)}


def test_the_simulated_board_needs_no_driver(params_file: str) -> None:
    specs = nodes(params_file, "scene:=hold")
    assert list(specs) == ["model_node", "sim_board_node"]
    assert specs["sim_board_node"].parameters["scene"] == "hold"
    assert specs["sim_board_node"].parameters["adapter_link"] == ""
    assert specs["model_node"].parameters["simulated"] is True


def test_a_board_on_a_bus_needs_no_simulation(params_file: str) -> None:
    specs = nodes(params_file, "source:=can", "can_interface:=pcan", "can_channel:=PCAN_USBBUS1", "can_bitrate:=500000")
    assert list(specs) == ["model_node", "driver_node"]
    assert specs["model_node"].parameters["simulated"] is False
    bus = specs["driver_node"].parameters
    assert (bus["can_interface"], bus["can_channel"], bus["can_bitrate"]) == ("pcan", "PCAN_USBBUS1", 500_000)


def test_the_driver_reads_the_emulated_adapter_of_its_own_namespace(params_file: str) -> None:
    thumb, palm = (nodes(params_file, "source:=emulator", f"namespace:={name}") for name in ("hand/thumb", "hand/palm"))
    for specs in (thumb, palm):
        link = specs["sim_board_node"].parameters["adapter_link"]
        assert link
        assert specs["driver_node"].parameters["can_channel"] == link
        assert specs["driver_node"].parameters["can_interface"] == "slcan"
    assert thumb["driver_node"].parameters["can_channel"] != palm["driver_node"].parameters["can_channel"]


def test_board_and_driver_use_the_named_bus(params_file: str) -> None:
    specs = nodes(params_file, "source:=emulator", "bus_interface:=udp_multicast", "bus_channel:=239.74.163.2")
    board, driver = specs["sim_board_node"].parameters, specs["driver_node"].parameters
    assert (board["bus_interface"], board["bus_channel"], board["adapter_link"]) == (
        "udp_multicast",
        "239.74.163.2",
        "",
    )
    assert (driver["can_interface"], driver["can_channel"]) == ("udp_multicast", "239.74.163.2")
    assert "bus_interface" not in nodes(params_file, "source:=emulator")["sim_board_node"].parameters


def test_the_calibration_argument_overrides_the_parameter_file(params_file: str, tmp_path: Path) -> None:
    assert "calibration_file" not in nodes(params_file)["model_node"].parameters
    path, sensor = tmp_path / "cal.yaml", load_sensor()
    save_calibration(path, sensor, Calibration.nominal(sensor))
    assert nodes(params_file, f"calibration_file:={path}")["model_node"].parameters["calibration_file"] == str(path)
    with pytest.raises(ConfigError, match="is of another sensor"):
        nodes(params_file, f"calibration_file:={path}", "sensor_file:=posfet_16x16")


def test_the_limit_of_uncertainty_overrides_the_parameter_file_where_it_is_given(params_file: str) -> None:
    assert "max_relative_uncertainty" not in nodes(params_file)["model_node"].parameters
    given = nodes(params_file, "max_relative_uncertainty:=0.1")["model_node"].parameters
    assert given["max_relative_uncertainty"] == 0.1
    assert "touch_at_start" not in given
    assert nodes(params_file, "touch_at_start:=true")["model_node"].parameters["touch_at_start"] is True


@pytest.mark.parametrize("value", ["0", "nan"])
def test_a_meaningless_limit_of_uncertainty_is_rejected(params_file: str, value: str) -> None:
    with pytest.raises(ConfigError, match=f"max_relative_uncertainty: must be a number .*, got '{value}'"):
        nodes(params_file, f"max_relative_uncertainty:={value}")


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["bus_interface:=virtual"], "bus_interface: needs source:=emulator; leave it out with source:=sim"),
        (["source:=can", "bus_interface:=virtual"], "bus_interface: needs source:=emulator"),
        (["source:=emulator", "bus_channel:=can0"], "bus_channel: needs a bus_interface"),
        (
            ["source:=emulator", "bus_interface:=virtual", "composed:=false"],
            "^bus_interface: virtual is a bus within one process; use composed:=true, or another interface$",
        ),
    ],
)
def test_a_bus_argument_that_leads_nowhere_is_rejected(params_file: str, words: list[str], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        graph(parse(words), params_file)


@pytest.mark.parametrize("argument", ["frame_id", "parent_frame"])
def test_a_frame_that_tf_refuses_is_rejected(params_file: str, argument: str) -> None:
    reason = f"^{argument}: must be text without a slash at its front, got '/palm'$"
    with pytest.raises(ConfigError, match=reason):
        nodes(params_file, f"{argument}:=/palm")


def test_the_sensor_error_model_is_passed_to_the_simulated_board(params_file: str) -> None:
    assert nodes(params_file)["sim_board_node"].parameters["imperfections"] == "default"
    for source in ("sim", "emulator"):
        specs = nodes(params_file, f"source:={source}", "imperfections:=none")
        assert specs["sim_board_node"].parameters["imperfections"] == "none"


def test_parameters_of_a_process_keep_their_types_and_override_the_parameter_file(params_file: str) -> None:
    values = {"text": "5", "scene": "it's", "on": True, "rate": 1e-3}
    spec = NodeSpec("package", "sim_board_node", "tactile", params_file, "info", values)
    assert yaml.safe_load(spec.parameter_file()) == {"/tactile/sim_board_node": {"ros__parameters": values}}
    words = spec.arguments
    assert words[:5] == ["--ros-args", "-r", "__node:=sim_board_node", "-r", "__ns:=/tactile"]
    assert words[words.index("--params-file") + 1] == params_file


def test_the_mount_argument_is_passed_to_the_model_and_otherwise_left_to_the_parameter_file(params_file: str) -> None:
    mounted = nodes(params_file, "parent_frame:=finger", "mount:=0 0 0.01 0 0 0")["model_node"].parameters
    assert (mounted["parent_frame"], mounted["mount"]) == ("finger", "0 0 0.01 0 0 0")
    assert not {"parent_frame", "mount"} & set(nodes(params_file)["model_node"].parameters)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["parent_frame:=finger", "mount:=0 0 0"], "mount: must be six numbers"),
        (["mount:=0 0 0.01 0 0 0"], "mount: needs parent_frame"),
    ],
)
def test_invalid_mounts_are_rejected(params_file: str, words: list[str], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        graph(parse(words), params_file)


@pytest.mark.parametrize("namespace", ["", "/", "9lives", "a b", "a//b", "é", "a__b", "a\n"])
def test_invalid_namespaces_are_rejected(params_file: str, namespace: str) -> None:
    with pytest.raises(ConfigError, match="namespace: must be names"):
        graph(parse([f"namespace:={namespace}"]), params_file)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "/tactile/driver_nodee:\n  ros__parameters: {}\n",
            "driver_nodee: no such node, known are model_node",
        ),
        *(
            (f"{name}:\n  ros__parameters: {{}}\n", f"{name}: none of the nodes {OURS}; write /**/{node} for any")
            for name, node in (
                ("model_node", "model_node"),
                ("/driver_node", "driver_node"),
                ("/*", "*"),
                ("/tactil/model_node", "model_node"),
                ("robot/tactile/driver_node", "driver_node"),
                ("/*/*/driver_node", "driver_node"),
                ("/hand/**", "**"),
                ("/tactile/*/*", "*"),
            )
        ),
        ("/**:\n  ros__parameter: {}\n", "ros__parameters: missing"),
        ("root:x:0:0\n", "must be a mapping"),
        ("/**: [\n", "is not valid YAML"),
    ],
)
def test_invalid_parameter_files_are_rejected(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        graph(parse([]), str(path))
    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


SECTIONS = (
    "**",
    "/**",
    "/*/**",
    "/**/*",
    "**/model_node",
    "/**/model_node",
    "/*/model_node",
    "/tactile/model_node",
    "tactile/model_node",
    "/tactile/*",
    "/tactile/**",
    "/tactile/**/model_node",
)


@pytest.mark.parametrize("section", SECTIONS)
def test_a_parameter_file_may_name_its_nodes_in_every_way_that_ros_reads(tmp_path: Path, section: str) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text(f'"{section}":\n  ros__parameters: {{contact_threshold: 0.125}}\n', encoding="utf-8")
    graph(parse([]), str(path))
    rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        words = ["--ros-args", "--params-file", str(path)]
        options = {"cli_args": words, "automatically_declare_parameters_from_overrides": True}
        node = rclpy.create_node("model_node", namespace="/tactile", context=context, **options)
        assert node.get_parameter("contact_threshold").value == 0.125
        node.destroy_node()
    finally:
        context.try_shutdown()


def test_a_parameter_file_has_sections_for_further_sensors_only_if_these_are_named(tmp_path: Path) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text("/robot/palm/model_node:\n  ros__parameters: {contact_threshold: 0.125}\n", encoding="utf-8")
    _, ros = split(["--ros-args", "-r", "__ns:=/robot"])
    named = r"none of the nodes /robot/tactile/model_node, .* or name that of another sensor in params_namespaces$"
    for words in ([], ["params_namespaces:=thumb"], ["params_namespaces:=/palm"]):
        with pytest.raises(ConfigError, match=f"/robot/palm/model_node: {named}"):
            graph(parse(words), str(path), ros)
    for words in (["params_namespaces:=thumb, palm"], ["params_namespaces:=/robot/palm"]):
        graph(parse(words), str(path), ros)
    with pytest.raises(ConfigError, match=r"^params_namespaces: namespace: must be names of"):
        parse(["params_namespaces:=thumb,pa lm"])


def test_a_missing_parameter_file_is_rejected() -> None:
    with pytest.raises(ConfigError, match=r"params_file: no such file: nowhere\.yaml"):
        graph(parse([]), "nowhere.yaml")


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("sensor_file:=nowhere", "no such sensor"),
        ("scene:=nowhere", "no such scene"),
        ("calibration_file:=nowhere.yaml", "nowhere.yaml: cannot be read"),
        ("imperfections:=nowhere.yaml", "nowhere.yaml: cannot be read"),
    ],
)
def test_invalid_files_are_rejected_before_any_node_is_started(params_file: str, word: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        graph(parse([word]), params_file)


def test_the_emulated_adapter_is_in_a_folder_of_the_user_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert emulated_adapter("hand/thumb").parent == tmp_path / "posfet"
    assert stat.S_IMODE((tmp_path / "posfet").stat().st_mode) == 0o700
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = emulated_adapter("hand/thumb").parent
    assert folder == tmp_path / f"posfet-{os.getuid()}"
    folder.chmod(0o777)
    with pytest.raises(
        ConfigError, match=f"^{folder}: must be a folder that only you can write to; set XDG_RUNTIME_DIR"
    ):
        emulated_adapter("hand/thumb")
    folder.rmdir()
    folder.symlink_to(tmp_path / "posfet")  # prepared by someone else
    with pytest.raises(ConfigError, match=f"^{folder}: must be a folder that only you can write to"):
        emulated_adapter("hand/thumb")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "none"))
    with pytest.raises(ConfigError, match="cannot be made: No such file or directory; set XDG_RUNTIME_DIR"):
        emulated_adapter("hand/thumb")


def test_the_calibration_folder_reaches_the_model_if_it_is_given(params_file: str) -> None:
    assert "calibration_folder" not in nodes(params_file)["model_node"].parameters
    given = nodes(params_file, "calibration_folder:=/srv/posfet")["model_node"].parameters
    assert given["calibration_folder"] == "/srv/posfet"


def test_a_parameter_file_that_is_none_is_rejected_in_one_line(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, reason in (("x" * 300, "params_file: no such file"), (str(tmp_path / "pipe"), "not a regular file")):
        with pytest.raises(ConfigError, match=reason):
            nodes(path)


def test_ros_reads_every_text_of_a_parameter_file_as_the_text_that_it_is(tmp_path: Path, params_file: str) -> None:
    rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
    texts = [
        "0815",
        "007",
        "1e5",
        "1_000",
        "0x1F",
        ".5",
        ".inf",
        "1:30",
        "y",
        "no",
        "on",
        "~",
        "null",
        "",
        "a: b",
        "#",
        "'",
        '"',
        "ö😀",
    ]
    model = nodes(params_file)["model_node"]
    spec = replace(model, parameters={f"p{index}": text for index, text in enumerate(texts)})
    path = tmp_path / "values.yaml"
    path.write_text(spec.parameter_file(), encoding="utf-8")
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        words = ["--ros-args", "--params-file", str(path)]
        options = {"allow_undeclared_parameters": True, "automatically_declare_parameters_from_overrides": True}
        node = rclpy.create_node(spec.name, namespace=spec.namespace, context=context, cli_args=words, **options)
        assert [node.get_parameter(name).value for name in spec.parameters] == texts
        node.destroy_node()
    finally:
        context.try_shutdown()


@pytest.mark.parametrize("key", ["sensor_file", "serial", "can_fd", "can_channel", "can_bitrate", "scene", "seed"])
def test_what_an_argument_overrides_in_any_case_is_refused_in_a_parameter_file(tmp_path: Path, key: str) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    {key}: '1'\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"{key}: use the argument {key}:=<value>, from which the nodes get it$"):
        nodes(str(path))


def test_what_bring_up_alone_sets_is_refused_in_a_parameter_file(tmp_path: Path) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text("/**/model_node:\n  ros__parameters: {direct: true}\n", encoding="utf-8")
    with pytest.raises(
        ConfigError, match=r"direct: use the argument composed:=true, which sets it; without it the model"
    ):
        nodes(str(path), "composed:=false")


@pytest.mark.parametrize("rule", ["seed:=7", "sim_board_node:seed:=7", "/**:seed:=7", "scene:=hold", "frame_id:=palm"])
@pytest.mark.parametrize("option", ["-p", "--param"])
def test_what_an_argument_overrides_in_any_case_is_refused_as_a_ros_argument(
    params_file: str, option: str, rule: str
) -> None:
    key = rule.rpartition(":=")[0].rpartition(":")[2]
    _, ros = split(["--ros-args", "-p", "use_sim_time:=true", option, rule])
    with pytest.raises(ConfigError, match=rf"^-p {key}: use the argument {key}:=<"):
        graph(parse([]), params_file, ros)


@pytest.mark.parametrize("node", ["/**", "arm_node", "/tactile/sim_board_node", "board"])
def test_a_parameter_file_of_ros_arguments_is_refused_for_what_it_says_of_our_nodes(
    params_file: str, tmp_path: Path, node: str
) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(f"{node}:\n  ros__parameters:\n    seed: 7\n", encoding="utf-8")
    _, ros = split(["--ros-args", "--params-file", str(path), "-r", "sim_board_node:__node:=board"])
    if node == "board":
        with pytest.raises(ConfigError, match=rf"^{path}: board.ros__parameters.seed: use the argument seed:=<value>"):
            graph(parse([]), params_file, ros)
    else:
        graph(parse([]), params_file, ros)


def test_a_parameter_file_of_ros_arguments_that_cannot_be_read_is_left_to_ros(params_file: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text("sim_board_node: {seed", encoding="utf-8")
    for words in (["--params-file", str(path)], ["--params-file", str(tmp_path / "none.yaml")], ["--params-file"]):
        graph(parse([]), params_file, split(["--ros-args", *words])[1])


def test_the_seed_is_that_of_the_simulated_board(params_file: str) -> None:
    assert nodes(params_file)["sim_board_node"].parameters["seed"] == 0
    assert nodes(params_file, "seed:=7")["sim_board_node"].parameters["seed"] == 7
