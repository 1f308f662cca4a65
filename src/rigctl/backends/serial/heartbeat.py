"""Says that the host lives, and learns what time the board has, without waiting for the answer."""

from __future__ import annotations

import math

from rigctl.backends.serial.board import Board
from rigctl.backends.serial.port import NoAnswer
from rigctl.clock import Clock

INTERVAL = 0.5  #: s; the board gives up on a silent host after 1.5 s
_ANSWER = 0.4  # s for an answer
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
        self._asked = math.nan  # when the question that is open was asked
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
        open_question = not math.isnan(self._asked)
        if now < self.due and (open_question or not silent or now < self.due - _ANSWER):
            return
        if open_question:
            self._unanswered += 1
            if self._unanswered >= _UNANSWERED:
                raise NoAnswer(f"{self._board.line.port.name}: the board does not answer '{_QUERY}'")
        self._asked = now
        self.due = now + _ANSWER
        self._board.line.begin(_QUERY)

    def listen(self) -> None:
        """Learn from an answer that has arrived.

        Raises
        ------
        NoAnswer
            the board's time says that it was restarted.
        """
        answer = self._board.line.take_answer()
        if answer is None:
            return
        self.due = self._asked + INTERVAL
        self._asked = math.nan
        self._unanswered = 0
        sent, text, received = answer
        if not self._board.clock_map.add(sent, int(text), received):
            raise NoAnswer("the board was restarted")
