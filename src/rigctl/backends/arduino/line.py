"""The line to the board: tagged questions and their answers, with the stream going on beside them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import count

from rigctl.backends.arduino.messages import LineReader, Reading, Reply, Switched, with_checksum
from rigctl.backends.transport.conversation import Conversation, carry_through
from rigctl.backends.transport.port import NoAnswer, Port, Refused
from rigctl.clock import Clock

ANSWER = 0.4  #: s for an answer
TRIES = 3
_BITS = 10  # start, eight, stop
DAMAGED = (-360, -363)  #: a wrong checksum, lost characters: nothing was carried out


@dataclass(frozen=True, slots=True)
class Answer:
    """What the board has answered.

    Parameters
    ----------
    sent: when the command had been received at the earliest, s.
    text: the answer.
    received: when it was given at the latest, s: the characters' time on the line is taken off.
    readings_before: how many readings that nobody had fetched yet came before it.
    """

    sent: float
    text: str
    received: float
    readings_before: int


@dataclass(slots=True)
class Question:
    """One command that was sent once; `answer` comes when it is taken in."""

    command: str
    tag: int
    sent: float  #: s
    length: int  #: bytes
    answer: Answer | None = None

    @property
    def arrived_damaged(self) -> bool:
        """Whether the board says so: then nothing was carried out."""
        return self.answer is not None and _error_number(self.answer.text) in DAMAGED

    def accepted(self) -> Answer | None:
        """The answer, None while there is none; raises `Refused` where it is an error."""
        if self.answer is None or self.arrived_damaged:
            return None
        number = _error_number(self.answer.text)
        if number is not None:
            text = self.answer.text.partition(",")[2].strip('"')
            raise Refused(f"the board refuses '{self.command}': {text} ({number})")
        return self.answer


def _error_number(answer: str) -> int | None:
    """The number in ``!-221,"Settings conflict"``; None where it is no error."""
    return int(answer[1:].partition(",")[0]) if answer.startswith("!") else None


class Line:
    """One open port to a board.

    Attributes
    ----------
    readings, switched: what the board sent of its own accord, oldest first.
    """

    def __init__(self, port: Port, clock: Clock, baud: int) -> None:
        self.port = port
        self.clock = clock
        self.baud = baud
        self._character = _BITS / baud
        self._reader = LineReader()
        self._tags = count(1)
        self._open: dict[int, Question] = {}  # sent, and not answered yet
        self.readings: deque[Reading] = deque()
        self.switched: deque[Switched] = deque()
        self.heard = False  #: anything at all

    @property
    def damaged(self) -> int:
        """Lines that arrived damaged; counts up."""
        return self._reader.damaged

    def take(self, until: float) -> bool:
        """Take in what arrives by bench time `until`; False when nothing did."""
        data = self.port.read(until)
        if not data:
            return False
        self.heard = True
        for message in self._reader.feed(data):
            if isinstance(message, Reading):
                self.readings.append(message)
            elif isinstance(message, Switched):
                self.switched.append(message)
            elif (question := self._open.pop(message.tag, None)) is not None:
                question.answer = self._answer(question, message)
        return True

    def forget(self) -> None:
        """Drop what the board has sent of its own accord so far."""
        self.readings.clear()
        self.switched.clear()

    def put(self, command: str) -> Question:
        """Send a command, and wait for nothing."""
        tag = next(self._tags)
        data = with_checksum(f"#{tag} {command}")
        question = self._open[tag] = Question(command, tag, self.clock.now(), len(data))
        self.port.write(data)
        return question

    def withdraw(self, question: Question) -> None:
        """An answer that still comes is of no use any more."""
        self._open.pop(question.tag, None)

    def asking(self, command: str, timeout: float = ANSWER, tries: int = TRIES) -> Conversation[Answer]:
        """Ask; a question that was lost is asked again, so that it must do no harm twice.

        Raises
        ------
        Refused
            it answers with an error.
        PortLost
            it does not answer (`NoAnswer`), or the port is gone.
        """
        asked: list[Question] = []
        try:
            for _ in range(tries):
                asked.append(self.put(command))
                deadline = asked[-1].sent + timeout
                while self.clock.now() < deadline and not asked[-1].arrived_damaged:
                    for question in asked:  # the answer to an earlier try is as good
                        if (answer := question.accepted()) is not None:
                            return answer
                    yield deadline
        finally:
            for question in asked:
                self.withdraw(question)
        raise NoAnswer(f"{self.port.name}: the board does not answer '{command}'")

    def ask(self, command: str, timeout: float = ANSWER, tries: int = TRIES) -> str:
        """The board's answer, waited for; raises as `asking` does."""
        return carry_through(self.asking(command, timeout, tries), self.take).text

    def _answer(self, question: Question, reply: Reply) -> Answer:
        now = self.clock.now()
        characters = len(f"#{reply.tag} {reply.text}*0000\n")
        earliest = question.sent + question.length * self._character
        latest = max(now - characters * self._character, earliest)
        return Answer(earliest, reply.text, latest, len(self.readings))
