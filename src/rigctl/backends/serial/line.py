"""The line to the board: tagged questions and their answers, with the stream going on beside them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import count

from rigctl.backends.serial.messages import LineReader, Reading, Reply, Switched, with_checksum
from rigctl.backends.serial.port import NoAnswer, Port
from rigctl.clock import Clock

_TRIES = 3
_BITS = 10  # start, eight, stop


class Refused(Exception):
    """The board did not carry out a command; SCPI's number and text."""

    def __init__(self, command: str, number: int, text: str) -> None:
        super().__init__(f"the board refuses '{command}': {text} ({number})")
        self.number = number


@dataclass(frozen=True, slots=True)
class _Question:
    tag: int
    sent: float  # s
    length: int  # bytes


class Line:
    """One open port to a board.

    Attributes
    ----------
    readings, switched: what the board sent of its own accord, oldest first.
    damaged: lines that arrived damaged; counts up.
    """

    def __init__(self, port: Port, clock: Clock, baud: int) -> None:
        self.port = port
        self._clock = clock
        self.baud = baud
        self._character = _BITS / baud
        self._reader = LineReader()
        self._tags = count(1)
        self._reply: Reply | None = None
        self._open: _Question | None = None  # asked, and nobody waits for the answer
        self._answer: tuple[float, str, float] | None = None
        self.readings: deque[Reading] = deque()
        self.switched: deque[Switched] = deque()
        self.readings_at_reply = 0  #: how many of `readings` came before the last answer
        self.heard = False  #: anything at all

    @property
    def damaged(self) -> int:
        """Lines that arrived damaged."""
        return self._reader.damaged

    def poll(self, until: float) -> bool:
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
            elif self._open is not None and message.tag == self._open.tag:
                self._answer = self._times(self._open, message)
                self._open = None
            else:
                self._reply = message
                self.readings_at_reply = len(self.readings)
        return True

    def begin(self, command: str) -> None:
        """Ask without waiting; `take_answer` has the answer once it has been polled in."""
        self._open = self._put(command)
        self._answer = None

    def take_answer(self) -> tuple[float, str, float] | None:
        """The answer to what `begin` asked, as `exchange` gives it; once, and None while there is none."""
        answer, self._answer = self._answer, None
        return answer

    def forget(self) -> None:
        """Drop what the board has sent of its own accord so far."""
        self.readings.clear()
        self.switched.clear()

    def ask(self, command: str, timeout: float = 0.4) -> str:
        """The board's answer; a question that was lost is asked again, so that it must do no harm twice.

        Raises
        ------
        Refused
            it answers with an error.
        PortLost
            it does not answer (`NoAnswer`), or the port is gone.
        """
        return self.exchange(command, timeout)[1]

    def exchange(self, command: str, timeout: float = 0.4, tries: int = _TRIES) -> tuple[float, str, float]:
        """When the command had been received at the earliest, the answer, and when it was given at the
        latest: the characters' time on the line is taken off."""
        for _ in range(tries):
            self._reply = None
            question = self._put(command)
            reply = self._await(question.tag, question.sent + timeout)
            if reply is None:
                continue
            if reply.text.startswith("!"):
                number, _, words = reply.text[1:].partition(",")
                raise Refused(command, int(number), words.strip('"'))
            return self._times(question, reply)
        raise NoAnswer(f"{self.port.name}: the board does not answer '{command}'")

    def _put(self, command: str) -> _Question:
        tag = next(self._tags)
        data = with_checksum(f"#{tag} {command}")
        sent = self._clock.now()
        self.port.write(data)
        return _Question(tag, sent, len(data))

    def _times(self, question: _Question, reply: Reply) -> tuple[float, str, float]:
        received = self._clock.now()
        characters = len(f"#{reply.tag} {reply.text}*0000\n")
        earliest = question.sent + question.length * self._character
        return earliest, reply.text, max(received - characters * self._character, earliest)

    def _await(self, tag: int, deadline: float) -> Reply | None:
        while True:
            reply = self._reply
            if reply is not None and reply.tag == tag:
                return reply
            if self._clock.now() >= deadline:
                return None
            self.poll(deadline)
