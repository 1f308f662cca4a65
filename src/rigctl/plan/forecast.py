"""What is expected of one action before anything moves, and what a forecast may ask of the bench.

An action forecasts itself from a `State` and a `ForecastBench`; `rigctl.planning` walks a plan with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol, TypeAlias

from rigctl.rig import Rig

#: s that a person is assumed to take: to turn a valve until the gauge is right, to answer, to type a value
TURNING = 20.0
ANSWERING = 10.0
TYPING = 20.0


class Basis(IntEnum):
    """What an expected duration rests on; the larger, the less it is worth."""

    TIMED = 0  #: the procedure says how long
    ESTIMATED = 1  #: from the rig's geometry and heat balance
    GUESSED = 2  #: a person is assumed to take so long
    AT_MOST = 3  #: it ends on a condition; this is its timeout


#: what a forecast says a channel will read at most and at least, SI
Extents: TypeAlias = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class State:
    """Where the bench is expected to be; SI, None where the rig does not say."""

    temperature: float | None
    pressure: float
    position: float


@dataclass(frozen=True, slots=True)
class Forecast:
    """What one action is expected to do."""

    seconds: float
    basis: Basis
    state: State
    reaches: Extents = field(default_factory=dict)
    warning: str | None = None


class OilTank(Protocol):
    """How the oil's temperature (K) moves at a supply pressure (Pa), with the heater on or off."""

    def limit(self, pressure: float, heating: bool) -> float:
        """The temperature that the oil settles at in the end; infinite without any loss."""
        ...

    def after(self, temperature: float, seconds: float, pressure: float, heating: bool) -> float:
        """The temperature `seconds` later."""
        ...

    def time_to(self, target: float, temperature: float, pressure: float, heating: bool) -> float:
        """Seconds until `target` is reached; infinite when it never is."""
        ...


class ForecastBench(Protocol):
    """A rig as forecasts see it."""

    @property
    def rig(self) -> Rig:
        """The rig."""
        ...

    @property
    def simulated(self) -> bool:
        """True when the operator is simulated, and answers after the rig's `answer_delay`."""
        ...

    @property
    def tank(self) -> OilTank | None:
        """What heats and cools the oil; None when the rig does not say."""
        ...

    @property
    def stroke(self) -> float | None:
        """The length of the cylinder in m; None when the rig does not say."""
        ...

    def operator_time(self, person: float) -> float:
        """Seconds that the operator takes where a person would take `person`."""
        ...

    def pass_time(self, state: State, seconds: float, *, heating: bool = False) -> State:
        """The state `seconds` later: the pump heats the oil, the room cools it."""
        ...

    def speed(self, direction: int, state: State) -> float | None:
        """Metres per second of a move; None when the rig does not say."""
        ...
