"""The execution of a step: a generator of the conditions it waits for, and the bench's interface to steps.

Only the runner lets time pass; `rigctl.runner.bench` implements the interface.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol, TypeAlias

from rigctl.expressions import Expression
from rigctl.plan.loop import LoopSettings, LoopState
from rigctl.plan.measured import MeasuredValue
from rigctl.plan.missing import Lack
from rigctl.plan.outcomes import Outcome
from rigctl.plan.statistics import Statistic, Stretch
from rigctl.rig import Rig
from rigctl.units import show

#: ``(time, record, *channels, *commands)``, SI
Row: TypeAlias = tuple[float, ...]


class OnPause(Enum):
    """The effect of a pause on a step that is waiting."""

    RESTART = "restart"  #: the commands at its start are restored and it starts again
    KEEP = "keep"  #: commands are restored and it continues waiting
    DEFER = "defer"  #: the pause is deferred until the step is over, since a part of it would be useless


@dataclass(frozen=True, slots=True)
class Until:
    """Continue at bench time `time`, at the first sample for which `when` is true, or once `done` is true.

    The generator then receives the row of the sample, or None if it was not resumed by a sample. `done` is
    evaluated whenever something has arrived from the bench.
    """

    time: float = math.inf
    when: Callable[[Row], object] | None = None
    done: Callable[[], bool] | None = None
    on_pause: OnPause = OnPause.RESTART


Behaviour: TypeAlias = Generator[Until, Row | None, Outcome]
Waiting: TypeAlias = Generator[Until, Row | None, None]


def every_sample(_: Row) -> bool:
    """A condition that every sample satisfies."""
    return True


#: between two steps: handle signals, requests and samples that are due, and continue at once
CHECKPOINT = Until(-math.inf, on_pause=OnPause.KEEP)


@dataclass(frozen=True)
class Question:
    """A question or request to the operator.

    Parameters
    ----------
    text: the question or the request.
    name: name under which the answer is stored; None if a confirmation is sufficient.
    unit: unit in which a value is typed and shown; None for a confirmation.
    low, high: inclusive bounds of the answer, SI.
    simulated: SI, the answer of a simulated operator.
    notice: True if nothing has to be typed, because the readings show when the request has been fulfilled.
    """

    text: str
    name: str | None = None
    unit: str | None = None
    low: float | None = None
    high: float | None = None
    simulated: float | None = None
    notice: bool = False

    @property
    def wants_value(self) -> bool:
        """True if a value has to be typed."""
        return self.name is not None

    def __str__(self) -> str:
        """The question with the permitted answers."""
        if self.notice:
            return self.text
        if not self.wants_value:
            return f"{self.text} [Enter]"
        unit = self.unit or "1"
        bounds = [show(end, unit) for end in (self.low, self.high) if end is not None]
        allowed = f", {' to '.join(bounds)}" if len(bounds) == 2 else ""
        return f"{self.text} [{unit}{allowed}]"


@dataclass(frozen=True)
class Answer:
    """The operator's answer: the text as typed, and the SI value if a value was requested."""

    text: str
    value: float | None = None


@dataclass(frozen=True)
class Pulse:
    """A timed command that the bench ends by itself."""

    end: float  #: time at which it should end, s
    value: float


class Receipt(Protocol):
    """The acknowledgement of a command."""

    @property
    def time(self) -> float:
        """The time at which the actuator actually switched, s."""
        ...


class StepBench(Protocol):
    """The interface of the bench to steps; values in SI, times in s on the bench's clock."""

    rig: Rig
    columns: Mapping[str, int]  #: index in a row, by channel or command
    newest: Row | None
    rate: float  #: sampling rate, Hz
    commanded: dict[str, float]
    pulses: dict[str, Pulse]
    missed: list[str]  #: measures that were outside their limits while the procedure continued
    regulated: set[str]  #: actuators that the step in progress commands repeatedly
    reachable: bool

    @property
    def now(self) -> float:
        """Bench time, s."""
        ...

    @property
    def recording(self) -> bool:
        """True while a record is open."""
        ...

    def need_rate(self, rate: float) -> None:
        """Outside records, sample at no less than `rate` Hz from now on; 0: at the rig file's rate."""
        ...

    def fresh(self, names: Collection[str] = ()) -> Generator[Until, Row | None, Row]:
        """Return the latest row, or wait for the next one if a command has been sent since; or for one in
        which all channels among `names` have a value."""
        ...

    def read_with(self, row: Row, channel: str) -> Row:
        """Return the newest row with the time of its reading of a channel; other devices' rows repeat it."""
        ...

    def rate_of(self, channel: str) -> float:
        """Return how often a channel is read, Hz."""
        ...

    def condition(self, expression: Expression) -> Callable[[Row], object]:
        """Return a condition on channels, commands, measures and answers as a function of a row.

        It does not hold for a row in which one of its channels has no value.
        """
        ...

    def command(
        self, actuator: str, value: float, duration: float | None = None
    ) -> Generator[Until, Row | None, Receipt]:
        """Switch an actuator as soon as that is allowed, for `duration` s if given."""
        ...

    def try_switch(self, actuator: str, value: float) -> bool:
        """Send a command now, without waiting for its acknowledgement; False while contact is lost."""
        ...

    def finish_pulse(self, actuator: str) -> Waiting:
        """Wait for the end of a timed command; the host ends it if the bench cannot."""
        ...

    def cannot_regulate(self, loop: LoopSettings) -> str:
        """Return why the bench itself cannot execute a closed loop; empty if it can."""
        ...

    def regulate(self, loop: LoopSettings) -> Waiting:
        """Start a closed loop on the bench's own controller, and wait for its confirmation."""
        ...

    def loop_state(self, ahead: float | None = None) -> LoopState:
        """Return the state of the loop on the bench's controller; `ahead` is its feed-forward from now on."""
        ...

    def stop_regulating(self, actuator: str) -> Waiting:
        """End such a loop with its output held; wait for the confirmation and the timing statistics."""
        ...

    def release(self, actuator: str) -> None:
        """Return an actuator to its safe value now."""
        ...

    def safe_value(self, actuator: str) -> float:
        """Return the safe value of an actuator, SI."""
        ...

    def is_at(self, actuator: str, value: float) -> bool:
        """Return whether an actuator's latest command was `value`, whether or not it is acknowledged yet."""
        ...

    def rested_at(self, actuator: str, value: float) -> float:
        """Return the earliest time, s, at which an actuator with a minimum interval between switches may be
        switched to `value`."""
        ...

    def statistics(
        self, wanted: Sequence[Statistic], stretch: Stretch, window: float | None
    ) -> Mapping[str, float]:
        """Return the statistics by key, the ``duration`` of the stretch, and every value stored so far."""
        ...

    def lack(self, wanted: Sequence[Statistic], stretch: Stretch, window: float | None) -> Lack:
        """Return how many readings without a value the statistics leave out, of the worst channel."""
        ...

    def record_measure(self, value: MeasuredValue) -> None:
        """Store a measured or answered value for later steps, with the open record or else with the run."""
        ...

    def event(self, kind: str, message: str) -> None:
        """Log an event at the current time and step."""
        ...

    def ask(self, question: Question) -> Generator[Until, Row | None, Answer]:
        """Ask the operator, and wait for the answer; sampling and interlocks continue meanwhile."""
        ...

    def request(self, question: Question) -> None:
        """Show the operator a request, without waiting."""
        ...

    def withdraw(self) -> None:
        """Withdraw a request that is no longer needed."""
        ...
