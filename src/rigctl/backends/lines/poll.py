"""Queries a device for one sample: sends the queries that are due, and reads the values in the answers.

In: the queries of the rig file, each with its own rate, and a line. Out: a `PolledSample` with the newest
value of every channel, and the states of outputs that were read. A query that was not due keeps its last
value; one whose answer makes no sense has none, so that the interlocks see a sensor without a value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rigctl.backends.lines.line_client import LineClient, LineReply, WrongAnswer
from rigctl.backends.lines.line_codec import LineCodec
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.outbox import Outbox
from rigctl.cadence import Cadence
from rigctl.clock import Clock
from rigctl.rig import Lines, Query, Rig
from rigctl.rig.protocols.line_pattern import read_number
from rigctl.wording import number_of


@dataclass(frozen=True)
class PolledSample:
    """One sample, from the answers of a device.

    Parameters
    ----------
    time: the middle of the interval of the queries, s.
    uncertainty: half of that interval, s.
    values: SI, in the order of the rig's layout.
    states: the actuators' states that were read, SI.
    changed: those that differ from the command.
    takes: s, of the queries that are made for each sample; 0 if one of them has no valid answer.
    """

    time: float
    uncertainty: float
    values: tuple[float, ...]
    states: Mapping[str, float]
    changed: Mapping[str, float]
    takes: float = 0.0


class Poll:
    """The queries of a device, each at its own rate."""

    def __init__(self, rig: Rig, lines: Lines, clock: Clock, outbox: Outbox) -> None:
        self._rig = rig
        self._queries = lines.queries
        self._meaning = LineCodec(rig, lines)
        self._clock = clock
        self._outbox = outbox
        self._channels = dict(rig.channels)
        self._numbers: dict[str, float] = {}  # in the answer that was read last, by channel
        self._values: dict[str, float] = {}
        self._cadences = self._begun()
        self._silenced: set[int] = set()  # queries whose fault has been reported
        self._stray = 0
        self.states_read: set[str] = set()  #: actuators whose state was read since the line was opened

    def _begun(self) -> list[Cadence | None]:
        """The cadence of each query that is slower than the samples, at its beginning."""
        return [None if query.every is None else Cadence(query.every) for query in self._queries]

    def forget(self, client: LineClient) -> None:
        """Restart all queries on a line that has just been opened."""
        self._values.clear()
        self.states_read.clear()
        self._cadences = self._begun()
        self._stray = client.stray
        client.established = True

    def verifying(
        self, client: LineClient, actuator: str, commanded: Mapping[str, float]
    ) -> Conversation[PolledSample]:
        """Ask for the state of an actuator that is read more rarely than at each sample.

        Before another command it is the last chance to see that the device has switched it by itself.
        """
        for index, query in enumerate(self._queries):
            if query.every is not None and actuator in query.places:
                self._cadences[index] = Cadence(query.every)
                return (yield from self.asking(client, commanded, only=index))
        return PolledSample(self._clock.now(), 0.0, (), {}, {})

    def asking(
        self,
        client: LineClient,
        commanded: Mapping[str, float],
        *,
        only: int | None = None,
        spacing: float = 0.0,
    ) -> Conversation[PolledSample]:
        """Send the queries that are due, or `only` one of them.

        An invalid answer leaves its channels without a value, which interlocks detect.

        Parameters
        ----------
        spacing: between two samples, s.

        Raises
        ------
        WrongAnswer
            a query without values, which only checks the device's status, has an unexpected answer.
        PortLost
            the device does not answer.
        """
        now = self._clock.now()
        states: dict[str, float] = {}
        answers = []
        takes = 0.0
        for index, query in enumerate(self._queries):
            # Slow queries keep their own grid, and are sent with the sample that is nearest to it.
            cadence = self._cadences[index]
            if only not in (None, index) or not (cadence is None or cadence.is_due(now, spacing)):
                continue
            answer = yield from self._ask(client, index, query)
            # Only these decide how often the device can be sampled.
            if query.every is None:
                takes += answer.received - answer.sent if answer is not None else math.nan
            if answer is not None:
                answers.append(answer)
                self._take(answer, commanded, states)
        self._note_stray(client)
        first = min((answer.sent for answer in answers), default=now)
        last = max((answer.received for answer in answers), default=now)
        values = tuple(self._values.get(name, math.nan) for name in self._rig.layout.channels)
        changed = {name: state for name, state in states.items() if state != commanded[name]}
        takes = 0.0 if math.isnan(takes) else takes
        return PolledSample(0.5 * (first + last), 0.5 * (last - first), values, states, changed, takes)

    def _ask(self, client: LineClient, index: int, query: Query) -> Conversation[LineReply | None]:
        try:
            answer = yield from client.asking(query, fits=self._readable)
        except WrongAnswer as error:
            # A query for the status alone: its wrong answer is a refusal, as it has no channel that could be
            # without a value.
            if not query.places:
                raise
            for place in query.places:
                self._values.pop(place, None)
            # Said once, until the query has been answered again.
            if index not in self._silenced:
                self._silenced.add(index)
                self._outbox.notice("fault", str(error))
            return None
        self._silenced.discard(index)
        return answer

    def _readable(self, found: Mapping[str, str]) -> bool:
        """Return whether the numbers and settings of an answer are valid.

        A truncated line must not be read as a value, nor the answer to another query as a setting.
        """
        for name, text in found.items():
            if name not in self._channels:
                if self._meaning.setting(name, text, 0.0) is None:
                    return False
                continue
            number = read_number(text)
            if number is None:
                return False
            self._numbers[name] = number  # for `_take`, which follows at once
        return True

    def _take(self, answer: LineReply, commanded: Mapping[str, float], states: dict[str, float]) -> None:
        for name, text in answer.found.items():
            if name in self._channels:
                self._values[name] = self._meaning.of_number(name, self._numbers[name])
                continue
            state = self._meaning.setting(name, text, commanded[name])
            if state is None:
                continue
            self.states_read.add(name)
            states[name] = state

    def _note_stray(self, client: LineClient) -> None:
        more = client.stray - self._stray
        self._stray = client.stray
        if more > 0:
            last = "" if more == len(client.stray_texts) else ", the last"
            texts = ", ".join(client.stray_texts)
            message = f"{number_of(more, 'line')} that nobody asked for{last}: {texts}"
            client.stray_texts.clear()
            self._outbox.notice("note", message, lines=more)
