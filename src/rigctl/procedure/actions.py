"""What a single step asks of the bench, with every variable resolved: frozen, and SI throughout.

An action says *what* is wanted and when to give up; how the bench gets there is the runner's affair.
Temperatures are absolute (K) where they are set-points and intervals (K) where they are tolerances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from rigctl.expressions import Expression
    from rigctl.procedure.statistics import Statistic


@dataclass(frozen=True, slots=True)
class Heat:
    """Bring the oil to `to` and keep it within `within` of it for `settle` seconds.

    Too cold, the heater is switched with the role's hysteresis; too hot, the step waits for natural cooling.
    """

    actuator: str
    channel: str
    to: float  #: K, absolute
    within: float  #: K, half width of the tolerance
    settle: float  #: s inside the tolerance before the step is done
    timeout: float  #: s until the step fails


@dataclass(frozen=True, slots=True)
class SetLevel:
    """Bring a continuous actuator, or the operator who turns it, to where `channel` reads `to`."""

    actuator: str
    channel: str
    to: float  #: SI of the channel's unit
    within: float  #: half width of the tolerance, an interval
    settle: float  #: s
    timeout: float  #: s


@dataclass(frozen=True, slots=True)
class Move:
    """Drive the cylinder; exactly one of `duration`, `until` and `target` is given.

    `duration` is timed by the bench where it can be. `until` ends at the first sample that satisfies it, and
    fails after `timeout`. `target` is a closed loop: the position must rest within `within` of it. Every move
    ends with the actuator back at its safe value.
    """

    direction: Literal[1, -1]  #: +1 extend, -1 retract
    actuator: str
    value: float  #: what the actuator is commanded to
    position: str | None  #: the channel that reads the position, where the rig has one
    duration: float | None = None  #: s
    until: Expression | None = None
    target: float | None = None  #: m
    within: float | None = None  #: m, half width; given with `target`
    timeout: float | None = None  #: s; given with `until` and `target`


@dataclass(frozen=True, slots=True)
class Hold:
    """Watch `channel` for `duration`; the step fails at the first sample outside `at` ± `within`."""

    duration: float  #: s
    channel: str
    at: float | None  #: SI; None: the value found when the step starts
    within: float  #: half width, an interval


@dataclass(frozen=True, slots=True)
class Wait:
    """Let time pass: `duration` seconds, or until a condition holds, failing after `timeout`."""

    duration: float | None = None  #: s
    until: Expression | None = None
    timeout: float | None = None  #: s; given with `until`


@dataclass(frozen=True, slots=True)
class Set:
    """Command actuators by name, all at once; with `duration`, each goes back to its safe value after it."""

    values: Mapping[str, float]
    duration: float | None = None  #: s

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))


@dataclass(frozen=True, slots=True)
class Prompt:
    """Ask the operator. Without a name a confirmation is enough; with one, the value is kept as data."""

    question: str
    name: str | None = None
    unit: str | None = None  #: the unit an answer is read in and shown in
    low: float | None = None  #: SI, included
    high: float | None = None  #: SI, included
    simulated: float | None = None  #: SI; what a simulated operator answers


class Missed(Enum):
    """What follows when a measure lies outside its limits."""

    FAIL = "fail"  #: the step fails, and with it the record and the run
    CONTINUE = "continue"  #: it is recorded as missed; the run goes on and ends with exit code 1


class Stretch(Enum):
    """Over which samples the statistics of a measure are taken."""

    RECORD = "record"  #: the open record, from its first sample to now
    PHASE = "phase"  #: since the last change of a command
    WINDOW = "window"  #: the last `window` seconds, inside a record or outside


@dataclass(frozen=True, slots=True)
class Measure:
    """A value from recorded data, kept with its record, and compared with its limits.

    `expression` names statistics by `Statistic.key`, and earlier measures and operators' answers by name;
    see `rigctl.procedure.statistics`.
    """

    name: str
    expression: Expression
    statistics: tuple[Statistic, ...]
    unit: str
    stretch: Stretch
    window: float | None = None  #: s; given with Stretch.WINDOW
    low: float | None = None  #: SI, included
    high: float | None = None  #: SI, included
    missed: Missed = Missed.FAIL
    difference: bool = False  #: an interval of temperatures, shown without offset

    def passes(self, value: float) -> bool:
        """True when the value is inside the limits; never for a value that is not a number."""
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        return low <= value <= high


Action: TypeAlias = Heat | SetLevel | Move | Hold | Wait | Set | Prompt | Measure
