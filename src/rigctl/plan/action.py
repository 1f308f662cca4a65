"""Actions of single steps on the bench, with every variable resolved; immutable, SI throughout.

Each kind of action is defined with its step in `rigctl.steps`. It states *what* is to be reached and when to
give up, forecasts how long that takes, and carries it out on a bench. Set-points of temperature are absolute
(K), tolerances are intervals (K).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from rigctl.errors import RigctlError
from rigctl.plan.behaviour import Behaviour, Bench, Question
from rigctl.plan.forecast import Forecast, ForecastBench, State
from rigctl.rig import Rig


@dataclass(frozen=True, slots=True)
class SetPoint:
    """The value that an action brings a channel to, or holds it at; SI.

    Attributes
    ----------
    to: the target value; None for the first reading after the action has started.
    within: half width of the tolerance, if there is one.
    ramp: rate at which the set-point moves there from that first reading, per s; None for a step change.
    """

    channel: str
    to: float | None
    within: float | None = None
    ramp: float | None = None


class Action(ABC):
    """One thing that a plan does on the bench; subclasses are frozen dataclasses."""

    __slots__ = ()

    @abstractmethod
    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """The expected duration from `state`, and the expected state of the bench afterwards."""

    @abstractmethod
    def carry_out(self, bench: Bench) -> Behaviour:
        """A generator that carries it out on `bench`, yields its wait conditions, and returns its outcome.

        Raises
        ------
        StepFailed
            it could not be done; the message reports the observation.
        """

    @property
    def needed_rate(self) -> float:
        """The sampling rate that it cannot do without between records, Hz; 0 where any will do."""
        return 0.0

    def refusal(self, bench: Bench) -> RigctlError | None:
        """Why this bench cannot do it, asked before anything moves; None where it can."""
        return None

    def questions(self, rig: Rig) -> tuple[Question, ...]:
        """The questions to the operator that it waits for on this bench, in order."""
        return ()

    def lasting(self) -> frozenset[str]:
        """The actuators whose state it sets beyond its end: a resumed run repeats the last such action for
        each."""
        return frozenset()

    def set_point(self) -> SetPoint | None:
        """The channel that is controlled and its target; None if the action controls no channel."""
        return None
