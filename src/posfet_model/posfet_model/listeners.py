"""Whether anybody listens to a topic: what nobody subscribes to is not computed."""

from __future__ import annotations

from typing import Final, Protocol

SUBSCRIPTIONS_AGE: Final = 100_000_000
"""For how long a count of subscriptions is believed [ns]."""


class Publisher(Protocol):
    """What of a publisher is needed."""

    def get_subscription_count(self) -> int:
        """Return how many subscribe."""


class Listeners:
    """Tells whether a publisher has subscriptions, looked up at most ten times a second."""

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self._next = 0
        self._any = False

    def any(self, now: int) -> bool:
        """Return whether anybody listened when it was last looked up; `now` is a monotonic time [ns]."""
        if now >= self._next:
            self._next = now + SUBSCRIPTIONS_AGE
            self._any = self._publisher.get_subscription_count() > 0
        return self._any
