# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lifecycle nodes that activate themselves by default: common base of the model, the driver and the simulated board."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.parameter_service import ParameterService

from posfet_model.config import ConfigError
from posfet_model.ros.supervision import SupervisedNode, described

AT_ONCE = 1e-3
"""Period of a timer that goes off as soon as an executor spins [s]."""


def _refusing(change_state: Callable[..., Any]) -> Callable[..., Any]:
    """Return rclpy's transition service, which refuses an invalid transition instead of ending the process."""

    def change(request: Any, response: Any) -> Any:
        try:
            return change_state(request, response)
        except rclpy_implementation.RCLError:  # rcl has logged it
            response.success = False
            return response

    return change


class SupervisedLifecycleNode(SupervisedNode, LifecycleNode):  # type: ignore[misc]  # rclpy has no types
    """A supervised node with the transitions of a ROS lifecycle node.

    Parameters
    ----------
    node_name : str
        Name of the node.
    **node_arguments
        Arguments of rclpy's LifecycleNode.
    """

    EXPECTED: tuple[type[Exception], ...] = (ConfigError,)
    """Errors of configure whose text says all; the place of others is reported, too."""
    parameters: Mapping[str, Any]
    """Checked parameters by name, `autostart` among them."""

    def __init__(self, node_name: str, **node_arguments: Any) -> None:
        self._parameter_services = node_arguments.pop("start_parameter_services", True)
        super().__init__(node_name, start_parameter_services=False, **node_arguments)
        self._service_change_state.callback = _refusing(self._service_change_state.callback)
        self._starting = False
        self.refusal = ""
        """Why the last configure failed, in one line; '' before the first failure."""
        self._serve_timer = self.create_timer(AT_ONCE, self._begin_to_serve)

    def serve(self) -> None:
        """Create the services and diagnostics, which only an executor serves: called when one begins to spin."""
        if self._parameter_services:
            ParameterService(self)

    def _begin_to_serve(self) -> None:
        self._serve_timer.cancel()
        self.serve()

    def destroy_node(self) -> None:
        """Release the node and its participant; rclpy leaves its state machine, which holds both, to the collector."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def start(self) -> None:
        """Configure and activate, unless the parameter autostart is false.

        Raises
        ------
        ConfigError
            When the node cannot be configured; one line.
        """
        if not self.parameters["autostart"]:
            return
        self._starting = True
        configured = self.trigger_configure()
        self._starting = False
        if configured != TransitionCallbackReturn.SUCCESS:
            raise ConfigError(f"{self.get_fully_qualified_name()}: {self.refusal}")
        self.trigger_activate()

    def configured(self, begin: Callable[[], None], end: Callable[[], None]) -> TransitionCallbackReturn:
        """Return the result of `begin`; after an error, which rclpy would swallow, it is logged and `end` called.

        Parameters
        ----------
        begin : callable
            Acquires what the node needs.
        end : callable
            Releases it.
        """
        try:
            begin()
        except Exception as error:
            self.refusal = str(error) if isinstance(error, self.EXPECTED) else described(error)
            if not self._starting:  # else `start` raises it
                self.get_logger().error(self.refusal)
            end()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS
