"""Initial equations: each template is a draft of a family for the columns that it finds.

In: a table with its roles. Out: a `Draft`: states, parameters with starting values and bounds, and slots.
With data, the values come from them, by least squares that need no start (`responses`, `estimate`): a draft
is text to be edited, and its first fit should not fail for its numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from rigctl.proposal.columns import Column, Floats, Table
from rigctl.proposal.draft import Draft, Formula, Parameter, State, amount, either, positive, ratio
from rigctl.proposal.estimate import rates, straight
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
)
from rigctl.proposal.oscillators import driven_mass, mass_spring_damper, second_order
from rigctl.proposal.responses import first_order_response
from rigctl.units import parse_unit


@dataclass(frozen=True)
class Template:
    """A kind of bench as a starting point.

    Attributes
    ----------
    make: the draft for a table.
    columns: (name, unit, role, typical value) of a table without a file.
    """

    summary: str
    make: Callable[[Table], Draft]
    columns: tuple[tuple[str, str, str, float], ...]


def first_order(table: Table) -> Draft:
    """``T·dy/dt = rest + Σ gain·u − y`` for every output."""
    inputs, outputs = chosen(table, "input"), require_outputs(table)
    states, parameters = dict[str, State](), dict[str, Parameter]()
    for y in outputs:
        tag = "" if len(outputs) == 1 else f"_of_{y.name}"
        # From the data where there are any; else values in proportion to the columns' ranges, for the user to
        # edit.
        found = first_order_response(table, y, inputs)
        constant = 1.0 / found.rates[0] if found else 0.1 * duration(table)
        gains = found.gains if found else [0.5 * span(y) / span(u) for u in inputs]
        parameters[f"time_constant{tag}"] = positive(constant, "s", f"of {y.name}")
        for u, gain in zip(inputs, gains, strict=True):
            name = f"gain{tag}" if len(inputs) == 1 else f"gain_{u.name}{tag}"
            unit = ratio(y.interval, u.interval)
            parameters[name] = either(gain, unit, 20.0 * span(y) / span(u), f"of {y.name} by {u.name}")
        rest = found.rest if found else float(np.nanmedian(y.values)) if y.values.size else 0.0
        parameters[f"rest{tag}"] = at_rest(y, rest)
        pushed = " + ".join(
            f"{f'gain{tag}' if len(inputs) == 1 else f'gain_{u.name}{tag}'}*{counted(u)}" for u in inputs
        )
        start, scale = begin(y)
        rate = f"(rest{tag} - {y.name}{' + ' + pushed if pushed else ''})/time_constant{tag} + {y.name}_drive"
        states[y.name] = State(start, scale, rate)
    return Draft(
        title="First-order lag of every output",
        equations=tuple(f"time_constant * d({y.name})/dt = rest + gain*input - {y.name}" for y in outputs),
        inputs=given(inputs),
        outputs={y.name: reading(y) for y in outputs},
        states=states,
        parameters=parameters,
        constants=references(inputs),
        slots={
            f"{y.name}_drive": (ratio(y.interval, "s"), "process", f"what else drives {y.name}")
            for y in outputs
        }
        | at_inputs(inputs)
        | sensors(outputs),
    )


def motor(table: Table) -> Draft:
    """A DC motor: ``L·di/dt = V − R·i − K·w``, ``J·dw/dt = K·i − b·w − load``."""
    voltage = need(table, "input", ["V"], "the voltage")
    speed = need(table, "output", ["rad/s"], "the speed (rpm or rad/s)")
    current = maybe(table, "output", ["A"])
    load = maybe(table, "input", ["N*m"])
    resistance, constant, inertia, friction = _motor_values(table, voltage, speed, current)
    parameters = {
        "resistance": positive(resistance, "ohm", "R of the winding", fit=current is not None),
        "motor_constant": positive(constant, "N*m/A", "K, torque per ampere and volt per rad/s"),
        "inertia": positive(inertia, "kg*m^2", "J of rotor and load"),
        "friction": positive(friction, "N*m*s/rad", "b, viscous", fit=current is not None),
    }
    start, scale = begin(speed)
    i = current.name if current is not None else "current"
    loaded = f" - {acting(load)}" if load is not None else ""
    amperes = (
        begin(current) if current is not None else ("0 A", amount(0.01 * span(voltage) / resistance, "A"))
    )
    states = {
        i: State(
            *amperes,
            f"({acting(voltage)} - resistance*{i} - motor_constant*{speed.name})/inductance",
        ),
        speed.name: State(
            start,
            scale,
            f"(motor_constant*{i} - friction*{speed.name}{loaded} + extra_torque)/inertia",
        ),
    }
    inputs = [voltage, *([load] if load is not None else [])]
    outputs = [speed, *([current] if current is not None else [])]
    return Draft(
        title="DC motor",
        equations=(
            "inductance * d(current)/dt = voltage - resistance*current - motor_constant*speed",
            "inertia * d(speed)/dt = motor_constant*current - friction*speed - load",
        ),
        inputs=given(inputs),
        outputs={column.name: reading(column) for column in outputs},
        states=states,
        parameters=parameters,
        constants={"inductance": (amount(1e-3 * resistance, "mH"), "L; too fast to be seen in most data")},
        slots={
            "extra_torque": ("N*m", "process", "what else turns the rotor: friction, a load"),
            **at_inputs(inputs),
            **sensors(outputs),
        },
    )


def _motor_values(
    table: Table, voltage: Column, speed: Column, current: Column | None
) -> tuple[float, float, float, float]:
    """R, K, J and b from the data, or usual ones where the data say nothing of them."""
    resistance, constant, inertia, friction = 1.0, 0.05, 1e-4, 1e-5
    if current is not None and current.values.size:
        # With the current: V = R·i + K·w at once, then J and b from the integrated balance. Without it only K
        # and R·J show, and R keeps an assumed value, as does b.
        coefficients = straight(table, voltage, [current.values, speed.values])
        if coefficients[0] > 0.0 and coefficients[1] > 0.0:
            resistance, constant = float(coefficients[0]), float(coefficients[1])
        by, _ = rates(table, speed, [(current.values, False), (speed.values, False)])
        if by[0] > 0.0:
            inertia = constant / float(by[0])
            friction = max(-float(by[1]) * inertia, 1e-2 * constant**2 / resistance)
    elif speed.values.size:
        by, _ = rates(table, speed, [(voltage.values, voltage.stepped), (speed.values, False)])
        if by[0] > 0.0 > by[1]:  # with no friction: gain 1/K, rate K²/(R·J)
            constant = -float(by[1]) / float(by[0])
            inertia = constant**2 / (resistance * -float(by[1]))
            friction = 1e-3 * constant**2 / resistance
    return resistance, constant, inertia, friction


def tank(table: Table) -> Draft:
    """``A·dh/dt = inflow − Cd·a·√(2·g·h)``; of several levels each tank empties into the next."""
    pump = need(table, "input", ["m^3/s", "V", "1"], "the inflow, or what drives the pump")
    levels = [c for c in require_outputs(table) if c.display.dimension == parse_unit("m").dimension]
    if not levels:
        need(table, "output", ["m"], "a level")
    levels = _in_order(table, levels, pump)
    flowing = pump.display.dimension == parse_unit("m^3/s").dimension
    parameters, definitions, states = dict[str, Parameter](), dict[str, Formula](), dict[str, State]()
    constants = {"gravity": ("9.80665 m/s^2", ""), "discharge_coefficient": ("0.61", "Cd of a sharp orifice")}
    area, orifice = _tank_values(table, levels[0], pump, flowing=flowing)
    if not flowing:
        unit = ratio("l/min", pump.interval)
        parameters["pump_gain"] = positive(orifice[1], unit, "flow of the pump")
    inflow = acting(pump) if flowing else f"pump_gain*{counted(pump)}"
    for number, level in enumerate(levels, start=1):
        base, hole = f"base_area_{number}", f"orifice_area_{number}"
        if flowing:
            parameters[base] = positive(area, "cm^2", f"of the tank of {level.name}")
        else:
            constants[base] = (amount(area, "cm^2"), f"of the tank of {level.name}; measure it")
        parameters[hole] = positive(orifice[0], "mm^2", f"of the outlet of {level.name}")
        definitions[f"outflow_{number}"] = Formula(
            "l/min",
            f"discharge_coefficient*{hole}*sqrt(2*gravity*positive_part({level.name}, corner))",
            f"out of the tank of {level.name}",
        )
        into = inflow if number == 1 else f"outflow_{number - 1}"
        start, scale = begin(level)
        states[level.name] = State(start, scale, f"({into} - outflow_{number} + leak_{number})/{base}")
    constants["corner"] = (
        amount(0.005 * max(span(level) for level in levels), levels[0].unit),
        "rounds an empty tank",
    )
    return Draft(
        title="Open tank" if len(levels) == 1 else f"{len(levels)} open tanks in a row",
        equations=("base_area * d(level)/dt = inflow - Cd*orifice_area*sqrt(2*g*level)",),
        inputs=given([pump]),
        outputs={level.name: reading(level) for level in levels},
        states=states,
        parameters=parameters,
        constants=constants | references([pump]),
        definitions=definitions,
        slots={
            f"leak_{number}": ("l/min", "process", f"into the tank of {level.name} besides")
            for number, level in enumerate(levels, start=1)
        }
        | at_inputs([pump])
        | sensors(levels),
    )


def _in_order(table: Table, levels: list[Column], pump: Column) -> list[Column]:
    """The tank that the pump fills first: the one that is best explained by it."""
    if not levels[0].values.size:
        return levels

    def misfit(level: Column) -> float:
        return rates(table, level, [(pump.values, pump.stepped), (_root(level), False)])[1]

    return sorted(levels, key=misfit)


def _root(level: Column) -> Floats:
    return np.asarray(np.sqrt(np.clip(np.nan_to_num(level.values), 0.0, None)))


def _tank_values(
    table: Table, level: Column, pump: Column, *, flowing: bool
) -> tuple[float, tuple[float, float]]:
    """Base area, orifice area and gain of the pump."""
    area, orifice, gain = 0.02, 2e-5, 1e-5
    per_root = 0.61 * math.sqrt(2.0 * 9.80665)
    if level.values.size:
        coefficients, _ = rates(table, level, [(pump.values, pump.stepped), (_root(level), False)])
        if coefficients[0] > 0.0 > coefficients[1]:
            area = 1.0 / float(coefficients[0]) if flowing else area
            gain = float(coefficients[0]) * area
            orifice = -float(coefficients[1]) * area / per_root
    return area, (orifice, gain)


def heater(table: Table) -> Draft:
    """``C·dT/dt = P − UA·(T − T_room)`` for every temperature."""
    power = need(table, "input", ["W", "1", "V"], "the heater's power (or its duty)")
    bodies = [c for c in require_outputs(table) if c.display.dimension == parse_unit("K").dimension]
    if not bodies:
        need(table, "output", ["K"], "a temperature")
    room = maybe(table, "input", ["K"])
    known = power.display.dimension == parse_unit("W").dimension
    parameters, states = dict[str, Parameter](), dict[str, State]()
    constants = dict[str, tuple[str, str]]()
    if not known:
        constants["rated_power"] = (f"1 {ratio('W', power.unit)}", "measure it")
    heat = acting(power) if known else f"rated_power*{acting(power)}"
    around = acting(room) if room is not None else "room"
    coldest = min((float(np.nanmin(b.values)) for b in bodies if b.values.size), default=293.15)
    for body in bodies:
        tag = "" if len(bodies) == 1 else f"_of_{body.name}"
        capacity, conductance, rest = _heater_values(table, body, power, room)
        coldest = rest if room is None and math.isfinite(rest) else coldest
        parameters[f"heat_capacity{tag}"] = positive(capacity, "J/K", f"of the body of {body.name}")
        parameters[f"conductance{tag}"] = positive(conductance, "W/K", f"from {body.name} to the room")
        start, scale = begin(body)
        rate = f"({heat} - conductance{tag}*({body.name} - {around}) + extra_heat{tag})/heat_capacity{tag}"
        states[body.name] = State(start, scale, rate)
    if room is None:
        at = coldest - 273.15
        parameters["room"] = Parameter(at, "degC", at - 30.0, at + 30.0, "around it; record it if you can")
    inputs = [power, *([room] if room is not None else [])]
    return Draft(
        title="Heated body",
        equations=("heat_capacity * dT/dt = power - conductance*(T - room)",),
        inputs=given(inputs),
        outputs={body.name: reading(body) for body in bodies},
        states=states,
        parameters=parameters,
        constants=constants,
        slots={
            f"extra_heat{'' if len(bodies) == 1 else f'_of_{body.name}'}": (
                "W",
                "process",
                f"into the body of {body.name}",
            )
            for body in bodies
        }
        | at_inputs(inputs)
        | sensors(bodies),
    )


def _heater_values(
    table: Table, body: Column, power: Column, room: Column | None
) -> tuple[float, float, float]:
    """C, UA and the room's temperature."""
    if not body.values.size:
        return 500.0, 2.0, 293.15
    # the power as the draft has it: 1 W for one of the input's unit
    watts = (power.values / power.display.factor, power.stepped)
    # C·dT/dt = P − UA·(T − T_room), integrated: linear in 1/C, UA/C and, without a measured room, its
    # temperature.
    away = body.values - room.values if room is not None else body.values
    coefficients, _ = rates(table, body, [watts, (away, False)])
    if not coefficients[0] > 0.0 > coefficients[1]:
        return 10.0 * duration(table), 1.0, float(np.nanmin(body.values))
    capacity = 1.0 / float(coefficients[0])
    return capacity, -float(coefficients[1]) * capacity, -float(coefficients[2]) / float(coefficients[1])


