"""How a step is carried out: a generator of what it waits for, on the bench as a step sees it.

The runner alone lets time pass; `rigctl.runner.bench` is the bench that steps are carried out on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol, TypeAlias

from rigctl.expressions import Expression
from rigctl.plan.loop import LoopSettings, LoopState
from rigctl.plan.measured import MeasuredValue
from rigctl.plan.outcomes import Outcome
from rigctl.plan.statistics import Statistic, Stretch
from rigctl.rig import Rig
from rigctl.units import show

#: ``(time, record, *channels, *commands)``, SI
Row: TypeAlias = tuple[float, ...]


class OnPause(Enum):
    """What a pause does to a step that is waiting."""

    RESTART = "restart"  #: the commands it began with are restored and it begins again
    KEEP = "keep"  #: commands are restored and it goes on waiting
    DEFER = "defer"  #: the pause waits until it is over, since half of it would be worthless


@dataclass(frozen=True, slots=True)
class Until:
    """Go on at bench time `time`, at the first sample for which `when` is true, or once `done` is.

    The generator is then sent the sample's row, or None where it was not a sample that it waited for. `done`
    is looked at whenever something has come from the bench.
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


#: between two steps: look at signals, requests and the samples that are due, and go on at once
CHECKPOINT = Until(-math.inf, on_pause=OnPause.KEEP)


@dataclass(frozen=True)
class Question:
    """What the operator is asked.

    Parameters
    ----------
    text: the question or the request.
    name: what the answer is kept as; None when a confirmation is enough.
    unit: the unit a value is read in and shown in; None for a confirmation.
    low, high: SI, included.
    simulated: SI, what a simulated operator answers.
    notice: True when nothing is to be typed: the channels show when it has been done.
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
        """True when a value has to be typed."""
        return self.name is not None

    def __str__(self) -> str:
        """The question with what may be answered."""
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
    """What came back: the text as typed, and its SI value where one was asked for."""

    text: str
    value: float | None = None


@dataclass(frozen=True)
class Pulse:
    """A timed command that the bench will end by itself."""

    end: float  #: s, when it should be over
    value: float


class Receipt(Protocol):
    """What a command is answered with."""

    @property
    def time(self) -> float:
        """When the actuator was really switched, s."""
        ...


class Bench(Protocol):
    """What a step may ask of the bench that it is carried out on; all values SI, all times s on its clock."""

    rig: Rig
    columns: Mapping[str, int]  #: of a row, by channel or command
    newest: Row | None
    rate: float  #: Hz, of the samples
    needed_rate: float  #: Hz that the step in progress has to be read with at least, between records
    commanded: dict[str, float]
    pulses: dict[str, Pulse]
    missed: list[str]  #: what lay outside its limits while the procedure went on
    regulated: set[str]  #: actuators that the step in progress commands anew by itself
    reachable: bool

    @property
    def now(self) -> float:
        """Bench time, s."""
        ...

    @property
    def recording(self) -> bool:
        """True while a record is open."""
        ...

    def start(self, rate: float) -> None:
        """Sample at `rate` Hz from now on."""
        ...

    def fresh(self) -> Generator[Until, Row | None, Row]:
        """The newest row, or the next one when a command was given since."""
        ...

    def condition(self, expression: Expression) -> Callable[[Row], object]:
        """A function of a row for a condition over channels, commands, measures and answers."""
        ...

    def command(
        self, actuator: str, value: float, duration: float | None = None
    ) -> Generator[Until, Row | None, Receipt]:
        """Switch an actuator as soon as it may be, for `duration` s if given."""
        ...

    def try_switch(self, actuator: str, value: float) -> bool:
        """Send a command now, without waiting for its answer; False when contact is lost for the moment."""
        ...

    def finish_pulse(self, actuator: str) -> Waiting:
        """Wait until a timed command is over; ends it from here where the bench cannot."""
        ...

    def cannot_regulate(self, loop: LoopSettings) -> str:
        """Why the bench itself cannot carry out a closed loop; empty where it can."""
        ...

    def regulate(self, loop: LoopSettings) -> Waiting:
        """Let the bench itself begin a closed loop, and wait until it says that it has."""
        ...

    def loop_state(self, ahead: float | None = None) -> LoopState:
        """What is known of the loop that the bench carries out; `ahead` is its feed-forward from now on."""
        ...

    def stop_regulating(self, actuator: str) -> Waiting:
        """End such a loop, its output as it is, and wait until the bench has said so and how it ran."""
        ...

    def release(self, actuator: str) -> None:
        """Bring an actuator back to its safe value now."""
        ...

    def safe_value(self, actuator: str) -> float:
        """The value an actuator rests at."""
        ...

    def is_at(self, actuator: str, value: float) -> bool:
        """Whether the newest command to an actuator was a value, and no answer to it has stayed away."""
        ...

    def rested_at(self, actuator: str, value: float) -> float:
        """When an actuator that needs rest between two switches may be switched to `value`, s."""
        ...

    def statistics(
        self, wanted: Sequence[Statistic], stretch: Stretch, window: float | None
    ) -> Mapping[str, float]:
        """Statistics by key, the stretch's ``duration``, and every value kept so far."""
        ...

    def record_measure(self, value: MeasuredValue) -> None:
        """Keep a measured or answered value with the open record, or with the run, and for later steps."""
        ...

    def event(self, kind: str, message: str) -> None:
        """Log something that happened now, at the step in progress."""
        ...

    def ask(self, question: Question) -> Generator[Until, Row | None, Answer]:
        """Ask the operator and wait for the answer, with samples and interlocks going on."""
        ...

    def request(self, question: Question) -> None:
        """Show the operator what is wanted, without waiting."""
        ...

    def withdraw(self) -> None:
        """What was asked for is not needed any more."""
        ...
