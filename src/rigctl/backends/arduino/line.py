"""The line to the board: tagged queries and their answers, interleaved with the stream.

In: bytes of a `Port`. Out: answers, each at its query by its tag, and the unsolicited messages in two queues.

Every line has a checksum in both directions, so that there is no resynchronisation: a damaged line is
dropped, the next one counts. An answer that does not come costs `ANSWER` s, and the query is sent again
under a new tag; a late answer to the first attempt is then as good. Answers are timed, less the time that
their characters need on the wire, as the clock map and the receipts depend on these intervals.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import count

from rigctl.backends.arduino.messages import LineReader, Reading, Reply, Switched, with_checksum
from rigctl.backends.transport.conversation import Conversation, carry_through
from rigctl.backends.transport.port import NoAnswer, Port, Refused
from rigctl.clock import Clock

ANSWER = 0.4  #: time-out of an answer, s
TRIES = 3
_BITS = 10  # start, eight data bits, stop
DAMAGED = (-360, -363)  #: wrong checksum or lost characters: the command was not executed


@dataclass(frozen=True, slots=True)
class TimedReply:
    """An answer from the board.

    Parameters
    ----------
    sent: earliest time at which the board received the command, s.
    text: the answer.
    received: latest time at which it was sent, s: its arrival less the transmission time.
    readings_before: number of readings that arrived before it and have not been fetched.
    """

    sent: float
    text: str
    received: float
    readings_before: int


@dataclass(slots=True)
class Question:
    """One transmission of a command; `answer` is set once it has arrived."""

    command: str
    tag: int
    sent: float  #: s
    length: int  #: bytes
    answer: TimedReply | None = None

    @property
    def arrived_damaged(self) -> bool:
        """Whether the board reports damage, so that the command was not executed."""
        return self.answer is not None and _error_number(self.answer.text) in DAMAGED

    def accepted(self) -> TimedReply | None:
        """Return the answer, None until there is one; raises `Refused` if it is an error."""
        if self.answer is None or self.arrived_damaged:
            return None
        number = _error_number(self.answer.text)
        if number is not None:
            text = self.answer.text.partition(",")[2].strip('"')
            raise Refused(f"the board refuses '{self.command}': {text} ({number})")
        return self.answer


def _error_number(answer: str) -> int | None:
    """Return the number in ``!-221,"Settings conflict"``; None if it is not an error."""
    return int(answer[1:].partition(",")[0]) if answer.startswith("!") else None


class Line:
    """One open port to a board.

    Attributes
    ----------
    readings, switched: unsolicited messages of the board, oldest first.
    """

    def __init__(self, port: Port, clock: Clock, baud: int) -> None:
        self.port = port
        self.clock = clock
        self.baud = baud
        self._character = _BITS / baud
        self._reader = LineReader()
        self._tags = count(1)
        self._open: dict[int, Question] = {}  # by tag: sent and not yet answered
        self.readings: deque[Reading] = deque()
        self.switched: deque[Switched] = deque()
        self.heard = False  #: whether anything has arrived since the port was opened

    @property
    def damaged(self) -> int:
        """Running count of damaged lines."""
        return self._reader.damaged

    def take(self, until: float) -> bool:
        """Read until bench time `until` or until something arrives; return False if nothing did."""
        data = self.port.read(until)
        if not data:
            return False
        self.heard = True
        for message in self._reader.feed(data):
            if isinstance(message, Reading):
                self.readings.append(message)
            elif isinstance(message, Switched):
                self.switched.append(message)
            # An answer without a query was withdrawn meanwhile.
            elif (question := self._open.pop(message.tag, None)) is not None:
                question.answer = self._answer(question, message)
        return True

    def forget(self) -> None:
        """Discard the unsolicited messages received so far."""
        self.readings.clear()
        self.switched.clear()

    def put(self, command: str) -> Question:
        """Send a command without waiting."""
        tag = next(self._tags)
        data = with_checksum(f"#{tag} {command}")
        question = self._open[tag] = Question(command, tag, self.clock.now(), len(data))
        self.port.write(data)
        return question

    def withdraw(self, question: Question) -> None:
        """Ignore an answer that arrives later."""
        self._open.pop(question.tag, None)

    def asking(self, command: str, timeout: float = ANSWER, tries: int = TRIES) -> Conversation[TimedReply]:
        """Send a command and return its answer; repeated if lost, so it must be harmless if executed twice.

        Raises
        ------
        Refused
            the board answers with an error.
        PortLost
            the board does not answer (`NoAnswer`), or the port is gone.
        """
        asked: list[Question] = []
        try:
            for _ in range(tries):
                asked.append(self.put(command))
                deadline = asked[-1].sent + timeout
                while self.clock.now() < deadline and not asked[-1].arrived_damaged:
                    for question in asked:  # the answer to an earlier attempt is equally valid
                        if (answer := question.accepted()) is not None:
                            return answer
                    yield deadline
        finally:
            for question in asked:
                self.withdraw(question)
        raise NoAnswer(f"{self.port.name}: the board does not answer '{command}'")

    def ask(self, command: str, timeout: float = ANSWER, tries: int = TRIES) -> str:
        """As `asking`, but blocks until the answer has arrived; returns its text."""
        return carry_through(self.asking(command, timeout, tries), self.take).text

    def _answer(self, question: Question, reply: Reply) -> TimedReply:
        now = self.clock.now()
        characters = len(f"#{reply.tag} {reply.text}*0000\n")
        # The board cannot act on a command before its last character has arrived, nor have answered later
        # than the first character of the answer left it.
        earliest = question.sent + question.length * self._character
        latest = max(now - characters * self._character, earliest)
        return TimedReply(earliest, reply.text, latest, len(self.readings))
