"""What a single step asks of the bench, with every variable resolved: frozen, and SI throughout.

Each kind of action is defined with its step in `rigctl.steps`. It says *what* is wanted and when to give up,
how long that is expected to take, and how it is carried out on a bench. Temperatures are absolute (K) where
they are set-points and intervals (K) where they are tolerances.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from rigctl.errors import RigctlError
from rigctl.plan.behaviour import Behaviour, Bench
from rigctl.plan.forecast import Forecast, ForecastBench, State


@dataclass(frozen=True, slots=True)
class SetPoint:
    """Where an action brings a channel, or keeps it; SI.

    Attributes
    ----------
    to: the value wanted; None is the first reading after the action has begun.
    within: half width of its tolerance, where it has one.
    ramp: how fast the set-point goes there from that first reading, per s; None is at once.
    """

    channel: str
    to: float | None
    within: float | None = None
    ramp: float | None = None


class Action(ABC):
    """One thing that a plan asks of the bench; its subclasses are frozen dataclasses."""

    __slots__ = ()

    @abstractmethod
    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """How long it is expected to take from `state`, and where it leaves the bench."""

    @abstractmethod
    def carry_out(self, bench: Bench) -> Behaviour:
        """A generator that does it on `bench`, yields what it waits for, and returns its outcome.

        Raises
        ------
        StepFailed
            what was asked for could not be done; says what was seen.
        """

    def refusal(self, bench: Bench) -> RigctlError | None:
        """Why this bench cannot do it, asked before anything moves; None where it can."""
        return None

    def lasting(self) -> frozenset[str]:
        """The actuators whose state it decides for good: a resumed run repeats the last action for each."""
        return frozenset()

    def set_point(self) -> SetPoint | None:
        """What a channel is brought to; None of an action that asks nothing of a channel."""
        return None
