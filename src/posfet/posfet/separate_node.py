# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The graph with one process for each node, displayed from its topics."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from posfet.display_loop import display, show
from posfet.display_node import display_node
from posfet.graph import graph
from posfet.processes import Processes
from posfet.ros_arguments import RosArguments
from posfet.stack_client import StackClient
from posfet.view_node import ViewNode
from posfet.web.link import served_link
from posfet.web.recording import Recording
from posfet.web.viewed import Viewed
from posfet_model.ros.run_node import ros


def run(arguments: Mapping[str, str], given: RosArguments, seconds: float, web_port: int | None = None) -> int:
    """Run the nodes and display them for `seconds` [s], until Ctrl-C, or until one ends, and return the exit code.

    The exit code is that of a node that failed, which then has printed the reason. Raises ConfigError, one line, if a
    file cannot be used or an executable is not installed.

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
    specs = graph(arguments, arguments["params_file"], given)
    with ros(given.words) as stack:
        node = display_node(specs[0].namespace, given.words)
        stack.callback(node.destroy_node)
        client = StackClient(node, specs[0].namespace)
        view = ViewNode(client, given.words)
        stack.callback(view.destroy_node)
        link = served_link(stack, [Viewed(client, view, Recording(client.namespace))], web_port)
        with Processes(specs) as processes, display(view, client, link, outlived=True) as screen:
            code = show(screen, [node], seconds, view.state, stop=processes.ended)
            for text in processes.silent_ends():
                print(f"posfet: {text}", file=sys.stderr)
            return processes.exit_code() or code
    return 0
