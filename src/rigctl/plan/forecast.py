"""The forecast of one action before anything moves, and the properties of the bench that it is based on.

An action makes its forecast from a `State` and a `ForecastBench`; `rigctl.planning` does so for all actions
of a plan in order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol, TypeAlias

from rigctl.rig import Rig


class Basis(IntEnum):
    """The basis of an expected duration, from the most to the least certain."""

    TIMED = 0  #: the procedure states it
    ESTIMATED = 1  #: from the rig's geometry and heat balance
    GUESSED = 2  #: an assumption about how long a person takes
    AT_MOST = 3  #: it ends on a condition; this is its timeout


#: the lowest and highest reading of a channel according to a forecast, SI
Extents: TypeAlias = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class State:
    """The expected state of the bench; SI, None where the rig file does not determine it."""

    temperature: float | None
    pressure: float
    position: float
    levels: Mapping[str, float] = field(default_factory=dict)  #: set so far, by actuator; safe where absent


@dataclass(frozen=True, slots=True)
class Forecast:
    """The expected duration and effect of one action."""

    seconds: float
    basis: Basis
    state: State
    reaches: Extents = field(default_factory=dict)
    warning: str | None = None


class OilTank(Protocol):
    """The time course of the oil temperature (K) at a supply pressure (Pa), with the heater on or off."""

    def limit(self, pressure: float, heating: bool) -> float:
        """Return the steady-state temperature of the oil, K; infinite without any heat loss."""
        ...

    def after(self, temperature: float, seconds: float, pressure: float, heating: bool) -> float:
        """Return the temperature `seconds` later, K."""
        ...

    def time_to(self, target: float, temperature: float, pressure: float, heating: bool) -> float:
        """Return the time until `target` is reached, s; infinite if it never is."""
        ...


class ForecastBench(Protocol):
    """The properties of a rig on which forecasts are based."""

    @property
    def rig(self) -> Rig:
        """The rig."""
        ...

    @property
    def simulated(self) -> bool:
        """True if the operator is simulated and answers after the rig's `answer_delay`."""
        ...

    @property
    def tank(self) -> OilTank | None:
        """The heat balance of the oil; None if the rig file has none."""
        ...

    @property
    def stroke(self) -> float | None:
        """The stroke of the cylinder in m; None if the rig file does not state it."""
        ...

    def operator_time(self, person: float) -> float:
        """Return the time that the operator takes, s, for a task that takes a person `person` s."""
        ...

    def pass_time(self, state: State, seconds: float, *, heating: bool = False) -> State:
        """Return the state `seconds` later: the pump heats the oil, the surroundings cool it."""
        ...

    def speed(self, direction: int, state: State) -> float | None:
        """Return the speed of a move, m/s; None if the rig file does not determine it."""
        ...
