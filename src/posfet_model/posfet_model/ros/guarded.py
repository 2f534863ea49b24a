"""Callbacks whose failure is reported instead of ending the node and with it the flow of scans."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from rclpy.node import Node


def answering(node: Node, callback: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a service callback that answers with the failure of `callback`, and logs it with its place.

    Parameters
    ----------
    node : Node
        Node whose log is used.
    callback : callable
        Callback of a service whose response has `success` and `message`.
    """

    def answer(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:  # whatever it is, scans must go on
            node.get_logger().error(f"a service failed:\n{traceback.format_exc()}")
            return type(response)(success=False, message=f"internal error, see the log of the node: {_named(error)}")

    return answer


def reporting(node: Node, callback: Callable[[], None]) -> Callable[[], None]:
    """Return a timer callback for diagnostics that logs a failure of `callback`, each kind once.

    Parameters
    ----------
    node : Node
        Node whose log is used.
    callback : callable
        Callback of a timer.
    """
    known: set[str] = set()

    def report() -> None:
        try:
            callback()
        except Exception as error:  # whatever it is, scans must go on
            name = _named(error)
            if node.context.ok() and name not in known:  # else the process is shutting down
                known.add(name)
                node.get_logger().error(f"diagnostics failed:\n{traceback.format_exc()}")

    return report


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
