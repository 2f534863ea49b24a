"""Commands to a board from any thread, carried by the thread that reads the bus."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, field

from posfet_driver.protocol.messages import Command, Response, Result
from posfet_model._lib.units import NANOSECONDS


class CommandError(Exception):
    """A board does not do what it was told; the message is one line with its reason."""


@dataclass(slots=True)
class Order:
    """One command on its way."""

    command: Command
    argument: int
    timeout: float
    """Time in which the answer has to be there [s]."""
    deadline: int
    """The same on the clock [ns]."""
    tag: int | None = None
    """Tag with which it was sent; None: not sent yet."""
    answer: Future[Response] = field(default_factory=Future)


class CommandQueue:
    """Orders in the order in which they came; one is under way at a time."""

    def __init__(self) -> None:
        self._waiting: deque[Order] = deque()
        self._current: Order | None = None

    def put(self, command: Command, argument: int, timeout: float, now: int) -> Future[Response]:
        """Add an order at time `now` [ns], from any thread; its future tells the answer or raises CommandError."""
        order = Order(command, argument, timeout, now + round(timeout * NANOSECONDS))
        self._waiting.append(order)
        return order.answer

    def next(self) -> Order | None:
        """Return the order that has to be sent now, or None."""
        if self._current is None and self._waiting:
            self._current = self._waiting.popleft()
            return self._current
        return None

    def pending(self) -> bool:
        """Return whether an order waits or is under way."""
        return self._current is not None or bool(self._waiting)

    def take(self, response: Response) -> Order | None:
        """Settle the order that `response` answers and return it, or None when it answers none."""
        order = self._current
        if order is None or response.tag != order.tag or response.command != order.command:
            return None
        self._current = None
        if response.result == Result.OK:
            order.answer.set_result(response)
        else:
            reason = f"refused by the board: {response.reason}"
            order.answer.set_exception(CommandError(f"{order.command.name}: {reason}"))
        return order

    def expire(self, now: int, reason: str) -> None:
        """Give up what took too long; `reason` is why orders could not even be sent."""
        if self._current is not None and now >= self._current.deadline:
            order, self._current = self._current, None
            _fail(order, f"no answer within {order.timeout:g} s")
        while self._waiting and now >= self._waiting[0].deadline:
            order = self._waiting.popleft()
            _fail(order, f"the board was not ready within {order.timeout:g} s: {reason}")

    def fail(self, reason: str) -> None:
        """Give up every order."""
        if self._current is not None:
            order, self._current = self._current, None
            _fail(order, reason)
        while self._waiting:
            _fail(self._waiting.popleft(), reason)


def _fail(order: Order, reason: str) -> None:
    order.answer.set_exception(CommandError(f"{order.command.name}: {reason}"))
