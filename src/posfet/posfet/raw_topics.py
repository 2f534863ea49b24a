# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Topics of running stacks as serialized messages, for what records or counts them without reading them."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from importlib import import_module
from operator import itemgetter
from typing import Any, Final

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from posfet_model.config import ConfigError

COMMON: Final = ("/diagnostics", "/tf", "/tf_static")
"""Topics of all sensors that belong to all topics of a sensor."""
DEPTH: Final = 1000
"""Depth of the queue of a topic: one second at 1 kHz."""
DISCOVERY_PERIOD: Final = 0.25
"""Period at which new topics are looked for [s]."""
READ_PERIOD: Final = 0.02
"""Period at which queues are read [s]: a small part of what they hold, and many messages each time."""


def add_topic_options(parser: argparse.ArgumentParser, example: str, note: str = "") -> None:
    """Add the options --namespace and --topics, which say what a command subscribes to.

    Parameters
    ----------
    parser : ArgumentParser
        Parser of the command.
    example : str
        Topics of each sensor, as an example.
    note : str, optional
        Addition to the help.
    """
    parser.add_argument(
        "--namespace", nargs="+", default=["tactile"], help="namespaces of the sensors (default: tactile)"
    )
    parser.add_argument(
        "--topics",
        nargs="+",
        default=(),
        metavar="TOPIC",
        help=f"topics of each sensor, such as {example}, or full names (default: all, /diagnostics and /tf{note})",
    )


class RawTopics(Node):  # type: ignore[misc]  # rclpy has no types
    """Subscribes to topics of sensors, whatever their types; what is done with their messages, a subclass says.

    Topics that appear later are subscribed to from then on. Queues are read at a period of their own, by a timer of
    this node. An executor that is woken by each message takes several times the processor time, more than there is
    for all topics of a sensor at 1 kHz. So the subscriptions are those of a second node, which no executor knows.

    Parameters
    ----------
    name : str
        Name of the node, to which the process is added.
    namespaces : sequence of str
        Namespaces of the sensors, without slashes around them.
    topics : sequence of str
        Topics within each namespace, or full names with a slash at the front; none: all, and those of `COMMON`.
    best_effort : bool, optional
        Whether lost messages are not sent again; default: as the publishers offer.
    **node_arguments : object
        Arguments of the node, as for `rclpy.node.Node`.
    """

    def __init__(
        self,
        name: str,
        namespaces: Sequence[str],
        topics: Sequence[str] = (),
        best_effort: bool = False,
        **node_arguments: Any,
    ) -> None:
        settings = {"cli_args": [], "use_global_arguments": False, **node_arguments}
        super().__init__(f"{name}_{os.getpid()}", **settings)
        self._subscriber = Node(
            f"{name}_{os.getpid()}_topics", start_parameter_services=False, enable_rosout=False, **settings
        )
        self._queues: list[tuple[Subscription, Callable[[bytes, int], None]]] = []
        self._prefixes = tuple(f"/{namespace}/" for namespace in namespaces)
        self._wanted = {
            topic if topic.startswith("/") else f"{prefix}{topic}" for topic in topics for prefix in self._prefixes
        }
        self._best_effort = best_effort
        self._known: set[str] = set()
        self.subscribed: list[str] = []
        """Names of the topics that are subscribed to."""
        self._discover()
        self.create_timer(DISCOVERY_PERIOD, self._discover)
        self.create_timer(READ_PERIOD, self.read)

    def destroy_node(self) -> None:
        """Destroy this node and its subscriptions."""
        self._subscriber.destroy_node()
        super().destroy_node()

    def read(self) -> None:
        """Hand on what has arrived, in the order of arrival."""
        arrived = []
        for subscription, take in self._queues:
            with subscription.handle:
                for _ in range(DEPTH):
                    message = subscription.handle.take_message(subscription.msg_type, True)
                    if message is None:
                        break
                    data, details = message
                    arrived.append((details["received_timestamp"], take, data))
        for received, take, data in sorted(arrived, key=itemgetter(0)):
            take(data, received)

    @property
    def missing(self) -> list[str]:
        """Chosen topics that nobody publishes; where all are wanted, the namespaces without any, as ``/thumb/...``."""
        if self._wanted:
            return sorted(self._wanted - set(self.subscribed))
        found = tuple(self.subscribed)
        return [f"{prefix}..." for prefix in self._prefixes if not any(name.startswith(prefix) for name in found)]

    def opened(self, name: str, kind: str, offered: Sequence[QoSProfile]) -> Callable[[bytes, int], None]:
        """Return what takes the messages of a topic that has been found; a subclass defines it.

        Parameters
        ----------
        name : str
            Full name of the topic.
        kind : str
            Its type, such as posfet_msgs/msg/TactileRaw.
        offered : sequence of QoSProfile
            What its publishers offer.

        Returns
        -------
        callable
            Takes each serialized message, and the time of its arrival [ns].
        """
        raise NotImplementedError

    def _discover(self) -> None:
        for name, kinds in self.get_topic_names_and_types():
            wanted = name in self._wanted if self._wanted else name.startswith(self._prefixes) or name in COMMON
            if wanted and name not in self._known and self.get_publishers_info_by_topic(name):
                self._known.add(name)
                try:
                    self._subscribe(name, kinds[0])
                except (ConfigError, ImportError, AttributeError) as error:
                    self.get_logger().warning(f"{name}: left out: {' '.join(str(error).split())}")

    def _subscribe(self, name: str, kind: str) -> None:
        package, _, message = kind.replace("/msg/", "/").partition("/")
        offered = [publisher.qos_profile for publisher in self.get_publishers_info_by_topic(name)]
        reliability = _common(offered, "reliability", ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
        qos = QoSProfile(
            depth=DEPTH,
            reliability=ReliabilityPolicy.BEST_EFFORT if self._best_effort else reliability,
            durability=_common(offered, "durability", DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE),
        )
        message_type = getattr(import_module(f"{package}.msg"), message)
        take = self.opened(name, kind, offered)
        self._queues.append((self._subscriber.create_subscription(message_type, name, take, qos, raw=True), take))
        self.subscribed.append(name)


def _common(offered: Sequence[Any], policy: str, best: Any, other: Any) -> Any:
    """Return the best policy if all publishers offer it, so that the subscription fits all of them."""
    return best if all(getattr(profile, policy) == best for profile in offered) else other
