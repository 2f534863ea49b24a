# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""RViz and Foxglove files for the sensors of a robot: `posfet displays`."""

from __future__ import annotations

import argparse
import copy
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from ament_index_python.packages import get_package_share_directory

from posfet.hand import read_hand
from posfet_model.command_line import checked_namespace
from posfet_model.config import read_text, write_text
from posfet_model.parameters import default_frame
from posfet_model.ros.exit_codes import exit_code

RVIZ: Final = "rviz/tactile.rviz"
FOXGLOVE: Final = "foxglove/tactile.json"
"""The shipped displays of one sensor in the namespace `tactile`, below the share folder: templates of all others."""
_TOPIC: Final = "/tactile/"
_FRAME: Final = "tactile_array"


def rviz(template: str, frames: Mapping[str, str], fixed_frame: str) -> str:
    """Return an RViz configuration with the displays of every sensor.

    Parameters
    ----------
    template : str
        Text of the shipped file.
    frames : mapping of str to str
        Frame of the array of each sensor, by its namespace.
    fixed_frame : str
        Fixed frame of the view.
    """
    head, rest = template.split("  Displays:\n")
    displays, tail = rest.split("  Global Options:\n")
    parts = []
    for namespace, frame in frames.items():
        own = displays.replace(_TOPIC, f"/{namespace}/").replace("      Name: ", f"      Name: {namespace} ")
        grid = "      Cell Size:"
        parts.append(own.replace(grid, f"      Reference Frame: {frame}\n{grid}"))
    tail = tail.replace(f"Fixed Frame: {_FRAME}", f"Fixed Frame: {fixed_frame}")
    return f"{head}  Displays:\n{''.join(parts)}  Global Options:\n{tail}"


def foxglove(template: str, frames: Mapping[str, str], fixed_frame: str) -> str:
    """Return a Foxglove layout: one view in 3D, one plot, and a tab with force image and contacts for every sensor.

    Parameters
    ----------
    template : str
        Text of the shipped file.
    frames : mapping of str to str
        Frame of the array of each sensor, by its namespace.
    fixed_frame : str
        Frame that the view in 3D follows.
    """
    layout: dict[str, Any] = json.loads(template)
    panels = layout["configById"]
    view, plot = panels["3D!array"], panels["Plot!total"]
    topics, path = view["topics"], plot["paths"][0]
    view["followTf"] = fixed_frame
    view["topics"] = {_renamed(topic, name): copy.deepcopy(topics[topic]) for name in frames for topic in topics}
    plot["paths"] = [{**path, "value": _renamed(path["value"], name), "label": name} for name in frames]
    image, contacts = panels.pop("Image!force"), panels.pop("RawMessages!contacts")
    tabs = []
    for name in frames:
        own = f"Image!{name}", f"RawMessages!{name}"
        topic = _renamed(image["imageMode"]["imageTopic"], name)
        panels[own[0]] = {**image, "imageMode": {**image["imageMode"], "imageTopic": topic}}
        panels[own[1]] = {**contacts, "topicPath": _renamed(contacts["topicPath"], name)}
        tabs.append({"title": name, "layout": {"direction": "column", "first": own[0], "second": own[1]}})
    panels["Tab!sensors"] = {"activeTabIdx": 0, "tabs": tabs}
    left, right = layout["layout"]["first"], layout["layout"]["second"]
    left["second"] = right["first"]
    layout["layout"]["second"] = {**right, "first": "Tab!sensors", "second": right["second"]["second"]}
    return json.dumps(layout, indent=1) + "\n"


def _renamed(text: str, namespace: str) -> str:
    return text.replace(_TOPIC, f"/{namespace}/")


def main(words: Sequence[str] | None = None) -> int:
    """Write both files, and return the exit code: 1, with one line on stderr, if that is not possible.

    Parameters
    ----------
    words : sequence of str, optional
        Command line without the program; that of the process by default.
    """
    parser = argparse.ArgumentParser(
        prog="posfet displays", description="Write an RViz and a Foxglove file for any number of sensors."
    )
    sensors = parser.add_mutually_exclusive_group(required=True)
    sensors.add_argument("namespaces", nargs="*", default=[], metavar="NAMESPACE", help="namespace of a sensor")
    sensors.add_argument("--hand", metavar="FILE", help="YAML file of hand.launch.py, for its sensors")
    parser.add_argument(
        "--fixed-frame", metavar="FRAME", help="frame of the views (default: the array of the first sensor)"
    )
    parser.add_argument("--out", metavar="PATH", default="tactile", help="both files without suffix (default: tactile)")
    options = parser.parse_args(sys.argv[1:] if words is None else words)

    def run() -> int:
        if options.hand:
            frames = {
                sensor["namespace"]: sensor["frame_id"] or default_frame(sensor["namespace"])
                for sensor in read_hand(options.hand)
            }
        else:
            frames = {(name := checked_namespace(given)): default_frame(name) for given in options.namespaces}
        fixed = options.fixed_frame or next(iter(frames.values()))
        shipped = Path(get_package_share_directory("posfet"))
        for template, make in ((RVIZ, rviz), (FOXGLOVE, foxglove)):
            path = f"{options.out}{Path(template).suffix}"
            write_text(path, make(read_text(shipped / template), frames, fixed))
            print(f"{path}: written")
        return 0

    return exit_code(run)


if __name__ == "__main__":
    sys.exit(main())
