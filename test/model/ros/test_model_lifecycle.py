# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The model node: lifecycle, parameters that change while it runs, and the frame of its source."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from rclpy.context import Context
from rclpy.parameter import Parameter

from posfet_model.config import ConfigError
from posfet_model.contacts.tracker import ContactState
from posfet_model.ros.diagnostic_array import hardware_id
from posfet_model.ros.model_node import ModelNode
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain
from posfet_msgs.msg import TactileRaw
from posfet_msgs.srv import CalibrationFile, Tare
from support.participants import participants, participants_kept

pytestmark = pytest.mark.ros

SENSOR = load_sensor()
LIGHT = 0.05
"""Force of a light touch on one taxel [N]."""


class Bench:
    """A model node, and a board that is at rest or touched lightly on one taxel."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.nodes: list[ModelNode] = []
        self._chain = ForwardSignalChain(SENSOR, np.random.default_rng(3))
        self._scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
        self._index = 0

    def model(self, **parameters: Any) -> ModelNode:
        overrides = [Parameter(name, value=value) for name, value in {"direct": True, **parameters}.items()]
        node = ModelNode(context=self.context, namespace="/hand", parameter_overrides=overrides)
        node.serve()  # as when an executor begins to spin
        self.nodes.append(node)
        return node

    def play(self, node: ModelNode, count: int, force: float = 0.0) -> int:
        """Have the node process scans; return the number of contacts afterwards."""
        forces = np.zeros(SENSOR.layout.taxels)
        forces[12] = force
        for _ in range(count):
            self._chain.advance(forces, 25.0, 1e-3)
            scan = self._scan
            scan.counts[:], scan.temperatures[:] = self._chain.counts(), 25.0
            scan.sequence, scan.device_time, scan.stamp = self._index, self._index * 1000, self._index * 1_000_000
            self._index += 1
            node.process(scan)
        latest = node.latest()
        contacts = () if latest is None else latest.contacts
        return sum(contact.state is not ContactState.RELEASED for contact in contacts)

    def close(self) -> None:
        for node in self.nodes:
            node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def change(node: ModelNode, **values: Any) -> tuple[bool, str]:
    """Set parameters together; return whether that succeeded, and the reason."""
    result = node.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])
    return result.successful, result.reason


def ask(node: ModelNode, name: str, request: Any) -> Any:
    """Return the answer of a service of the node."""
    [service] = [each for each in node.services if each.service_name.endswith(f"/{name}")]
    return service.callback(request, service.srv_type.Response())


def test_transitions_start_and_stop_the_processing_of_scans(bench: Bench) -> None:
    node = bench.model(autostart=False)
    node.start()
    bench.play(node, 10)
    assert node.latest() is None
    answer = ask(node, "tare", Tare.Request())
    assert (answer.success, answer.message) == (False, "refused: the model is not active")
    for service in ("calibration/load", "calibration/save"):
        assert ask(node, service, CalibrationFile.Request()).message == "the model is not configured"
    node.trigger_configure()
    bench.play(node, 10)
    assert node.latest() is None
    node.trigger_activate()
    bench.play(node, 10)
    assert node.latest().scans == 10
    node.trigger_deactivate()
    bench.play(node, 10)
    assert node.latest().scans == 10
    node.trigger_activate()
    bench.play(node, 1)
    assert (node.latest().scans, node.latest().missed) == (11, 10)
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert node.latest() is None
    node.trigger_configure()
    node.trigger_activate()
    bench.play(node, 5)
    assert node.latest().scans == 5


def test_raw_is_subscribed_while_active_only(bench: Bench) -> None:
    node = bench.model(direct=False)
    node.start()
    assert node.count_subscribers("raw") == 1
    node.trigger_deactivate()
    assert not [entry for entry in node.subscriptions if entry.topic_name == "/hand/raw"]
    node.trigger_activate()
    assert len([entry for entry in node.subscriptions if entry.topic_name == "/hand/raw"]) == 1


def test_a_calibration_that_cannot_be_used_refuses_the_start_in_one_line(bench: Bench) -> None:
    node = bench.model(calibration_file="nowhere.yaml")
    with pytest.raises(ConfigError, match=r"^/hand/model_node: nowhere\.yaml: cannot be read"):
        node.start()


def test_contact_thresholds_change_between_two_scans_and_keep_the_baselines(bench: Bench) -> None:
    node = bench.model()
    node.start()
    bench.play(node, 400)
    assert bench.play(node, 20, LIGHT) == 1
    assert change(node, contact_threshold=0.5, release_threshold=0.2) == (True, "")
    assert bench.play(node, 2, LIGHT) == 0
    assert node.latest().valid
    assert node.latest().force.max() == pytest.approx(LIGHT, abs=0.01)
    assert change(node, contact_threshold=0.0, release_threshold=0.0) == (True, "")
    assert bench.play(node, 2, LIGHT) == 1


def test_thresholds_that_do_not_fit_change_nothing(bench: Bench) -> None:
    node = bench.model()
    node.start()
    done, reason = change(node, contact_threshold=0.01, release_threshold=0.02, display_rate=5.0)
    assert not done
    assert reason == "release_threshold: must be at most contact_threshold, 0.01 N, got 0.02 N; set both at once"
    assert node.get_parameter("display_rate").value == node.parameters["display_rate"] == 30.0
    done, reason = change(node, contact_threshold=float("nan"))
    assert not done
    assert "contact_threshold" in reason
    assert change(node, display_rate=5.0) == (True, "")
    assert node._outputs.display.period == 200_000_000
    assert node.parameters["contact_threshold"] == 0.0


def test_hum_removal_and_the_limit_of_uncertainty_change_while_running(bench: Bench) -> None:
    node = bench.model()
    node.start()
    assert bench.play(node, 600, 0.0) == 0
    assert node.latest().valid
    assert node._reconstructor._hum.searches
    assert change(node, hum_removal=False, max_relative_uncertainty=0.5) == (True, "")
    assert not node._reconstructor._hum.searches
    assert node._reconstructor._estimator.max_relative_uncertainty == 0.5
    bench.play(node, 10)
    assert node.latest().valid


def test_settings_outlive_another_calibration(bench: Bench, tmp_path: Any) -> None:
    node = bench.model(calibration_folder=str(tmp_path))
    node.start()
    assert change(node, contact_threshold=0.5, release_threshold=0.2) == (True, "")
    assert ask(node, "calibration/save", CalibrationFile.Request(path="a.yaml")).success
    assert ask(node, "calibration/load", CalibrationFile.Request(path="a.yaml")).success
    bench.play(node, 400)
    assert bench.play(node, 20, LIGHT) == 0


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("sensor_file", "posfet_16x16", "buffers and messages have the size of its array"),
        ("calibration_file", "a.yaml", "the service calibration/load changes the calibration"),
        ("direct", False, "it is used at start-up only"),
    ],
)
def test_a_parameter_that_cannot_change_says_why(bench: Bench, name: str, value: Any, why: str) -> None:
    node = bench.model()
    expected = (False, f"{name}: cannot change while the node runs: {why}")
    assert change(node, display_rate=5.0, **{name: value}) == expected
    [result] = node.set_parameters([Parameter(name, value=value)])
    assert (result.successful, result.reason) == expected
    assert node.get_parameter("display_rate").value == 30.0


def test_a_parameter_that_the_node_does_not_have_is_named_and_nothing_is_set(bench: Bench) -> None:
    node = bench.model()
    reason = "contact_treshold: no such parameter, did you mean contact_threshold?; zzz: no such parameter"
    assert change(node, display_rate=5.0, contact_treshold=0.1, zzz=1) == (False, reason)
    assert node.get_parameter("display_rate").value == 30.0


def test_the_frame_is_that_of_the_scans(bench: Bench) -> None:
    node = bench.model(direct=False)
    node.start()
    message = TactileRaw(layout_id=1, rows=5, cols=5, counts=[0] * 25, temperatures=[25.0, 25.0])
    assert node._outputs.frame_id == ""
    for frame_id, used in (("", "hand_array"), ("thumb", "thumb"), ("palm", "palm")):
        message.header.frame_id = frame_id
        node._receive(message)
        assert node._outputs.frame_id == used


def test_a_board_without_a_serial_number_is_told_apart_by_its_namespace() -> None:
    assert hardware_id(SENSOR, "/hand/thumb") == "posfet_5x5 (hand/thumb)"


def test_a_destroyed_node_releases_its_participant_at_once() -> None:
    collected = participants_kept()
    gc.disable()
    try:
        context = Context()
        rclpy.init(context=context)
        node = ModelNode(context=context)
        assert participants() == collected + 1
        node.destroy_node()
        assert participants() == collected
        rclpy.shutdown(context=context)
    finally:
        gc.enable()
