"""Talking to a device a little at a time, so that nobody has to wait for its answers.

What is asked and what follows from the answers is written as a generator. It yields the bench time, s, at
which it has waited long enough, and goes on whenever something has arrived or that time has come.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Generic, TypeAlias, TypeVar

T = TypeVar("T")

Conversation: TypeAlias = Generator[float, None, T]

#: takes in what arrives, up to a bench time
Take: TypeAlias = Callable[[float], object]


class Underway(Generic[T]):
    """A conversation that has been begun.

    Attributes
    ----------
    until: bench time, s, at which it goes on even if nothing has arrived.
    over: whether it has come to its end.

    Raises
    ------
    Exception
        whatever the conversation raises, here and from `go_on`.
    """

    def __init__(self, conversation: Conversation[T]) -> None:
        self._conversation = conversation
        self._result: T | None = None
        self.over = False
        self.until = 0.0
        self.go_on()

    def go_on(self) -> None:
        """Something has arrived, or its time has come."""
        self._step(lambda: next(self._conversation))

    def take(self, take: Take, until: float) -> None:
        """Take in what arrives by bench time `until` at the latest, and go on; trouble with it is its own."""
        try:
            take(min(self.until, until))
        except Exception as error:  # noqa: BLE001 - the conversation knows what it means
            trouble = error
            self._step(lambda: self._conversation.throw(trouble))
        else:
            self.go_on()

    def _step(self, step: Callable[[], float]) -> None:
        if self.over:
            return
        try:
            self.until = step()
        except StopIteration as stop:
            self._result = stop.value
            self.over = True
        except BaseException:
            self.over = True
            raise

    @property
    def result(self) -> T:
        """What it came to; only of one that is over."""
        if not self.over:
            raise RuntimeError("a conversation that still goes on has no result")
        return self._result  # type: ignore[return-value]

    def drop(self) -> None:
        """Leave it where it is: nothing more is sent for it."""
        self.over = True
        self._conversation.close()


def carry_through(conversation: Conversation[T], take: Take) -> T:
    """Carry a conversation to its end, waiting for the answers."""
    underway = Underway(conversation)
    while not underway.over:
        underway.take(take, underway.until)
    return underway.result
