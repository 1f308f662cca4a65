"""Templates with a position or another output that may overshoot: a second-order lag, masses.

In: a table with its roles. Out: a `Draft` that begins at the best linear system of the same form
(`rigctl.proposal.responses`). A log of position and force determines only ratios to the mass; the gain of a
voltage behind the force, or of a sensor, is then a fixed number to be measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.proposal.columns import Column, Table
from rigctl.proposal.draft import Draft, Formula, Parameter, State, amount, either, positive, ratio
from rigctl.proposal.from_columns import (
    acting,
    at_inputs,
    at_rest,
    begin,
    chosen,
    counted,
    duration,
    given,
    maybe,
    need,
    reading,
    references,
    require_outputs,
    sensors,
    span,
    unknown_start,
)
from rigctl.proposal.responses import (
    Response,
    driven_mass_response,
    second_order_response,
    tells_no_directions,
)
from rigctl.units import parse_unit


def second_order(table: Table) -> Draft:
    """``y'' = w²·(rest + gain·u − y) − 2·zeta·w·y'``; read as its magnitude where it never is negative."""
    inputs, y = chosen(table, "input"), require_outputs(table)[0]
    magnitude = tells_no_directions(table, y, inputs)
    found = magnitude or _oscillation(table, y, inputs)
    omega, zeta = found.rates
    state = y.name if magnitude is None else f"{y.name}_with_sign"
    slope = f"{state}_rate"
    parameters = {
        "natural_frequency": positive(omega, "rad/s", "w, undamped"),
        "damping_ratio": positive(zeta, "1", "zeta; below 1 it overshoots"),
        "rest": at_rest(y, found.rest),
    }
    for u, gain in zip(inputs, found.gains, strict=True):
        unit = ratio(y.interval, u.interval)
        parameters[f"gain_{u.name}"] = either(
            gain, unit, 20.0 * span(y) / span(u), f"of {y.name} by {u.name}"
        )
    pushed = "".join(f" + gain_{u.name}*{counted(u)}" for u in inputs)
    start, scale = begin(y)
    per_second = ratio(y.interval, "s")
    fast = span(y) * omega
    constants = references(inputs)
    if magnitude is not None:
        start = unknown_start(f"0 {y.unit}", span(y), y.unit)
        constants["corner"] = (
            amount(0.005 * span(y), y.unit, difference=True),
            "rounds it at zero",
        )
    states = {
        state: State(start, scale, slope),
        slope: State(
            unknown_start(f"0 {per_second}", 0.1 * fast, per_second),
            amount(0.01 * fast, per_second, difference=True),
            f"natural_frequency^2*(rest{pushed} - {state})"
            f" - 2*damping_ratio*natural_frequency*{slope} + drive",
        ),
    }
    return Draft(
        title="Second-order lag" if magnitude is None else "Second-order lag, read without its sign",
        equations=(
            f"d2({state})/dt2 = w^2*(rest + gain*input - {state}) - 2*zeta*w*d({state})/dt",
            *([f"{y.name} = |{state}|"] if magnitude is not None else []),
        ),
        inputs=given(inputs),
        outputs={y.name: reading(y) if magnitude is None else _without_sign(y, state)},
        states=states,
        parameters=parameters,
        constants=constants,
        slots={
            "drive": (ratio(y.interval, "s^2"), "process", f"what else drives {y.name}"),
            **at_inputs(inputs),
            **sensors([y]),
        },
    )


def _without_sign(y: Column, state: str) -> Formula:
    return Formula(y.unit, f"absolute({state}, corner) + {y.name}_reading", "its sensor tells no directions")


def _oscillation(table: Table, y: Column, inputs: Sequence[Column]) -> Response:
    """w, zeta, gains and rest of a second-order lag, from the data where there are any."""
    found = second_order_response(table, y, inputs)
    if found is not None:
        return found
    middle = float(np.nanmedian(y.values)) if y.values.size else 0.0
    gains = tuple(0.5 * span(y) / span(u) for u in inputs)
    return Response((20.0 / duration(table), 0.5), gains, middle, 1.0)


