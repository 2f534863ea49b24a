# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Work that the stack leaves out: messages without subscribers."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.fronts.interleaved import interleaved
from benchmarks.fronts.labelling import SENSOR, recorded
from benchmarks.outcome import shown
from posfet_model._lib.units import NANOSECONDS
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.ros.map_outputs import MapOutputs
from posfet_model.ros.model_outputs import ModelOutputs
from posfet_model.ros.output_qos import OUTPUT_DEPTH, output_qos
from posfet_model.ros.subscriptions import REFRESH_PERIOD, SubscriptionCache
from posfet_model.sensor.scan import Scan

SCANS = 500
PERIODS = {"every scan": 0.0, "every 10 ms": 0.01, "every 100 ms": 0.1, "every 1 s": 1.0}
"""How often a publisher's subscribers are counted [s]."""

TRIALS = 40
"""Instants at which a subscriber arrives."""


def measure(effort: Effort) -> list[Front]:
    """Return the front of messages."""
    return [_messages(60 if effort.short else SCANS, effort)]


class Outputs:
    """The topics of a model node, with subscribers of `contacts` alone."""

    def __init__(self, node: Any) -> None:
        self._outputs = ModelOutputs(node, True, output_qos("reliable", OUTPUT_DEPTH), display_rate=30.0)
        self._outputs.add(MapOutputs(node, True, output_qos("reliable", OUTPUT_DEPTH), self._outputs.display))
        self._outputs.describe(SENSOR, "array")
        self._all = set(self._outputs._subscriptions._publishers)
        self._contacts = {self._outputs.contacts}

    def with_period(self, period: float, scans: Sequence[Scan]) -> None:
        """Process scans and publish contacts; count subscribers once in a period [s]."""
        reconstructor, cache, step = Reconstructor(SENSOR), self._outputs._subscriptions, 1 / SENSOR.can.scan_rate
        cache._period = int(period * NANOSECONDS) // len(self._all)
        asked = period == 0.0
        for index, scan in enumerate(scans):
            now = int((1.0 + index * step) * NANOSECONDS)
            result = reconstructor.process(scan)
            if asked:
                for publisher in self._all:
                    publisher.get_subscription_count()
            else:
                cache.subscribed(now)
            self._outputs.publish(reconstructor, result, self._contacts)

    def everything(self, scans: Sequence[Scan]) -> None:
        """Process scans and publish every message."""
        reconstructor = Reconstructor(SENSOR)
        reconstructor.vibration_wanted = True
        for scan in scans:
            self._outputs.publish(reconstructor, reconstructor.process(scan), self._all)

    @property
    def topics(self) -> int:
        """Number of topics."""
        return len(self._all)


class Subscribed:
    """A publisher that is subscribed to from some time on."""

    def __init__(self) -> None:
        self.subscribers = 0

    def get_subscription_count(self) -> int:
        """Return the number of subscriptions."""
        return self.subscribers


def longest_wait(period: float, topics: int) -> float:
    """Return the longest time from a subscription to the scan that is published to it, over many instants [s]."""
    step, worst = 1 / SENSOR.can.scan_rate, 0.0
    random = np.random.default_rng(1)
    for _ in range(TRIALS):
        publishers = [Subscribed() for _ in range(topics)]
        cache = SubscriptionCache(*publishers, period=int(period * NANOSECONDS) // topics)
        begin, chosen = float(random.uniform(2.0, 4.0)), publishers[int(random.integers(topics))]
        for index in range(10_000):
            now = 1.0 + index * step
            chosen.subscribers = int(now >= begin)
            if chosen in cache.subscribed(int(now * NANOSECONDS)):
                worst = max(worst, now - begin)
                break
    return worst


def _messages(scans: int, effort: Effort) -> Front:
    """Compare publishing everything with counting subscribers now and then."""
    import rclpy  # noqa: PLC0415  # this part alone needs the middleware

    images = recorded("slide", scans)[0]
    context = rclpy.Context()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(context=context, domain_id=1 + os.getpid() % 100)  # not that of a stack that runs here
    try:
        node = rclpy.create_node("fronts", context=context)
        outputs = Outputs(node)
        calls: dict[str, Callable[[], object]] = {
            name: (lambda period=period: outputs.with_period(period, images)) for name, period in PERIODS.items()
        }
        calls["everything"] = lambda: outputs.everything(images)
        seconds = interleaved(calls, effort.repeats)
        topics = outputs.topics
        node.destroy_node()
    finally:
        context.shutdown()
    step = 1 / SENSOR.can.scan_rate
    waits = {name: longest_wait(period, topics) if period else step for name, period in PERIODS.items()}
    lazy = "what is subscribed"
    choices = [
        Choice(lazy, f"counted {name}", 1e3 * waits[name], tuple(each / scans for each in seconds[name]))
        for name in PERIODS
    ]
    choices.append(Choice("every message", "", 0.0, tuple(each / scans for each in seconds["everything"])))
    own, every = choices[2], choices[-1]
    age = topics * REFRESH_PERIOD / NANOSECONDS
    return Front(
        "skipped_messages",
        "Skipped work, messages without subscribers",
        "one scan from counts to published messages, contacts subscribed",
        "longest wait of a new subscriber [ms]",
        f"{TRIALS} subscriptions at random instants to one of {topics} topics",
        0.0,
        tuple(choices),
        own.name,
        (
            Check("longest wait over the age that the stack allows [1]", waits["every 100 ms"] / age, 0.5, 1.5),
            Check("longest wait over the period, with one count in a second [1]", waits["every 1 s"], 0.5, 1.5),
        ),
        f"Publishing all {topics} topics takes {shown(every.median / own.median)} times as long as contacts alone, and "
        f"nobody reads them. Skipping costs a new subscriber at most {shown(own.error)} ms until its first message: "
        "subscribe before the scans that matter.",
        why_not="Counting is a small part of a scan, so that another rate differs by noise alone.",
        question="messages that nobody reads",
        rival=every.name,
        swept=True,
    )