def flow(table: Table) -> Draft:
    """``drop = linear·Q + quadratic·Q·|Q|``: static, its output follows its input at once."""
    through = need(table, "input", ["m^3/s", "kg/s", "m/s"], "a flow")
    drop = need(table, "output", ["Pa", "m"], "a pressure or a head")
    values = [1.0 * span(drop) / span(through), 0.5 * span(drop) / span(through) ** 2, 0.0]
    if drop.values.size:
        coefficients = straight(table, drop, [through.values, through.values * np.abs(through.values)])
        values = [float(value) for value in coefficients]
    per = ratio(drop.interval, through.unit)
    squared = ratio(drop.interval, f"({through.unit})^2")
    parameters = {
        "at_rest": at_rest(drop, values[2]),
        "linear": either(
            values[0], per, 20.0 * span(drop) / span(through), "laminar, or the fall of a pump's curve"
        ),
        "quadratic": either(values[1], squared, 20.0 * span(drop) / span(through) ** 2, "turbulent"),
    }
    q = acting(through)
    formula = f"at_rest + linear*{q} + quadratic*{q}*absolute({q}, corner) + loss"
    return Draft(
        title="Pressure over flow",
        equations=("drop = at_rest + linear*Q + quadratic*Q*|Q|",),
        inputs=given([through], late=False),
        outputs={drop.name: Formula(drop.unit, f"{formula} + {drop.name}_reading")},
        parameters=parameters,
        constants={"corner": (amount(0.005 * span(through), through.unit), "rounds |Q| at zero")},
        slots={
            "loss": (drop.interval, "process", "what else drops"),
            **at_inputs([through], late=False),
            **sensors([drop]),
        },
    )