@dataclass(frozen=True)
class _Moved:
    """A mass by its columns: what is read of its position, and what pushes it.

    Attributes
    ----------
    state: the name of the position; that of the channel, unless a sensor's voltage is read.
    sensor, push: SI per metre or radian of the reading, N or N·m per SI of the command; 1 in their units.
    gains: of both as parameters: no data tell them from the mass, so that no fit changes them.
    """

    x: Column
    force: Column | None
    turning: bool
    state: str
    sensor: float
    push: float
    gains: dict[str, Parameter]

    @property
    def inputs(self) -> list[Column]:
        return [self.force] if self.force is not None else []

    @property
    def unit(self) -> str:
        return "rad" if self.turning else "m"

    @property
    def force_unit(self) -> str:
        return "N*m" if self.turning else "N"

    @property
    def mass_unit(self) -> str:
        return "kg*m^2" if self.turning else "kg"

    @property
    def pushed(self) -> str:
        """What the input pushes with, and a plus."""
        if self.force is None:
            return ""
        return (
            f"force_gain*{acting(self.force)} + "
            if "force_gain" in self.gains
            else f"{acting(self.force)} + "
        )

    def states(self, fast: float, rate: str) -> dict[str, State]:
        """Position and speed; `fast` is a typical speed in terms of the reading."""
        u, speed = self.unit, f"{self.state}_speed"
        moving = State(
            unknown_start(f"0 {u}/s", 0.1 * fast / self.sensor, f"{u}/s"),
            amount(0.01 * fast / self.sensor, f"{u}/s"),
            rate.replace("SPEED", speed).replace("POSITION", self.state),
        )
        start, scale = begin(self.x)
        if self.state != self.x.name:
            width = span(self.x) / self.sensor
            first = amount(self.first / self.sensor, "mm")
            start, scale = unknown_start(first, 0.1 * width, "mm"), amount(0.01 * width, "mm")
        return {self.state: State(start, scale, speed), speed: moving}

    @property
    def first(self) -> float:
        present = self.x.values[np.isfinite(self.x.values)]
        return float(present[0]) if present.size else 0.0

    @property
    def output(self) -> Formula:
        if self.state == self.x.name:
            return reading(self.x)
        shown = f"sensor_gain*{self.state} + {self.x.name}_reading"
        return Formula(self.x.unit, shown, "the voltage of the position sensor")


def _moved(table: Table) -> _Moved:
    x = need(table, "output", ["m", "rad", "V"], "a position, or its sensor's voltage,")
    force = maybe(table, "input", ["N", "N*m", "V", "A", "1"])
    read = x.display.dimension == parse_unit("V").dimension
    turning = not read and x.display.dimension != parse_unit("m").dimension
    if force is not None and force.display.dimension == parse_unit("N*m").dimension:
        turning = turning or not read
    gains, sensor, push = dict[str, Parameter](), 1.0, 1.0
    if read:
        unit = ratio(x.unit, "mm")
        gains["sensor_gain"] = Parameter(
            1.0, unit, -1e6, 1e6, "of the position sensor: calibrate it", fit=False
        )
        sensor = parse_unit(unit).factor
    direct = ("N*m",) if turning else ("N",)
    if force is not None and all(force.display.dimension != parse_unit(u).dimension for u in direct):
        unit = ratio("N*m" if turning else "N", force.interval)
        gains["force_gain"] = Parameter(1.0, unit, -1e6, 1e6, f"of {force.name}: measure it", fit=False)
        push = parse_unit(unit).factor
    return _Moved(x, force, turning, "displacement" if read else x.name, sensor, push, gains)


def _toward(moved: _Moved, gain: float) -> _Moved:
    """With the force's gain negative where the command pushes backwards."""
    if gain >= 0.0 or "force_gain" not in moved.gains:
        return moved
    one = moved.gains["force_gain"]
    turned = Parameter(-one.value, one.unit, one.low, one.high, one.meaning, one.fit)
    return _Moved(
        moved.x,
        moved.force,
        moved.turning,
        moved.state,
        moved.sensor,
        -moved.push,
        moved.gains | {"force_gain": turned},
    )


