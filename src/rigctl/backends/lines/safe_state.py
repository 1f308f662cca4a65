"""Makes the outputs of a line-based device safe, and believes only what the device confirms.

First every output is commanded, then every state that the rig file's queries contain is read back. A device
that acknowledges a command without executing it is thus found out. Last the device is identified again: if
another one has taken its place meanwhile, its states show nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from rigctl.backends.lines.error_queue import errors_in_queue
from rigctl.backends.lines.line_client import LineClient, LineReply, WrongAnswer
from rigctl.backends.lines.setting import SafeCommand, Setter
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.guard_port import GuardActed
from rigctl.backends.transport.port import AnotherDevice, NoAnswer, PortLost, Refused
from rigctl.clock import Clock
from rigctl.rig import Lines, Query, Rig

#: s for the read states to follow the commands: a controller updates them once per cycle
_FOLLOWS = 0.5
_LOOK = 0.05  # s between two readings
_MOST_ERRORS = 10  # that are read after one command; an ending must not take long


@dataclass
class SafeOutcome:
    """What a device has confirmed.

    Attributes
    ----------
    trouble: why outputs may not be safe, the first reason or the first silence; None if all are confirmed.
    doubtful: the outputs that were not confirmed, with the SI value that was read; None if none was read.
    """

    trouble: PortLost | Refused | None = None
    doubtful: dict[str, float | None] = field(default_factory=dict)

    def doubt(self, names: Iterable[str], trouble: PortLost | Refused) -> None:
        """Record that outputs were not confirmed; a silence outranks a refusal: anything may follow it."""
        silent = isinstance(trouble, PortLost) and not isinstance(self.trouble, PortLost)
        if self.trouble is None or silent:
            self.trouble = trouble
        self.doubtful |= dict.fromkeys(names)


class SafeState:
    """The commands that make outputs safe, and the queries that show it.

    Parameters
    ----------
    guard_acted: called if the guard has just made outputs safe.
    """

    def __init__(
        self, rig: Rig, lines: Lines, setter: Setter, clock: Clock, guard_acted: Callable[[GuardActed], None]
    ) -> None:
        self._rig = rig
        self._lines = lines
        self._setter = setter
        self._clock = clock
        self._guard_acted = guard_acted

    def making(self, client: LineClient, patience: float) -> Conversation[SafeOutcome]:
        """Send all commands that make outputs safe, even if some of them fail, and read the states back.

        Once the device has not answered for `patience` s, its answers are no longer waited for.
        """
        outcome = SafeOutcome()
        silence: PortLost | None = None
        # 1. Command all outputs, each whatever became of the others. After the first silence the rest is sent
        #   without waiting, as nobody is listening for the answers any more: that takes no time, and the
        #   device may still hear.
        for step in self._setter.safe_commands():
            try:
                if silence is not None:
                    outcome.doubt(step.actuators, silence)
                    # A stranger is commanded no further.
                    if not isinstance(silence, AnotherDevice):
                        client.send(step.text)
                    continue
                yield from self._commanding(client, step, patience)
            except PortLost as error:
                silence = silence or error
                outcome.doubt(step.actuators, error)
            except Refused as error:
                outcome.doubt(step.actuators, error)
        # 2. Read back, 3. identify: only where the device answers. Otherwise no state that nothing has read
        #   is believed.
        if silence is None:
            yield from self._reading_back(client, patience, outcome)
            yield from self._identifying(client, patience, outcome)
        else:
            outcome.doubt(self._undecided(silence), silence)
        return outcome

    def _undecided(self, silence: PortLost) -> set[str]:
        """Return the outputs about which answers before a silence say nothing: those whose states were to be
        read, or all if another device may have given them."""
        another = isinstance(silence, AnotherDevice)
        return {name for name in self._setter.safe_values if another or self._setter.is_read(name)}

    def _commanding(self, client: LineClient, step: SafeCommand, patience: float) -> Conversation[None]:
        """Send one command and require that the device confirms it.

        Errors in the device's queue may have other causes: the command is then sent again.
        """
        errors: list[str] = []
        interrupted: GuardActed | None = None
        # Twice: the first errors in the queue may be old ones, or the guard may have acted in between.
        for _ in range(2):
            try:
                answer = yield from client.asking(
                    step.exchange, step.text, tries=1, timeout=patience, anyway=True
                )
                step.require(answer)
                errors = yield from errors_in_queue(client, self._lines, patience, _MOST_ERRORS)
            except GuardActed as acted:
                self._guard_acted(acted)
                client.abandon()  # what the guard has sent is still being answered
                interrupted = acted
                continue
            interrupted = None
            if not errors:
                return
        if interrupted is not None:  # the device has confirmed nothing
            raise NoAnswer(str(interrupted))
        raise WrongAnswer(step.text, errors[0])

    def _reading_back(self, client: LineClient, patience: float, outcome: SafeOutcome) -> Conversation[None]:
        """Read the states of outputs; a state that was read decides, whatever was answered before."""
        give_up = self._clock.now() + _FOLLOWS
        silence: PortLost | None = None
        for query, names in self._setter.read_back:
            if silence is not None:
                outcome.doubt(names, silence)
                continue
            try:
                answer = yield from client.asking(query, tries=2, timeout=patience)
                # A state that is not safe yet may be one that the device updates once per cycle.
                while (wrong := self._wrong(answer, names)) and self._clock.now() < give_up:
                    look = self._clock.now() + _LOOK
                    while self._clock.now() < look:
                        yield look
                    answer = yield from client.asking(query, tries=2, timeout=patience)
            except PortLost as error:
                silence = error
                outcome.doubt(names, error)
                continue
            except Refused as error:
                outcome.doubt(names, error)
                continue
            for name, value in wrong.items():
                outcome.doubt([name], self._still(query, answer, name, value))
                outcome.doubtful[name] = value

    def _identifying(self, client: LineClient, patience: float, outcome: SafeOutcome) -> Conversation[None]:
        """Require that the device is the same as before the commands; otherwise nothing is confirmed."""
        identify, known = self._lines.identify, client.identity
        if identify is None or known is None or isinstance(outcome.trouble, PortLost):
            return
        try:
            yield from client.asking(identify, tries=2, timeout=patience, fits=lambda found: found == known)
        except AnotherDevice as error:
            outcome.trouble = None  # that decides, whatever the states of another device are
            outcome.doubtful.clear()
            outcome.doubt(self._setter.safe_values, error)
        except (PortLost, Refused) as error:
            outcome.doubt(self._setter.safe_values.keys() - outcome.doubtful.keys(), error)

    def _wrong(self, answer: LineReply, names: tuple[str, ...]) -> dict[str, float | None]:
        """Return the outputs that are not safe according to an answer, with their values."""
        states, safe = self._setter.states(answer, names), self._setter.safe_values
        return {name: value for name, value in states.items() if value != safe[name]}

    def _still(self, query: Query, answer: LineReply, name: str, value: float | None) -> Refused:
        if value is None:
            return WrongAnswer(query.send, answer.found[name], f"the state of {name}")
        show = self._rig.actuators[name].show
        safe = show(self._setter.safe_values[name])
        return Refused(f"{name} is {show(value)}, though it was commanded to be {safe}")
