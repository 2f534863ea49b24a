# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Starts subscribers on a running stack, kills them with SIGKILL, and measures how long each waits for a message.

In the folder test:

python -m support.late_subscribers --kills 200 --busy 2

With --realtime (for root) the stack and its subscribers get a processor before all others: what then delays them is
not the load.

Subscribers are what a user would start: processes of their own, without settings of the middleware. Several live at a
time; all are killed at a random moment after their first messages, in the middle of the traffic.
"""

from __future__ import annotations

import argparse
import importlib
import math
import multiprocessing
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import NamedTuple

from support.shared_memory import names, remove_abandoned

PATIENCE = 120.0
"""Time after which a subscriber counts as one that gets nothing [s]."""
LONGEST_LIFE = 0.3
"""Longest time between the first messages and the kill [s]."""
TOGETHER = 3
"""Number of subscribers that live at a time."""
TARGET = 0.5
"""Wanted longest time to the first message [s]."""
REALTIME = 1
"""Priority with --realtime: the lowest that comes before all processes without one."""
BUSY = "import os\nos.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))\nwhile True: pass"
"""Program of a process that loads the machine, with the usual priority."""
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
MIDDLEWARE = "dds."
"""Start of the names of Fast DDS' threads."""


class Wait(NamedTuple):
    """How long a subscriber waited."""

    seconds: float
    """Time between subscription and first message [s]; inf: none within PATIENCE."""
    matched: float
    """Part of it until the subscriber knows the publisher [s]; in the rest that learns of the subscriber, and sends."""
    processor: float
    """Time for which threads that the message depends on could have run, but had no processor [s], added up: those of
    the subscriber, those of the stack's middleware, and after the match the one of the stack that waits longest."""

    @property
    def with_a_processor(self) -> float:
        """Time that no load explains [s]: what a machine with a processor for each thread needs, at most."""
        return self.seconds - self.processor


def queued(process: int, name: str = "") -> dict[str, float]:
    """Return how long each thread of a process has waited for a processor so far [s], those whose name begins so."""
    found = {}
    for task in Path(f"/proc/{process}/task").glob("*"):
        with suppress(OSError):  # it has just ended
            if (task / "comm").read_text(encoding="utf-8").startswith(name):
                found[task.name] = int((task / "schedstat").read_text(encoding="utf-8").split()[1]) * 1e-9
    return found


def since(before: dict[str, float], now: dict[str, float]) -> list[float]:
    """Return how much longer each thread has waited by now [s]; a thread that is new has begun with nothing."""
    return [seconds - before.get(name, 0.0) for name, seconds in now.items()]


def subscribe(topic: str, stack: int, results: Connection) -> None:
    """Subscribe to contacts, send how long the first message took, and go on until killed."""
    rclpy = importlib.import_module("rclpy")
    events = importlib.import_module("rclpy.event_handler").SubscriptionEventCallbacks
    message_type = importlib.import_module("posfet_msgs.msg").TactileContacts
    rclpy.init(args=[])  # those of this process are for the bring-up
    node = rclpy.create_node(f"late_{os.getpid()}")
    received: list[float] = []
    known: list[float] = []
    at_match: dict[str, float] = {}

    def match(_: object) -> None:
        if not known:
            known.append(time.monotonic() - begin)
            at_match.update(queued(stack))

    def first(_: object) -> None:
        if not received:
            received.append(time.monotonic() - begin)
            lacked = sum(since(own, queued(os.getpid()))) + sum(since(answering, queued(stack, MIDDLEWARE)))
            sending = max(since(at_match, queued(stack)), default=0.0) if known else 0.0
            results.send(Wait(received[0], (known or received)[0], lacked + sending))

    own, answering = queued(os.getpid()), queued(stack, MIDDLEWARE)
    begin = time.monotonic()
    node.create_subscription(message_type, topic, first, 10, event_callbacks=events(matched=match))
    rclpy.spin(node)


@contextmanager
def subscriber(context: ForkServerContext, topic: str, stack: int) -> Iterator[Connection]:
    """Run a subscriber during the block, and kill it at its end."""
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=subscribe, args=(topic, stack, sender), daemon=True)
    process.start()
    sender.close()
    try:
        yield receiver
    finally:
        process.kill()  # SIGKILL
        process.join()


