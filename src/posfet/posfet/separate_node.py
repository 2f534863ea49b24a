# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The graph with one process for each node, displayed from its topics."""

from __future__ import annotations

from collections.abc import Sequence

from posfet.display_loop import display, show
from posfet.graph import NodeSpec
from posfet.processes import Processes
from posfet.stack_client import StackClient
from posfet.view_node import ViewNode
from posfet.web.link import served_link
from posfet.web.recording import Recording
from posfet.web.viewed import Viewed
from posfet_model.ros.run_node import ros


def run(specs: Sequence[NodeSpec], seconds: float, web_port: int | None = None) -> int:
    """Run the nodes and display them for `seconds` [s], until Ctrl-C, or until one ends, and return the exit code.

    The exit code is that of a node that failed, which then has printed the reason. Raises ConfigError if an executable
    is not installed.

    Parameters
    ----------
    specs : sequence of NodeSpec
        Nodes; the source of scans is last.
    seconds : float
        Duration [s].
    web_port : int, optional
        Port of the browser view, 0 for any; None: no browser view.
    """
    with ros(specs[0].ros_words) as stack:
        client = StackClient(specs[0].namespace, specs[0].ros_words)
        stack.callback(client.destroy_node)
        client.follow()
        view = ViewNode(client, specs[0].ros_words)
        stack.callback(view.destroy_node)
        link = served_link(stack, [Viewed(client, view, Recording(client.namespace))], web_port)
        with Processes(specs) as processes, display(view, client, link) as screen:
            code = show(screen, [client], seconds, view.state, stop=processes.ended)
            return processes.exit_code() or code
    return 0