def mass_spring_damper(table: Table) -> Draft:
    """``m·x'' = F − c·x' − k·(x − rest)``."""
    moved = _moved(table)
    x = moved.x
    found = _oscillation(table, x, moved.inputs)
    (omega, zeta), gains, rest = found.rates, found.gains, found.rest
    moved = _toward(moved, gains[0] if gains else 1.0)
    # the reading's gain by the command is sensor·push/k
    stiffness = abs(moved.sensor * moved.push / gains[0]) if gains and gains[0] else omega**2
    mass = stiffness / omega**2
    u, unit_f = moved.unit, moved.force_unit
    parameters = {
        "mass": positive(mass, moved.mass_unit, "m; inertia where it turns", fit=moved.force is not None),
        "damping": positive(2.0 * zeta * omega * mass, f"{unit_f}*s/{u}", "c"),
        "stiffness": positive(stiffness, f"{unit_f}/{u}", "k"),
        "rest": at_rest(x, rest) if moved.state == x.name else _rest_behind(moved, rest),
        **moved.gains,
    }
    rate = f"({moved.pushed}extra_force - damping*SPEED - stiffness*(POSITION - rest))/mass"
    return Draft(
        title="Mass on a spring with a damper",
        equations=("mass * dv/dt = force - damping*v - stiffness*(x - rest)",),
        inputs=given(moved.inputs),
        outputs={x.name: moved.output},
        states=moved.states(span(x) * omega, rate),
        parameters=parameters,
        slots={
            "extra_force": (unit_f, "process", "what else acts on the mass"),
            **at_inputs(moved.inputs),
            **sensors([x]),
        },
    )


def _rest_behind(moved: _Moved, rest: float) -> Parameter:
    """Where the mass rests, of which a voltage is read."""
    factor = moved.sensor * 1e-3
    width = span(moved.x) / factor
    at = rest / factor
    return Parameter(at, "mm", at - 5.0 * width, at + 5.0 * width, "where it rests without any input")


def driven_mass(table: Table) -> Draft:
    """``m·x'' = F + constant − c·x'``: an axis or a cart, without a spring."""
    moved = _moved(table)
    x = moved.x
    if moved.force is None:
        need(table, "input", ["N", "N*m", "V", "A", "1"], "a force, or the voltage behind it,")
    found = driven_mass_response(table, x, moved.inputs)
    slow, gain, constant = 1.0 / duration(table), 1.0, 0.0
    if found is not None:
        (slow,), (gain,), constant = found.rates, found.gains, found.rest
    moved = _toward(moved, gain)
    mass = abs(moved.sensor * moved.push / gain) if gain else 1.0
    u, unit_f = moved.unit, moved.force_unit
    assert moved.force is not None  # noqa: S101 - `need` refused the draft
    largest = abs(moved.push) * span(moved.force)
    parameters = {
        "mass": positive(mass, moved.mass_unit, "m; inertia where it turns"),
        "damping": positive(slow * mass, f"{unit_f}*s/{u}", "c, viscous friction"),
        "constant_force": either(constant * mass / moved.sensor, unit_f, largest, "a slope, a wrong zero"),
        **moved.gains,
    }
    rate = f"({moved.pushed}constant_force + extra_force - damping*SPEED)/mass"
    fast = span(x) * max(slow, 2.0 * math.pi / duration(table))
    return Draft(
        title="Driven mass",
        equations=("mass * dv/dt = force + constant_force - damping*v",),
        inputs=given(moved.inputs),
        outputs={x.name: moved.output},
        states=moved.states(fast, rate),
        parameters=parameters,
        slots={
            "extra_force": (unit_f, "process", "what else acts on the mass: friction"),
            **at_inputs(moved.inputs),
            **sensors([x]),
        },
    )
