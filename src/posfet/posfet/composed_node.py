# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The graph in one process, displayed from the nodes themselves."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from posfet.graph import NodeSpec
from posfet.stack_client import StackClient
from posfet_model.ros.run_node import ros
from posfet_model.ros.start import loading

if TYPE_CHECKING:
    from posfet.composed_graph import Graph


def _served(stack: ExitStack, client: StackClient, graph: Graph, port: int) -> str:
    """Return the link to the browser view, which is served until the stack of contexts ends."""
    from posfet.web.link import served_link  # noqa: PLC0415  # a start without a page needs neither this
    from posfet.web.recording import Recording  # noqa: PLC0415  # nor this
    from posfet.web.viewed import Viewed  # noqa: PLC0415  # nor this

    return served_link(stack, [Viewed(client, graph, Recording(client.namespace))], port)


def run(specs: Sequence[NodeSpec], seconds: float, web_port: int | None = None) -> int:
    """Run the graph and display it for `seconds` [s] or until Ctrl-C, and return the exit code.

    Raises ConfigError, one line, if a parameter or file cannot be used.

    Parameters
    ----------
    specs : sequence of NodeSpec
        Nodes; the source of scans is last.
    seconds : float
        Duration [s].
    web_port : int, optional
        Port of the browser view, 0 for any; None: no browser view.
    """
    with ros(["--ros-args", "--log-level", specs[0].log_level, *specs[0].ros_words]) as stack:
        # The first node makes the participant: others on the network discover it while the rest is loaded.
        client = StackClient(specs[0].namespace, specs[0].ros_words)
        stack.callback(client.destroy_node)
        with loading():
            from posfet.composed_graph import Graph  # noqa: PLC0415  # loaded meanwhile
            from posfet.display_loop import display, show  # noqa: PLC0415  # and this

            graph = Graph(specs)
        stack.callback(graph.destroy)
        link = "" if web_port is None else _served(stack, client, graph, web_port)
        with display(graph, client, link) as screen:
            graph.start()
            client.follow()
            return show(screen, [*graph, client], seconds, graph.state, lambda: graph.finished)
    return 0
