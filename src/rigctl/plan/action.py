"""The actions of single steps on the bench, with all variables resolved; immutable, SI throughout.

Each kind of action is defined with its step in `rigctl.steps`. It states *what* is to be reached and after
which time the step fails, forecasts its duration, and executes it on a bench. Set-points of temperature are
absolute (K), tolerances are intervals (K).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from rigctl.errors import RigctlError
from rigctl.plan.behaviour import Behaviour, Question, StepBench
from rigctl.plan.forecast import Forecast, ForecastBench, State
from rigctl.rig import Rig


@dataclass(frozen=True, slots=True)
class SetPoint:
    """The value to which an action brings a channel, or at which it holds it; SI.

    Attributes
    ----------
    to: the target value; None for the first reading after the action has started.
    within: half width of the tolerance, if there is one.
    ramp: rate at which the set-point moves to it from the first reading, per s; None for a step change.
    """

    channel: str
    to: float | None
    within: float | None = None
    ramp: float | None = None


class Action(ABC):
    """What one step of a plan does on the bench; subclasses are frozen dataclasses."""

    __slots__ = ()

    @abstractmethod
    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Return the expected duration from `state`, and the expected state of the bench afterwards."""

    @abstractmethod
    def carry_out(self, bench: StepBench) -> Behaviour:
        """Return a generator that executes it on `bench`, yields wait conditions, and returns its outcome.

        Raises
        ------
        StepFailed
            it could not be completed; the message reports what was observed.
        """

    @property
    def needed_rate(self) -> float:
        """The minimum sampling rate that it needs outside records, Hz; 0 if any rate is sufficient."""
        return 0.0

    def refusal(self, bench: StepBench) -> RigctlError | None:
        """Return the error if this bench cannot execute it, checked before anything moves; None if it can."""
        return None

    def questions(self, rig: Rig) -> tuple[Question, ...]:
        """Return the questions to the operator whose answers it waits for on this bench, in order."""
        return ()

    def lasting(self) -> frozenset[str]:
        """Return the actuators that keep the state it sets after its end; a resumed run repeats the last such
        action for each."""
        return frozenset()

    def set_point(self) -> SetPoint | None:
        """Return the channel that it controls, and the target; None if it controls no channel."""
        return None

    def settles_at(self) -> SetPoint | None:
        """Return the channel and the tolerance in which its reading has to settle; None if there is none."""
        return self.set_point()
