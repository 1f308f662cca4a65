"""The heartbeat of the host: queries that keep the board from tripping, and show whether it still answers."""

from __future__ import annotations

from rigctl.backends.arduino.board import Board
from rigctl.backends.arduino.line import ANSWER, Question
from rigctl.backends.transport.port import NoAnswer
from rigctl.clock import Clock

_INTERVAL = 0.5  # s; the board trips after 1.5 s without its host
_UNANSWERED = 3  # unanswered queries in a row after which the board is lost
_QUERY = "SYST:TIME?"


class Heartbeat:
    """Queries the board's time twice a second while samples continue to arrive.

    Attributes
    ----------
    due: next time at which `beat` must be called, s.
    """

    def __init__(self, board: Board, clock: Clock) -> None:
        self._board = board
        self._clock = clock
        self._question: Question | None = None  # the query in progress
        self._unanswered = 0
        self.due = clock.now() + _INTERVAL

    def beat(self, *, silent: bool) -> None:
        """Query the board when it is due, or at once if the board is `silent`.

        Raises
        ------
        PortLost
            several queries in a row were not answered (`NoAnswer`), or the port is gone.
        """
        now = self._clock.now()
        # A stream that has stopped is asked after at once, instead of at the next regular query.
        if now < self.due and (self._question is not None or not silent or now < self.due - ANSWER):
            return
        # The last query has no answer. Its late answer must not count as that of the next one.
        if self._question is not None:
            self._board.line.withdraw(self._question)
            self._unanswered += 1
            if self._unanswered >= _UNANSWERED:
                raise NoAnswer(f"{self._board.line.port.name}: the board does not answer '{_QUERY}'")
        self._question = self._board.line.put(_QUERY)
        self.due = now + ANSWER

    def listen(self) -> None:
        """Evaluate an answer that has arrived.

        Raises
        ------
        NoAnswer
            the board's time shows that the board was restarted, or that its clock was stopped.
        """
        question = self._question
        if question is None or question.answer is None:
            return
        self._question = None
        self._unanswered = 0
        self.due = question.sent + _INTERVAL
        answer = question.answer
        if not answer.text.isdigit():  # an error message: the query was damaged in transmission
            return
        if not self._board.clock_map.add(answer.sent, int(answer.text), answer.received):
            raise NoAnswer(_clock_text(self._board.clock_map.behind))


def _clock_text(behind: float) -> str:
    """Return a description of what the board's time shows."""
    if not behind:
        return "the board was restarted"
    moved = f"stood still for {behind:.2g} s" if behind > 0.0 else f"makes up for {-behind:.2g} s"
    return f"the board's clock {moved}, as an emulated board's does when its computer has stalled"
