# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet tare`, `posfet scene` and `posfet diagnostics`: services and state of a running stack, without ros2cli."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from posfet_model.command_line import checked_namespace, positive
from posfet_model.config import ConfigError
from posfet_model.ros.exit_codes import exit_code
from posfet_model.ros.run_node import ros, spin
from posfet_msgs.srv import LoadScene, Tare
from posfet_sim.parameters import SCENE
from posfet_sim.scene.scene_file import SCENE_FOLDER

DISCOVERY_TIMEOUT: Final = 10.0
"""Time in which a running stack is found [s]."""
RESPONSE_TIMEOUT: Final = 30.0
"""Time for the response of a service [s]; a board with a large array takes a while to begin again."""
REPORT_WAIT: Final = 1.5
"""Time after the first report in which every node of a stack reports at least once [s]."""
FAULT: Final = "fault: "
"""Begin of the keys with meaning and remedy of a fault."""
LEVELS: Final = {0: "OK", 1: "WARN", 2: "ERROR", 3: "STALE"}
REFUSED: Final = 1
"""Exit code of a request that was refused, and of diagnostics with a warning or an error."""


def tare(words: Sequence[str] | None = None) -> int:
    """Run `posfet tare`; return 0, or 1, with one line on stderr, if it is refused or there is no stack."""
    parser = _parser("tare", "Set the forces of a running stack to zero. Refused while something touches.")
    parser.add_argument("--force", action="store_true", help="also under load, and while forces are not valid yet")
    options = parser.parse_args(words)
    return exit_code(lambda: _request(options.namespace, "tare", Tare, Tare.Request(force=options.force)))


def scene(words: Sequence[str] | None = None) -> int:
    """Run `posfet scene`; return 0, or 1, with one line on stderr, if it is refused or there is no stack."""
    parser = _parser("scene", "Load a scene into the running simulated board, or list the shipped scenes.")
    parser.add_argument("scene", metavar="SCENE", nargs="?", help=f"{SCENE.description} (default: list them)")
    options = parser.parse_args(words)
    if options.scene is None:
        print("\n".join(sorted(path.stem for path in SCENE_FOLDER.glob("*.yaml"))))
        return 0
    path = Path(options.scene)
    name = str(path.absolute()) if path.suffix and path.exists() else options.scene
    return exit_code(lambda: _request(options.namespace, "scene/load", LoadScene, LoadScene.Request(scene=name)))


def diagnostics(words: Sequence[str] | None = None) -> int:
    """Run `posfet diagnostics`; return 0 if all is well, 1 for a warning or an error, or if there is no stack."""
    parser = argparse.ArgumentParser(
        prog="posfet diagnostics", description="Show the state of running stacks, with what to do. Exit code 0: all OK."
    )
    parser.add_argument("--namespace", default="", help="namespace of one sensor (default: all)")
    parser.add_argument("--values", action="store_true", help="print every value, too")
    parser.add_argument(
        "--for", dest="seconds", type=positive, default=REPORT_WAIT, help="time to listen after the first report [s]"
    )
    parser.add_argument(
        "--wait", type=positive, default=DISCOVERY_TIMEOUT, help="longest time until the first report [s] (default: 10)"
    )
    options = parser.parse_args(words)
    return exit_code(lambda: _diagnose(options))


def _parser(name: str, description: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"posfet {name}", description=description)
    parser.add_argument("--namespace", default="tactile", help="namespace of the sensor (default: tactile)")
    return parser


def _request(namespace: str, service: str, kind: Any, request: Any) -> int:
    with ros([]) as stack:
        node = Node("posfet_command", cli_args=[], use_global_arguments=False)
        stack.callback(node.destroy_node)
        response = call(node, f"/{checked_namespace(namespace)}/{service}", kind, request)
    if not response.success:
        raise ConfigError(response.message)
    print(response.message)
    return 0


def call(node: Node, name: str, kind: Any, request: Any) -> Any:
    """Return the response of a service.

    Parameters
    ----------
    node : Node
        Node of the caller, which is not spinning.
    name : str
        Full name of the service.
    kind : type
        Its type.
    request : object
        The request.

    Raises
    ------
    ConfigError
        There is no such service, or it does not respond; one line that says what to do.
    """
    client = node.create_client(kind, name)
    _wait(node, client.service_is_ready, DISCOVERY_TIMEOUT)
    if not client.service_is_ready():
        raise ConfigError(f"{name}: no such service; {_remedy(node, name.rsplit('/', 1)[-1])}")
    future = client.call_async(request)
    _wait(node, future.done, RESPONSE_TIMEOUT)
    if not future.done():
        raise ConfigError(f"{name}: no response within {RESPONSE_TIMEOUT:g} s; posfet diagnostics shows the state")
    return future.result()


def _wait(node: Node, done: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    spin([node], until=lambda: done() or time.monotonic() >= end)


def _remedy(node: Node, last: str) -> str:
    """Return what to do where a service is missing: the sensors that run, or how to start one."""
    suffix = "/scene/load" if last == "load" else f"/{last}"
    own = {client.srv_name for client in node.clients}
    known = {name for name, _ in node.get_service_names_and_types()} - own
    others = [name.removesuffix(suffix) for name in known if name.endswith(suffix)]
    if others:
        return f"running are {', '.join(sorted(others))}: choose with --namespace"
    return "is the stack running? Start it with posfet bringup; posfet doctor checks this machine"


def _diagnose(options: argparse.Namespace) -> int:
    namespace = options.namespace
    prefix = f"{checked_namespace(namespace)}/" if namespace else ""
    found: dict[str, DiagnosticStatus] = {}

    def take(message: DiagnosticArray) -> None:
        found.update((status.name, status) for status in message.status if status.name.startswith(prefix))

    with ros([]) as stack:
        node = Node("posfet_command", cli_args=[], use_global_arguments=False)
        stack.callback(node.destroy_node)
        node.create_subscription(DiagnosticArray, "/diagnostics", take, 100)
        _wait(node, lambda: bool(found), options.wait)
        if found:
            _wait(node, lambda: False, options.seconds)
    if not found:
        where = f" of {namespace}" if namespace else ""
        raise ConfigError(f"no diagnostics{where} within {options.wait:g} s; start the stack with posfet bringup")
    print("\n".join(lines(found.values(), options.values)))
    return REFUSED if any(_level(status) for status in found.values()) else 0


def lines(statuses: Any, values: bool) -> list[str]:
    """Return statuses as lines, the worst first, with the meaning and remedy of each fault.

    Parameters
    ----------
    statuses : iterable of DiagnosticStatus
        The statuses.
    values : bool
        Whether to give every value, too.
    """
    result = []
    for status in sorted(statuses, key=lambda each: (-_level(each), each.name)):
        result.append(f"{LEVELS.get(_level(status), '?'):6}{status.name}: {status.message}")
        shown = [pair for pair in status.values if values or pair.key.startswith(FAULT)]
        result += [f"      {pair.key}: {pair.value}" for pair in shown]
    return result


def _level(status: DiagnosticStatus) -> int:
    return status.level[0] if isinstance(status.level, bytes) else int(status.level)
