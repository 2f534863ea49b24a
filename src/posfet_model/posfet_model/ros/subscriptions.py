# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Cached subscription counts, so that only messages with subscribers are computed."""

from __future__ import annotations

from collections.abc import Set
from typing import Final, Protocol

from posfet_model._lib.units import NANOSECONDS

REFRESH_PERIOD: Final = 10_000_000
"""Time between the refreshes of two subscription counts [ns]: a single publisher sees a subscriber after it."""
SUBSCRIBER_CHECK_PERIOD: Final = REFRESH_PERIOD / NANOSECONDS
"""The same [s], at which a thread looks for the first subscriber."""


class Publisher(Protocol):
    """The part of a publisher that is used here."""

    def get_subscription_count(self) -> int:
        """Return the number of subscriptions."""


class SubscriptionCache:
    """Knows which publishers have subscribers.

    One count is refreshed in each period, so that no scan waits for all of them; after a pause those that are due are
    refreshed at once.

    Parameters
    ----------
    *publishers : Publisher
        Publishers to look at.
    period : int, optional
        Time between two refreshes [ns].
    """

    def __init__(self, *publishers: Publisher, period: int = REFRESH_PERIOD) -> None:
        self._publishers = publishers
        self._period = period
        self._index = 0
        self._next_refresh = 0
        self._subscribed: set[Publisher] = set()

    def subscribed(self, now: int) -> Set[Publisher]:
        """Return the publishers that had subscribers at their last refresh; `now` is a monotonic time [ns]."""
        if now >= self._next_refresh:
            due = 1 + (now - self._next_refresh) // self._period
            for _ in range(min(due, len(self._publishers))):
                self._refresh_next()
            self._next_refresh = now + self._period
        return self._subscribed

    def any(self, now: int) -> bool:
        """Return whether any publisher has subscribers; `now` is a monotonic time [ns]."""
        return bool(self.subscribed(now))

    def _refresh_next(self) -> None:
        publisher = self._publishers[self._index]
        self._index = (self._index + 1) % len(self._publishers)
        if publisher.get_subscription_count() > 0:
            self._subscribed.add(publisher)
        else:
            self._subscribed.discard(publisher)
