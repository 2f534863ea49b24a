# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Messages that are loaded on demand: in an interpreter of their own, as what is imported stays."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

pytest.importorskip("rclpy")

BEGIN = """
import json, sys
from posfet_model.ros.on_demand import load_on_demand
load_on_demand()
load_on_demand()
"""


def run(code: str) -> Any:
    """Return what a program prints as JSON."""
    words = [sys.executable, "-c", BEGIN + code]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_only_the_messages_that_are_used_are_loaded() -> None:
    loaded = run(
        "from sensor_msgs.msg import Image\n"
        "import geometry_msgs.msg\n"
        "wrench = geometry_msgs.msg.WrenchStamped()\n"
        "print(json.dumps([Image.__name__, wrench.header.frame_id, sorted(sys.modules)]))"
    )
    assert loaded[:2] == ["Image", ""]
    messages = {name for name in loaded[2] if name.startswith(("sensor_msgs.msg.", "geometry_msgs.msg."))}
    assert {"sensor_msgs.msg._image", "geometry_msgs.msg._wrench_stamped"} <= messages
    assert not {"sensor_msgs.msg._battery_state", "geometry_msgs.msg._inertia"} & messages


@pytest.mark.parametrize("package", ["sensor_msgs.msg", "lifecycle_msgs.srv", "posfet_msgs.msg", "posfet_msgs.srv"])
def test_every_name_of_a_package_is_there(package: str) -> None:
    known = f"import {package} as p, inspect\nnames = [name for name in dir(p) if name[0] != '_']\n"
    on_demand = run(
        f"from {package} import *\n{known}"
        "print(json.dumps([names, [name for name in names if getattr(p, name) is not globals()[name]]]))"
    )
    eager = subprocess.run(
        [sys.executable, "-c", f"import {package} as p, json; print(json.dumps([n for n in dir(p) if n[0] != '_']))"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert on_demand == [json.loads(eager.stdout), []]
    assert len(on_demand[0]) > 3


def test_a_name_that_is_not_there_is_an_error_as_ever() -> None:
    assert run(
        "import sensor_msgs.msg\n"
        "try:\n    from sensor_msgs.msg import Imag\n"
        "except ImportError as error:\n    print(json.dumps([hasattr(sensor_msgs.msg, 'Imag'), str(error)[:24]]))"
    ) == [False, "cannot import name 'Imag"]


def test_a_message_is_serialised_without_the_generator_of_python_code() -> None:
    assert run(
        "from rclpy.serialization import deserialize_message, serialize_message\n"
        "from geometry_msgs.msg import Point\n"
        "point = deserialize_message(serialize_message(Point(x=1.5)), Point)\n"
        "print(json.dumps([point.x, 'lark' in sys.modules]))"
    ) == [1.5, False]
