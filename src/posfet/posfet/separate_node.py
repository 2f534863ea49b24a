"""The graph as one process per node, shown from its topics."""

from __future__ import annotations

from collections.abc import Sequence

from posfet.graph import NodeSpec
from posfet.processes import Processes
from posfet.screen import Screen
from posfet.show_node import show
from posfet.view_node import ViewNode
from posfet_model.ros.run_node import ros

FAILED = 1


def run(specs: Sequence[NodeSpec], seconds: float) -> int:
    """Run the nodes and show them for `seconds` [s], until Ctrl-C, or until one of them ends; return the exit code.

    1 when a node failed, which has then said why. Raises ConfigError when an executable is not installed.
    """
    with ros([]) as stack:
        node = ViewNode(specs[0].namespace)
        stack.callback(node.destroy_node)
        with Processes(specs) as processes, Screen(node) as screen:
            code = show(screen, [node], seconds, node.state, stop=processes.ended)
            return FAILED if processes.failed() else code
    return 0
