# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet bandwidth`: messages and bytes of each topic of running stacks, and what a network interface carried."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from rclpy.qos import QoSProfile

from posfet.raw_topics import RawTopics, add_topic_options
from posfet_model.command_line import checked_namespace, positive
from posfet_model.config import ConfigError
from posfet_model.ros.exit_codes import exit_code
from posfet_model.ros.run_node import ros, spin

DURATION: Final = 5.0
"""Default time during which messages are counted [s]."""
SETTLING: Final = 1.0
"""Time between the first message and the begin of the count, in which the other topics are found [s]."""
DISCOVERY_TIMEOUT: Final = 10.0
"""Time in which a first message arrives [s]."""
INTERFACES: Final = Path("/proc/net/dev")
"""Counters of the network interfaces that this process sees."""
_RECEIVED, _SENT = 0, 8
"""Columns of the bytes in `INTERFACES`."""


@dataclass
class Count:
    """Messages of one topic."""

    messages: int = 0
    bytes: int = 0
    """Sum of the serialized sizes, without headers of the middleware and the network."""


@dataclass(frozen=True)
class Traffic:
    """What was counted in a time."""

    seconds: float
    """Duration of the count [s]."""
    topics: Mapping[str, Count]
    """Counts by the full name of the topic."""
    received: int | None = None
    """Bytes that the interface received; None without an interface."""
    sent: int | None = None
    """Bytes that the interface sent."""


class Counter(RawTopics):
    """Counts the messages of topics and their serialized sizes.

    Parameters
    ----------
    namespaces : sequence of str
        Namespaces of the sensors.
    topics : sequence of str
        Topics within each namespace, or full names; none: all.
    best_effort : bool
        Whether lost messages are not sent again.
    **node_arguments : object
        Arguments of the node, as for `rclpy.node.Node`.
    """

    def __init__(
        self, namespaces: Sequence[str], topics: Sequence[str] = (), best_effort: bool = False, **node_arguments: Any
    ) -> None:
        self.counts: dict[str, Count] = {}
        super().__init__("posfet_bandwidth", namespaces, topics, best_effort, **node_arguments)

    def opened(self, name: str, kind: str, offered: Sequence[QoSProfile]) -> Callable[[bytes, int], None]:
        """Return what counts the messages of a topic."""
        self.counts[name] = Count()
        return partial(self._take, name)

    def _take(self, name: str, data: bytes, _received: int) -> None:
        count = self.counts[name]
        count.messages += 1
        count.bytes += len(data)

    def restart(self) -> None:
        """Restart the count."""
        self.counts = {name: Count() for name in self.counts}


def interface_bytes(name: str, path: Path = INTERFACES) -> tuple[int, int]:
    """Return the bytes that a network interface has received and sent.

    Parameters
    ----------
    name : str
        Name of the interface, such as eth0.
    path : Path, optional
        File with the counters, as in `/proc/net/dev`.

    Raises
    ------
    ConfigError
        There is no such interface; one line with those that are there.
    """
    try:
        lines = path.read_text(encoding="ascii").splitlines()[2:]
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; counters of interfaces need Linux") from error
    found = {interface.strip(): values.split() for interface, _, values in (line.partition(":") for line in lines)}
    if name not in found:
        raise ConfigError(f"no interface '{name}', there are {', '.join(sorted(found))}")
    return int(found[name][_RECEIVED]), int(found[name][_SENT])


def table(traffic: Traffic, interface: str = "") -> list[str]:
    """Return what was counted as lines.

    Parameters
    ----------
    traffic : Traffic
        What was counted.
    interface : str, optional
        Name of the interface.
    """
    seconds = traffic.seconds
    width = max([len("sum"), *map(len, traffic.topics)])
    rows = [f"{'topic':{width}} {'1/s':>8} {'B each':>8} {'kB/s':>9}"]
    for name, count in sorted(traffic.topics.items()):
        each = f"{count.bytes / count.messages:.0f}" if count.messages else "-"
        rows.append(f"{name:{width}} {count.messages / seconds:8.1f} {each:>8} {count.bytes / seconds * 1e-3:9.1f}")
    total = sum(count.bytes for count in traffic.topics.values())
    messages = sum(count.messages for count in traffic.topics.values())
    rows.append(f"{'sum':{width}} {messages / seconds:8.1f} {'':8} {total / seconds * 1e-3:9.1f}")
    if traffic.received is not None and traffic.sent is not None:
        received, sent = (value / seconds * 1e-3 for value in (traffic.received, traffic.sent))
        rows.append(f"{interface}: received {received:.1f} kB/s, sent {sent:.1f} kB/s, everything on it")
    return rows


def main(words: Sequence[str] | None = None) -> int:
    """Count for a while and print a table; return 0, or 1, with one line on stderr, if nothing arrives."""
    options = make_parser().parse_args(words)
    return exit_code(lambda: _measure(options))


def _measure(options: argparse.Namespace) -> int:
    namespaces = [checked_namespace(name) for name in options.namespace]
    if options.interface:
        interface_bytes(options.interface)
    with ros([]) as stack:
        node = Counter(namespaces, options.topics, options.best_effort)
        stack.callback(node.destroy_node)
        traffic = _count(node, options)
        missing = node.missing
    if missing:
        raise ConfigError(f"{', '.join(missing)}: nobody publishes it; posfet doctor lists the sensors that run")
    print(json.dumps(asdict(traffic), indent=2) if options.json else "\n".join(table(traffic, options.interface)))
    return 0


def _count(node: Counter, options: argparse.Namespace) -> Traffic:
    """Return what arrives while the node spins, once it is subscribed to what there is."""
    _spin(node, options.wait, lambda: not node.missing and any(count.messages for count in node.counts.values()))
    if not any(count.messages for count in node.counts.values()):
        wanted = ", ".join(f"/{name}/..." for name in options.namespace)
        raise ConfigError(
            f"no message on {wanted} within {options.wait:g} s: start the stack with posfet bringup, or give its "
            "--namespace; with a discovery server set ROS_SUPER_CLIENT=TRUE"
        )
    _spin(node, SETTLING)
    node.restart()
    before = interface_bytes(options.interface) if options.interface else None
    begin = time.monotonic()
    _spin(node, options.seconds)
    seconds = time.monotonic() - begin
    if before is None:
        return Traffic(seconds, node.counts)
    after = interface_bytes(options.interface)
    return Traffic(seconds, node.counts, after[0] - before[0], after[1] - before[1])


def _spin(node: Counter, seconds: float, done: Callable[[], Any] = lambda: False) -> None:
    end = time.monotonic() + seconds
    spin([node], until=lambda: done() or time.monotonic() >= end)


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of `posfet bandwidth`."""
    parser = argparse.ArgumentParser(
        prog="posfet bandwidth",
        description="Count messages and bytes of each topic of running stacks, and what a network interface carries. "
        "A topic is computed and sent while somebody subscribes to it, as this command does.",
    )
    add_topic_options(parser, "contacts image")
    parser.add_argument("--best-effort", action="store_true", help="do not ask for lost messages again")
    parser.add_argument(
        "--interface", default="", metavar="NAME", help="also count the bytes on this one, such as eth0"
    )
    parser.add_argument(
        "--for",
        dest="seconds",
        type=positive,
        default=DURATION,
        help=f"duration of the count [s] (default: {DURATION:g})",
    )
    parser.add_argument(
        "--wait",
        type=positive,
        default=DISCOVERY_TIMEOUT,
        help=f"longest time until the first message [s] (default: {DISCOVERY_TIMEOUT:g})",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
