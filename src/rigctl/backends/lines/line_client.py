"""Queries and answers, one after the other, on a line without sequence numbers or checksums.

A late answer would be taken for the answer to the next query. Unsolicited lines are therefore discarded
before each query, and after a missing or unexpected answer the line is resynchronised: rigctl waits until it
is quiet and, if the device has an identity query, sends it and reads until the answer is the identity. An
identity that was asked for and came too late may still come: it is no answer to anything else, and what
follows it may be late as well (see docs/decisions/0205-no-answer-is-believed-out-of-step.md). One that
nobody asked for is what many devices send when they start: the device has restarted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rigctl.backends.transport.conversation import Conversation, carry_through
from rigctl.backends.transport.port import AnotherDevice, NoAnswer, Port, PortLost, Refused
from rigctl.clock import Clock
from rigctl.errors import shorten
from rigctl.rig import Exchange, Lines

_LONGEST = 4096  # longest line, bytes; data without a line end in so many are garbage
_QUIET = 0.1  # s
_REMEMBERED = 20  # answers of which the slowest is known
_KEPT, _WIDTH = 3, 60  # number and length of the unsolicited lines whose text is kept
_LONGEST_NOISE = 1.0  # longest uninterrupted output of a line-based device, s
#: an answer that is later than so many time-outs is not expected any more: its query was lost
_LOST_AFTER = 4.0
#: reads of what has arrived before a query, and lines before an answer: no device that never stops sending
#: holds up an ending
_MOST = 1000


class WrongAnswer(Refused):
    """The device answered with an error, or with something that the rig file does not expect."""

    def __init__(self, command: str, answer: str, expected: str | None = None) -> None:
        text = f"the device answers {answer!r} to {command!r}"
        super().__init__(f"{text}; expected {expected!r}" if expected else text)
        self.answer = answer


class DeviceRestarted(PortLost):
    """The device has sent its identity unasked, as it does when it starts: its outputs are unknown."""


@dataclass(frozen=True, slots=True)
class LineReply:
    """The fields of an answer, and the interval in which the device received the command, s."""

    found: Mapping[str, str]
    sent: float
    received: float


class LineClient:
    """One open port to a line-based device.

    Attributes
    ----------
    stray: running count of unsolicited lines.
    stray_texts: the newest of them, shortened.
    established: whether the device is known to be running, so that an identity which it sends unasked means
        that it has restarted; while it starts, that is only its greeting.
    """

    def __init__(self, port: Port, clock: Clock, lines: Lines) -> None:
        self.port = port
        self._clock = clock
        self._lines = lines
        self._send_ends = lines.send_ends.encode("utf-8")
        self._reply_ends = lines.reply_ends.encode("utf-8")
        self._rest = b""
        self.stray = 0
        self.stray_texts: deque[str] = deque(maxlen=_KEPT)
        self.established = False
        self._took: deque[float] = deque(maxlen=_REMEMBERED)  # s, from a command to its answer
        self._bytes = 0  # number of bytes that have arrived
        self.last_sent = clock.now()  #: s
        self.last_answer = clock.now()  #: s
        self._in_step = True  # no answer to an earlier query is outstanding
        self._identities_due: deque[float] = deque()  # s, when those were asked for that may still arrive
        self._making_safe = False  # a restart is no reason not to do so
        self.identity: Mapping[str, str] | None = None  #: of the device, once it is known

    @property
    def heard(self) -> bool:
        """Whether anything has arrived since the port was opened."""
        return self._bytes > 0

    @property
    def slowest(self) -> float:
        """The longest time that one of the newest answers has taken, s; 0 before there is one."""
        return max(self._took, default=0.0)

    @property
    def in_step(self) -> bool:
        """Whether no answer to an earlier query is outstanding."""
        return self._in_step

    def send(self, text: str) -> None:
        """Send a command without waiting."""
        self.last_sent = self._clock.now()
        if self._lines.identify is not None and text == self._lines.identify.send:
            self._identities_due.append(self.last_sent)
        self.port.write(text.encode("utf-8") + self._send_ends)

    def ask(self, exchange: Exchange, *, tries: int | None = None) -> LineReply:
        """Send a command and wait for the expected answer; raises as `asking`."""
        return carry_through(self.asking(exchange, tries=tries), self.take)

    def asking(
        self,
        exchange: Exchange,
        text: str | None = None,
        *,
        tries: int | None = None,
        timeout: float = 0.0,
        fits: Callable[[Mapping[str, str]], bool] = lambda found: True,
        anyway: bool = False,
    ) -> Conversation[LineReply]:
        """Send a command and read the expected answer.

        Parameters
        ----------
        text: the command, if it contains a value.
        tries, timeout: override those of the rig file.
        fits: returns whether the fields of an answer are valid, e.g. numbers.
        anyway: whether to send it even if the line cannot be resynchronised, for commands that make safe. No
            answer on such a line confirms it: it may be that to an earlier command.

        Raises
        ------
        WrongAnswer
            the device answers with an error, or repeatedly with an unexpected text.
        PortLost
            the device does not answer or has restarted (`NoAnswer`), or the port is gone.
        """
        command = exchange.send if text is None else text
        # Read by `_unasked`: a device that restarts while it is made safe is made safe all the same.
        self._making_safe = anyway
        wrong = ""
        # Each attempt: get into step if the last answer is missing, drop what nobody asked for, send, read.
        for attempt in range(tries or self._lines.tries):
            if attempt or not self._in_step:
                patience = timeout or self._lines.timeout * self._lines.tries
                try:
                    yield from self._synchronise(command, patience)
                except (WrongAnswer, NoAnswer):
                    if wrong:  # the error names the unexpected answer to this query instead
                        break
                    if not anyway:
                        raise
                    # For safe commands an unsynchronised line is no obstacle: off is sent into whatever there
                    # is. It is sent once more, and believed, if the device comes into step after that.
                    self.send(command)
                    yield from self._synchronise(command, patience)
            self._drop_stray()
            # From the sending on, until the answer is here: whoever breaks off in between leaves an answer
            # outstanding.
            self._in_step = False
            sent = self._clock.now()
            self.send(command)
            # A device that does not answer this command: nothing is outstanding, and nothing is confirmed.
            if not exchange.patterns:
                self._in_step = True
                return LineReply({}, sent, self._clock.now())
            deadline = sent + (timeout or self._lines.timeout)
            found, wrong = yield from self._read_answer(exchange, command, deadline)
            # Form and content: a line that fits the pattern may have been cut off, and have no number in it.
            if found is not None and fits(found):
                self._in_step = True
                self.last_answer = self._clock.now()
                self._took.append(self.last_answer - sent)
                # Answers come in order: none is due from before.
                if self._identities_due and exchange != self._lines.identify:
                    self._identities_due.clear()
                return LineReply(found, sent, self._clock.now())
            if found is not None:
                wrong = self._misfit(" / ".join(found.values()))
        if wrong:
            raise WrongAnswer(command, wrong, " / ".join(exchange.reply))
        raise NoAnswer(f"{self.port.name}: the device does not answer {command!r}")

    def idle(self, until: float) -> None:
        """Let time pass; anything received is unsolicited. Raises `DeviceRestarted`."""
        self.take(until)
        self._drop_stray()

    def abandon(self) -> None:
        """Stop waiting for the query in progress, whose answer may still arrive."""
        self._in_step = False

    def _read_answer(
        self, exchange: Exchange, command: str, deadline: float
    ) -> Conversation[tuple[Mapping[str, str] | None, str]]:
        """Return the fields of an answer, or None and the unexpected line (empty for silence)."""
        found: dict[str, str] = {}
        for pattern in exchange.patterns:
            # A late identity, or the greeting of a restarted device, may come between query and answer: it is
            # skipped, or raises `DeviceRestarted`.
            for _ in range(_MOST):
                line = yield from self._line(deadline)
                matched = None if line is None else pattern.match(line)
                if line is None or matched is not None or not self._is_identity(line):
                    break
                self._unasked(line)
            if line is None:
                return None, ""
            # An error is an answer to this query: the line is in step.
            if any(error.match(line) is not None for error in self._lines.error_patterns):
                self._in_step = True
                raise WrongAnswer(command, line)
            if matched is None:
                return None, line
            found.update(matched)
        if self._identities_due and exchange == self._lines.identify:
            self._identities_due.popleft()
        return found, ""

    def _misfit(self, line: str) -> str:
        """Return a line whose values are none; the identity fits a pattern that any text fits."""
        if self._is_identity(line):
            self._unasked(line)
        return line

    def _is_identity(self, line: str) -> bool:
        """Return whether a line is the device's identity; a pattern without words may fit readings too."""
        identify = self._lines.identify
        if identify is None or not any(map(_has_words, identify.patterns[0].literals)):
            return False
        return identify.patterns[0].match(line) is not None

    def _unasked(self, line: str) -> None:
        """Count a line that is no answer to the present query, and keep its text.

        Raises
        ------
        DeviceRestarted
            it is the greeting of a device that has restarted.
        """
        self.stray += 1
        self.stray_texts.append(repr(shorten(line, _WIDTH)))
        if not self._is_identity(line):
            return
        # One of those that were asked for and given up.
        if self._identities_due:
            self._identities_due.popleft()
        # Once: what follows on this connection, until it is opened anew, is a device that starts.
        elif self.established and not self._making_safe:
            self.established = False
            raise DeviceRestarted(f"{self.port.name}: the device has restarted: it sent {line!r} unasked")

    def _line(self, deadline: float) -> Conversation[str | None]:
        """Return the next line; None if there is none by bench time `deadline`."""
        while self._reply_ends not in self._rest:
            if self._clock.now() >= deadline:
                return None
            yield deadline
        line, _, self._rest = self._rest.partition(self._reply_ends)
        return line.decode("utf-8", "replace").strip()

    def take(self, until: float) -> bool:
        """Read until bench time `until` or until something arrives; return False if nothing did."""
        data = self.port.read(until)
        self._bytes += len(data)
        # Garbage without a line end must not grow without bound; the end is kept, where the next line begins.
        self._rest = (self._rest + data)[-_LONGEST:]
        return bool(data)

    def _drop_stray(self) -> None:
        for _ in range(_MOST):
            if not self.take(self._clock.now()):
                break
        self._discard()

    def _discard(self) -> None:
        """Take what has arrived for unsolicited lines."""
        if not self._rest:
            return
        *complete, rest = self._rest.split(self._reply_ends)
        self._rest = b""
        for line in [*complete, rest]:
            text = line.decode("utf-8", "replace").strip()
            if text:
                self._unasked(text)

    def _synchronise(self, command: str, patience: float) -> Conversation[None]:
        """Discard outstanding data, so that the next answer belongs to the next query, `command`.

        The device has `patience` s to identify itself.

        Raises
        ------
        WrongAnswer
            the device sends something other than its identity, possibly the answer to an earlier query.
        NoAnswer
            the device is silent, or has restarted.
        AnotherDevice
            its identity is twice not that of before.
        """
        # 1. Wait until the line is quiet: what is still on its way belongs to earlier queries. Without an
        #   identity that is all there is to tell: it lasts as long as an answer may take.
        identify = self._lines.identify
        answer = min(patience, self._lines.timeout) if identify is None else 0.0
        self._in_step = True
        yield from self._silence(max(_QUIET, answer))
        if identify is None:
            return
        # 2. Ask for the identity, and read on until it comes: everything before it is late, everything after
        #   it is in step.
        self._in_step = False
        self.send(identify.send)
        wrong = yield from self._identified(identify, patience)
        self._in_step = wrong is None
        if wrong:
            raise WrongAnswer(identify.send, wrong, " / ".join(identify.reply))
        if wrong is not None:
            raise NoAnswer(f"{self.port.name}: the device does not answer {command!r}")

    def _silence(self, silence: float) -> Conversation[None]:
        """Wait until nothing has arrived for `silence` s, and discard what has."""
        give_up = self._clock.now() + silence + _LONGEST_NOISE
        quiet = self._clock.now() + silence
        while self._clock.now() < quiet:
            heard = self._bytes
            yield quiet
            if self._bytes != heard:
                quiet = min(self._clock.now() + silence, give_up)
        self._discard()

    def _identified(self, identify: Exchange, patience: float) -> Conversation[str | None]:
        """Read the newest identity that was asked for, and return None; otherwise what came instead of it."""
        deadline = self._clock.now() + patience
        # What was asked before an outage will not come, and would keep the device waiting for as long as that
        # lasted: the one just asked for always counts, however long it took to send.
        due, oldest = self._identities_due, self._clock.now() - _LOST_AFTER * self._lines.timeout
        while len(due) > 1 and due[0] < oldest:
            due.popleft()
        wrong, stranger, late = "", False, False
        for _ in range(_MOST):
            line = yield from self._line(deadline)
            if line is None:
                break
            found = identify.patterns[0].match(line)
            if found is not None:
                for pattern in identify.patterns[1:]:
                    found = {**found, **(pattern.match((yield from self._line(deadline)) or "") or {})}
                asked = self._identities_due.popleft() if self._identities_due else self._clock.now()
                same = self.identity is None or found == self.identity
                # It may be the answer to an earlier query. What was sent between the two is then still to be
                # answered, at the latest as long after this one as it was sent after that.
                if same and self._identities_due:
                    late = True
                    deadline = self._clock.now() + self._identities_due[-1] - asked + patience
                elif same:
                    return None
                # Twice in a row: another device. Once may be a damaged line.
                elif stranger:
                    raise AnotherDevice(f"another device answers than before: {', '.join(found.values())}")
                else:
                    stranger = True
                    self.send(identify.send)
            wrong = line
        # The others that were asked for are lost, as nothing has come for so long.
        if late and not stranger:
            self._identities_due.clear()
            return None
        return wrong


def _has_words(literal: str) -> bool:
    return any(letter.isalnum() for letter in literal)
