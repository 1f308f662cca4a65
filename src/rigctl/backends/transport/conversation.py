"""Dialogues with a device that never block while waiting for its answers.

A dialogue is written as a generator. It yields the bench time, s, until which it waits, and is resumed
whenever something has arrived or that time is reached.

One such dialogue, for instance the identification of a device, is written once and used in two ways: step by
step while a run goes on (`ActiveConversation`), or to its end where nothing else has to be done meanwhile, as
in the opening or in making outputs safe (`carry_through`).
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Generic, TypeAlias, TypeVar

T = TypeVar("T")

Conversation: TypeAlias = Generator[float, None, T]

#: reads until a bench time
Take: TypeAlias = Callable[[float], object]


class ActiveConversation(Generic[T]):
    """A conversation in progress.

    Attributes
    ----------
    until: bench time, s, at which it is resumed even if nothing has arrived.
    over: whether it has ended.

    Raises
    ------
    Exception
        any error of the conversation, here and from `go_on`.
    """

    def __init__(self, conversation: Conversation[T]) -> None:
        self._conversation = conversation
        self._result: T | None = None
        self.over = False
        self.until = 0.0
        self.go_on()

    def go_on(self) -> None:
        """Resume the conversation, because something has arrived or its time is reached."""
        self._step(lambda: next(self._conversation))

    def take(self, take: Take, until: float) -> None:
        """Read, until bench time `until` at the latest, and resume; errors are raised in the conversation."""
        try:
            take(min(self.until, until))
        except Exception as error:  # noqa: BLE001 - handled by the conversation
            # Raised inside the dialogue, at its `yield`: it knows whether an attempt can be repeated, and
            # what to clean up.
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
        """Return the result of the conversation, which must have ended."""
        if not self.over:
            raise RuntimeError("a conversation that still goes on has no result")
        return self._result  # type: ignore[return-value]

    def drop(self) -> None:
        """Abandon the conversation; it sends nothing more."""
        self.over = True
        self._conversation.close()


def carry_through(conversation: Conversation[T], take: Take) -> T:
    """Run a conversation to its end, waiting for the answers."""
    underway = ActiveConversation(conversation)
    while not underway.over:
        underway.take(take, underway.until)
    return underway.result