def waits(
    kills: int, stack: int, seed: int = 0, topic: str = "/tactile/contacts", together: int = TOGETHER
) -> list[Wait]:
    """Return how long each of `kills` subscribers waited for a message of the process `stack`; kill them in groups."""
    noise, measured = random.Random(seed), []
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["rclpy", "posfet_msgs.msg", __name__])
    while len(measured) < kills:
        with ExitStack() as group:
            number = min(together, kills - len(measured))
            receivers = [group.enter_context(subscriber(context, topic, stack)) for _ in range(number)]
            for receiver in receivers:
                measured.append(receiver.recv() if receiver.poll(PATIENCE) else Wait(math.inf, math.inf, 0.0))
            time.sleep(noise.random() * LONGEST_LIFE)
    return measured


@contextmanager
def running(command: Sequence[str], signal_at_end: str = "terminate") -> Iterator[subprocess.Popen[str]]:
    """Run a process during the block; its output is dropped."""
    with tempfile.TemporaryFile("w+") as log, subprocess.Popen(command, stdout=log, stderr=log, text=True) as process:
        try:
            yield process
        finally:
            getattr(process, signal_at_end)()


@contextmanager
def clean_shared_memory() -> Iterator[None]:
    """Remove what processes that were killed in the block leave in shared memory."""
    before = names()
    try:
        yield
    finally:
        removed = remove_abandoned(names() - before)
        print(f"removed from shared memory: {len(removed)}, left: {len(names() - before)}")


def _spread(times: Sequence[float]) -> str:
    """Return median, nine tenths and maximum of sorted times."""
    most = times[int(0.9 * len(times))]
    return f"{statistics.median(times):.3f} s (median), {most:.3f} s (90 %), {times[-1]:.3f} s (all)"


def summary(measured: Sequence[Wait]) -> str:
    """Return the distribution in a few lines."""
    times = sorted(wait.seconds for wait in measured)
    matched = sorted(wait.matched for wait in measured)
    sent = sorted(wait.seconds - wait.matched for wait in measured if math.isfinite(wait.seconds)) or [math.inf]
    late = [wait for wait in measured if wait.seconds > TARGET]
    idle = sorted(wait.with_a_processor for wait in measured)
    return (
        f"{len(times)} subscribers: first message after {_spread(times)}\n"
        f"until the publisher is known: {_spread(matched)}; from then on: {_spread(sent)}\n"
        f"above {TARGET} s: {len(late)}; without the time for a processor: {sum(wait > TARGET for wait in idle)}, "
        f"longest {idle[-1]:.3f} s\n"
        f"slowest: {' '.join(f'{each:.2f}' for each in times[-12:])}"
    )


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--busy", type=int, default=2, help="processes that load the machine")
    parser.add_argument("--realtime", action="store_true", help="the stack and subscribers come before all others")
    parser.add_argument("--together", type=int, default=TOGETHER, help="subscribers at a time")
    parser.add_argument("--stack-profile", default="", help="settings of the stack instead of its own, for comparison")
    parser.add_argument("arguments", nargs="*", metavar="name:=value", help="of the bring-up")
    options = parser.parse_args(words)
    with ExitStack() as stack:
        domains = importlib.import_module("domain_coordinator")
        os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(domains.domain_id()))
        stack.enter_context(clean_shared_memory())
        if options.realtime:  # also of all processes that are started from here
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(REALTIME))
        if options.stack_profile:
            os.environ[PROFILES] = options.stack_profile
        bringup = stack.enter_context(running(["posfet", "bringup", *options.arguments]))
        os.environ.pop(PROFILES, None)
        waits(1, bringup.pid)  # until the stack is up
        for _ in range(options.busy):
            stack.enter_context(running([sys.executable, "-c", BUSY], "kill"))
        measured: list[Wait] = []
        while len(measured) < options.kills:
            number = min(20, options.kills - len(measured))
            measured += waits(number, bringup.pid, len(measured), together=options.together)
            print(summary(measured), flush=True)
        assert bringup.poll() is None, "the stack has ended"


if __name__ == "__main__":
    main()
