"""The bench in a forecast: its state, and how it changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rigctl.families.hydraulic_cylinder.forecast import Cylinder, Tank, cylinder_of, tank_of
from rigctl.plan.forecast import State
from rigctl.rig import Rig


@dataclass(frozen=True, slots=True)
class ForecastBench:
    """A rig as forecasts see it."""

    rig: Rig
    tank: Tank | None
    cylinder: Cylinder | None
    simulated: bool  #: the operator is simulated and answers after the rig's `answer_delay`

    @property
    def stroke(self) -> float | None:
        """The stroke of the cylinder in m; None if the rig file does not state it."""
        return self.cylinder.stroke if self.cylinder is not None else None

    def operator_time(self, person: float) -> float:
        """Seconds that the operator takes for what takes a person `person` seconds."""
        return self.rig.simulation.answer_delay if self.simulated else person

    def pass_time(self, state: State, seconds: float, *, heating: bool = False) -> State:
        """The state `seconds` later: the pump heats the oil, the room cools it."""
        if self.tank is None or state.temperature is None or seconds <= 0.0:
            return state
        return replace(
            state, temperature=self.tank.after(state.temperature, seconds, state.pressure, heating)
        )

    def speed(self, direction: int, state: State) -> float | None:
        """Speed of a move, m/s; None if the rig file does not determine it."""
        return self.cylinder.speed(direction, state.pressure) if self.cylinder is not None else None


def bench_of(rig: Rig) -> ForecastBench:
    """The bench that a rig file describes."""
    return ForecastBench(rig, tank_of(rig), cylinder_of(rig), rig.kind == "simulated")


def initial_state(bench: ForecastBench) -> State:
    """The initial state in the rig file; by default room temperature, no pressure, retracted."""
    rig = bench.rig
    initial = rig.simulation.initial
    heat, pressure, extend = rig.roles.heat, rig.roles.set_pressure, rig.roles.extend
    ambient = bench.tank.ambient if bench.tank is not None else None
    position = extend.position if extend is not None else None
    return State(
        temperature=initial.get(heat.channel, ambient) if heat is not None else None,
        pressure=float(initial.get(pressure.channel, 0.0)) if pressure is not None else 0.0,
        position=float(initial.get(position, 0.0)) if position is not None else 0.0,
    )
