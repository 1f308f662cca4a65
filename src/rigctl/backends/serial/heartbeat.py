"""Says that the host lives, and learns what time the board has, without waiting for the answer."""

from __future__ import annotations

from rigctl.backends.serial.board import Board
from rigctl.backends.serial.line import ANSWER, Question
from rigctl.backends.serial.port import NoAnswer
from rigctl.clock import Clock

INTERVAL = 0.5  #: s; the board gives up on a silent host after 1.5 s
_UNANSWERED = 3  # questions in a row, and the board is lost
_QUERY = "SYST:TIME?"


class Heartbeat:
    """Asks a board for its time twice a second; samples go on arriving meanwhile.

    Attributes
    ----------
    due: when `beat` has something to do next, s.
    """

    def __init__(self, board: Board, clock: Clock) -> None:
        self._board = board
        self._clock = clock
        self._question: Question | None = None  # that is open
        self._unanswered = 0
        self.due = clock.now() + INTERVAL

    def beat(self, *, silent: bool) -> None:
        """Ask when it is time to, or at once when the board has fallen `silent`.

        Raises
        ------
        PortLost
            several questions in a row were not answered (`NoAnswer`), or the port is gone.
        """
        now = self._clock.now()
        if now < self.due and (self._question is not None or not silent or now < self.due - ANSWER):
            return
        if self._question is not None:
            self._board.line.withdraw(self._question)
            self._unanswered += 1
            if self._unanswered >= _UNANSWERED:
                raise NoAnswer(f"{self._board.line.port.name}: the board does not answer '{_QUERY}'")
        self._question = self._board.line.put(_QUERY)
        self.due = now + ANSWER

    def listen(self) -> None:
        """Learn from an answer that has arrived.

        Raises
        ------
        NoAnswer
            the board's time says that it was restarted.
        """
        question = self._question
        if question is None or question.answer is None:
            return
        self._question = None
        self._unanswered = 0
        self.due = question.sent + INTERVAL
        answer = question.answer
        if not answer.text.isdigit():  # an error: it had arrived damaged
            return
        if not self._board.clock_map.add(answer.sent, int(answer.text), answer.received):
            raise NoAnswer("the board was restarted")
