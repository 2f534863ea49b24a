"""Whether anybody listens to a topic: what nobody subscribes to is not computed."""

from __future__ import annotations

from collections.abc import Set
from typing import Final, Protocol

SUBSCRIPTIONS_AGE: Final = 100_000_000
"""For how long a count of subscriptions is believed [ns]."""


class Publisher(Protocol):
    """What of a publisher is needed."""

    def get_subscription_count(self) -> int:
        """Return how many subscribe."""


class Listeners:
    """Tells which publishers have subscriptions.

    Each is looked up ten times a second, one at a time, so that no scan waits for all; all at once after a pause.
    """

    def __init__(self, *publishers: Publisher) -> None:
        self._publishers = publishers
        self._period = SUBSCRIPTIONS_AGE // len(publishers)
        self._turn = 0
        self._next = 0
        self._heard: set[Publisher] = set()

    def at(self, now: int) -> Set[Publisher]:
        """Return the publishers that somebody listened to when last looked up; `now` is a monotonic time [ns]."""
        if now >= self._next:
            for _ in range(len(self._publishers) if now >= self._next + SUBSCRIPTIONS_AGE else 1):
                self._look_up()
            self._next = now + self._period
        return self._heard

    def any(self, now: int) -> bool:
        """Return whether anybody listened to any of them; `now` is a monotonic time [ns]."""
        return bool(self.at(now))

    def _look_up(self) -> None:
        """Look up the next one."""
        publisher = self._publishers[self._turn]
        self._turn = (self._turn + 1) % len(self._publishers)
        if publisher.get_subscription_count() > 0:
            self._heard.add(publisher)
        else:
            self._heard.discard(publisher)