def linear(table: Table) -> Draft:
    """``y = offset + Σ gain·u``: what a table without time begins with."""
    in_time = table.times is not None
    inputs, outputs = chosen(table, "input"), require_outputs(table)
    parameters, shown = dict[str, Parameter](), dict[str, Formula]()
    for y in outputs:
        tag = "" if len(outputs) == 1 else f"_of_{y.name}"
        coefficients = (
            straight(table, y, [u.values for u in inputs]) if y.values.size else [0.0] * (len(inputs) + 1)
        )
        terms = [f"rest{tag}"]
        parameters[f"rest{tag}"] = at_rest(y, float(coefficients[-1]))
        for u, gain in zip(inputs, coefficients[:-1], strict=True):
            name = f"gain_{u.name}{tag}"
            unit = ratio(y.interval, u.interval)
            parameters[name] = either(float(gain), unit, 20.0 * span(y) / span(u), f"of {y.name} by {u.name}")
            terms.append(f"{name}*{counted(u)}")
        shown[y.name] = Formula(y.unit, f"{' + '.join(terms)} + {y.name}_reading")
    return Draft(
        title="Straight line",
        equations=tuple(f"{y.name} = rest + gain*input" for y in outputs),
        inputs=given(inputs, late=in_time),
        outputs=shown,
        parameters=parameters,
        constants=references(inputs),
        slots=at_inputs(inputs, late=in_time) | sensors(outputs),
    )


