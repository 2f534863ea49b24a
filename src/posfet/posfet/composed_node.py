# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The graph in one process, displayed from the nodes themselves."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import ExitStack
from typing import TYPE_CHECKING

from posfet.display_node import display_node
from posfet.ros_arguments import RosArguments
from posfet_model.ros.run_node import ros
from posfet_model.ros.start import loading

if TYPE_CHECKING:
    from posfet.composed_graph import Graph
    from posfet.stack_client import StackClient


def _served(stack: ExitStack, client: StackClient, graph: Graph, port: int) -> str:
    """Return the link to the browser view, which is served until the stack of contexts ends."""
    from posfet.web.link import served_link  # noqa: PLC0415  # a start without a page needs neither this
    from posfet.web.recording import Recording  # noqa: PLC0415  # nor this
    from posfet.web.viewed import Viewed  # noqa: PLC0415  # nor this

    return served_link(stack, [Viewed(client, graph, Recording(client.namespace))], port)


def run(arguments: Mapping[str, str], given: RosArguments, seconds: float, web_port: int | None = None) -> int:
    """Run the graph and display it for `seconds` [s] or until Ctrl-C, and return the exit code.

    Raises ConfigError, one line, if a parameter or file cannot be used.

    Parameters
    ----------
    arguments : mapping of str to str
        Every argument by name, `params_file` among them.
    given : RosArguments
        ROS arguments for the nodes.
    seconds : float
        Duration [s].
    web_port : int, optional
        Port of the browser view, 0 for any; None: no browser view.
    """
    namespace = given.within(arguments["namespace"])
    with ros(["--ros-args", "--log-level", arguments["log_level"], *given.words]) as stack:
        with loading():
            # The first node makes the participant: others on the network discover it while the rest is loaded.
            node = display_node(namespace, given.words)
            stack.callback(node.destroy_node)
            from posfet.composed_graph import Graph  # noqa: PLC0415  # loaded meanwhile
            from posfet.graph import graph  # noqa: PLC0415  # and this

            nodes = Graph(graph(arguments, arguments["params_file"], given))
        stack.callback(nodes.destroy)
        nodes.start()
        with loading():
            from posfet.display_loop import display, show  # noqa: PLC0415  # loaded while scans are processed
            from posfet.stack_client import StackClient  # noqa: PLC0415  # and this
        client = StackClient(node, namespace)
        link = "" if web_port is None else _served(stack, client, nodes, web_port)
        with display(nodes, client, link, outlived=True) as screen:
            code = show(screen, [*nodes, node], seconds, nodes.state, lambda: nodes.finished)
        if ending := nodes.ending():  # the process ends before the next report
            print(f"posfet: {ending}", file=sys.stderr)
        return code
    return 0
