# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Measures what stacks on several hosts cost on the network: discovery, topics, reliable and best-effort subscribers.

As root, in the folder test:

python -m support.many_hosts --hosts 4 --rate 100

Each host is a network namespace with one simulated board; one more, the desk, subscribes. Scans come at a rate that one
machine sustains for all of them; sizes of messages do not depend on it.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from posfet_model.sensor import description
from support.network_namespaces import INTERFACE, MULTICAST, WAYS, Host, discovery, hosts, why_not

SHIPPED = Path(description.__file__).with_name("sensors") / "posfet_5x5.yaml"
COUNTERS = "/proc/net/dev"
IDLE = 5.0
"""Time during which discovery alone is counted [s]."""
TIMEOUT = 300.0


def carried(made: Sequence[Host]) -> tuple[int, int]:
    """Return the bytes and packets that all hosts have sent."""
    columns = [host.run(["grep", INTERFACE, COUNTERS], TIMEOUT).stdout.partition(":")[2].split() for host in made]
    return sum(int(each[8]) for each in columns), sum(int(each[9]) for each in columns)


def count(desk: Host, words: Sequence[str], environment: dict[str, str]) -> tuple[dict[str, Any], float]:
    """Return what `posfet bandwidth` counts on the desk, and the time it took beside the count [s]."""
    begin = time.monotonic()
    command = ["posfet", "bandwidth", "--interface", INTERFACE, "--json", "--wait", f"{TIMEOUT:g}", *words]
    done = desk.run(command, 2 * TIMEOUT, **environment)
    if done.returncode:
        raise SystemExit(done.stderr.strip())
    traffic = json.loads(done.stdout)
    return traffic, time.monotonic() - begin - traffic["seconds"]


def measure(way: str, number: int, sensor: Path, seconds: float) -> list[str]:
    """Return what was measured in one way of discovery, as lines."""
    names = [f"host{each}/palm" for each in range(number)]
    with ExitStack() as stack:
        *robots, desk = made = stack.enter_context(hosts(number + 1, multicast=way == MULTICAST))
        there, here = stack.enter_context(discovery(way, made))
        for robot, name in zip(robots, names, strict=True):
            words = ["posfet", "bringup", f"namespace:={name}", f"sensor_file:={sensor}"]
            stack.enter_context(robot.running(words, **there))
        select = ["--for", f"{seconds:g}", "--namespace", *names, "--topics", "contacts"]
        lines = []
        for kind in ([], ["--best-effort"]):
            traffic, spent = count(desk, [*select, *kind], here)
            total = sum(each["bytes"] for each in traffic["topics"].values()) / traffic["seconds"]
            messages = sum(each["messages"] for each in traffic["topics"].values()) / traffic["seconds"]
            received, sent = (traffic[each] / traffic["seconds"] for each in ("received", "sent"))
            lines.append(
                f"  contacts of {number} hosts, {'best effort' if kind else 'reliable'}: {messages:.0f} messages/s, "
                f"{total * 1e-3:.1f} kB/s in messages, {received * 1e-3:.1f} kB/s received, {sent * 1e-3:.1f} kB/s sent"
                f"; start, discovery and end of the subscriber {spent:.1f} s"
            )
        time.sleep(IDLE)  # until the subscriber is forgotten
        before = carried(made)
        time.sleep(IDLE)
        sent_bytes, packets = ((after - begin) / IDLE for after, begin in zip(carried(made), before, strict=True))
        lines.append(f"  without a subscriber: {sent_bytes * 1e-3:.1f} kB/s in {packets:.0f} packets/s of all hosts")
    return [f"{way}:", *lines]


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hosts", type=int, default=4)
    parser.add_argument("--rate", type=int, default=100, help="scans per second of each board")
    parser.add_argument("--for", dest="seconds", type=float, default=5.0, help="duration of each count [s]")
    options = parser.parse_args(words)
    if reason := why_not():
        sys.exit(reason)
    os.environ.setdefault("ROS_DOMAIN_ID", "0")
    with tempfile.TemporaryDirectory() as folder:
        sensor = Path(folder) / "sensor.yaml"
        text = re.sub(r"scan_rate_Hz: [\d.]+", f"scan_rate_Hz: {options.rate}.0", SHIPPED.read_text(encoding="utf-8"))
        sensor.write_text(text, encoding="utf-8")
        for way in WAYS:
            print("\n".join(measure(way, options.hosts, sensor, options.seconds)), flush=True)


if __name__ == "__main__":
    main()