#: by the names of `--template`
TEMPLATES: Final[Mapping[str, Template]] = MappingProxyType(
    {
        "first-order": Template(
            "every output is a first-order lag of the inputs",
            first_order,
            (("command", "V", "input", 1.0), ("response", "1", "output", 1.0)),
        ),
        "second-order": Template(
            "one output, with overshoot",
            second_order,
            (("command", "V", "input", 1.0), ("response", "1", "output", 1.0)),
        ),
        "mass-spring-damper": Template(
            "a position or its sensor's voltage, and a force or the voltage behind it if there is one",
            mass_spring_damper,
            (("applied_force", "N", "input", 10.0), ("position", "mm", "output", 10.0)),
        ),
        "driven-mass": Template(
            "a position on a guide without a spring: an axis, a cart; driven by a force or a voltage",
            driven_mass,
            (("applied_force", "N", "input", 10.0), ("position", "mm", "output", 100.0)),
        ),
        "motor": Template(
            "a DC motor: voltage, speed, and current if it is measured",
            motor,
            (
                ("voltage", "V", "input", 12.0),
                ("speed", "rpm", "output", 2000.0),
                ("current", "A", "output", 2.0),
            ),
        ),
        "tank": Template(
            "one open tank, or several in a row: a flow or a pump, and levels",
            tank,
            (("inflow", "l/min", "input", 5.0), ("level", "mm", "output", 200.0)),
        ),
        "heater": Template(
            "a heated body: power, temperature, and the room if it is measured",
            heater,
            (("power", "W", "input", 100.0), ("temperature", "degC", "output", 60.0)),
        ),
        "flow": Template(
            "a pressure or a head over a flow, static: a pump curve, a pipe",
            flow,
            (("flow", "l/min", "input", 20.0), ("pressure_drop", "bar", "output", 2.0)),
        ),
        "linear": Template(
            "static straight lines, what a table without time begins with",
            linear,
            (("setting", "1", "input", 1.0), ("response", "1", "output", 1.0)),
        ),
    }
)
