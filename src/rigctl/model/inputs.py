"""The correspondence between a bench's commands and its model's inputs.

In: the inputs that a family declares, and a rig. Out: an `InputSource` for each: which actuators set it,
by which factors, or which constant value or channel stands for it. A family knows no rig and a rig no
equations; this is where they meet.

A role comes before a name, because a rig calls its valve what it likes. One input may have two actuators,
a solenoid for each direction, and a heater that is a switch needs a stated power: its input is in watts.
What nothing commands and nobody states is the family's usual value, and is marked as not stated (`said`),
so that analyses can treat it as an assumption.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rigctl.errors import RigctlError
from rigctl.physics.families import find_family
from rigctl.physics.family import InputVariable, ModelFamily
from rigctl.rig.rig import Rig
from rigctl.units import describe, is_speed_of_rotation, parse_unit


@dataclass(frozen=True)
class InputSource:
    """One input of the model: ``value + sum of factor * command`` over `actuators`, all SI.

    `channel` is the rig's channel that records the input, if it has one and nothing commands the input; its
    readings override `value`. `hold` is the input's behaviour between two of its values. `said` is True if a
    file or a person gives `value`, not only the family.
    """

    input: str
    value: float
    actuators: tuple[tuple[str, float], ...] = ()
    channel: str | None = None
    hold: Literal["previous", "linear"] = "previous"
    said: bool = False

    def of(self, commands: Mapping[str, float]) -> float:
        """The input's value for the actuators' SI values."""
        return self.value + sum(factor * commands[name] for name, factor in self.actuators)


def input_sources(
    family: str | ModelFamily, rig: Rig, given: Mapping[str, float] | None = None
) -> tuple[InputSource, ...]:
    """The source of each input of `family` on `rig`, in the family's order.

    An input is commanded by the actuator with its role or its name; otherwise it is constant: `given`, the
    rig's constant of that name, or the family's usual value.

    Raises
    ------
    RigctlError
        the heater is a switch without a stated power, or an actuator has another dimension than the input of
        its name.
    """
    chosen = find_family(family) if isinstance(family, str) else family
    return tuple(_source(item, rig, given or {}) for item in chosen.inputs)


def input_values(sources: tuple[InputSource, ...], commands: Mapping[str, float]) -> list[float]:
    """The inputs' values for the actuators' SI values, in order."""
    return [source.of(commands) for source in sources]


def commanded_unit(family: ModelFamily, rig: Rig, name: str) -> str:
    """The display unit of the one actuator that sets an input to the commanded value; "" if there is none."""
    item = {one.name: one for one in family.inputs}[name]
    actuators = _of_role(item, rig) if item.role == "set_pressure" else ()
    if not actuators and name in rig.actuators:
        actuators = ((name, 1.0),)
    if len(actuators) != 1:
        return ""
    written = rig.actuators[actuators[0][0]].display_unit
    return written if parse_unit(written).dimension == parse_unit(item.unit).dimension else ""


def require_unit_of(what: str, unit: str, wanted: str) -> None:
    """Require that a unit has the quantity of another one: its dimension, and angles for angles.

    Raises
    ------
    RigctlError
        it does not; `what` is the message's subject.
    """
    if parse_unit(unit).dimension != parse_unit(wanted).dimension:
        raise RigctlError(what, value=unit, expected=f"a unit of {describe(wanted)}")
    if is_speed_of_rotation(unit) != is_speed_of_rotation(wanted):
        raise RigctlError(
            what,
            value=unit,
            expected="rpm, rad/s or deg/s: a count per time names neither turns nor radians"
            if is_speed_of_rotation(wanted)
            else "rpm or rad/s in the family file too, if it turns",
        )


def _source(item: InputVariable, rig: Rig, given: Mapping[str, float]) -> InputSource:
    # by role, then by name: a rig calls its valve what it likes
    actuators = _of_role(item, rig)
    if actuators or item.name in rig.actuators:
        commands = actuators or ((item.name, _factor(item, rig)),)
        return InputSource(item.name, 0.0, commands, hold=item.hold or "previous")
    # nothing commands it: what the user gives, else the rig's constant, else the family's value, which counts
    # as not stated
    known = {**rig.constants, **given}
    value = float(known.get(item.name, item.value))
    channel = item.name if item.name in rig.channels else None
    stated = item.name in known or item.implied
    return InputSource(item.name, value, channel=channel, hold=item.hold or "linear", said=stated)


def _of_role(item: InputVariable, rig: Rig) -> tuple[tuple[str, float], ...]:
    if item.role == "move":
        return _of_moves(rig)
    if item.role == "heat" and rig.roles.heat is not None:
        return ((rig.roles.heat.actuator, _power(rig, rig.roles.heat.actuator)),)
    if item.role == "set_pressure" and rig.roles.set_pressure is not None:
        return ((rig.roles.set_pressure.actuator, 1.0),)
    return ()


def _of_moves(rig: Rig) -> tuple[tuple[str, float], ...]:
    """Actuators and factors: one valve with three positions, or a solenoid for each direction."""
    factors: dict[str, float] = {}
    for role, direction in ((rig.roles.extend, 1.0), (rig.roles.retract, -1.0)):
        position = 0.0 if role is None else rig.actuators[role.actuator].read(role.value)
        if role is not None and position:
            factors[role.actuator] = direction / position
    return tuple(factors.items())


def _factor(item: InputVariable, rig: Rig) -> float:
    """The factor of the actuator with the input's name; for a switch, its power."""
    written = rig.actuators[item.name].display_unit
    unit, wanted = parse_unit(written), parse_unit(item.unit)
    if unit.dimension == wanted.dimension:
        require_unit_of(f"the model's {item.name} is in {item.unit}", written, item.unit)
        return 1.0
    if wanted.dimension == parse_unit("W").dimension:
        return _power(rig, item.name)
    raise RigctlError(
        f"the actuator '{item.name}' of the rig '{rig.name}' has another dimension than the model's input",
        value=written,
        expected=describe(item.unit),
    )


def _power(rig: Rig, name: str) -> float:
    actuator = rig.actuators[name]
    if actuator.power is not None:
        return actuator.power
    if actuator.unit is None or actuator.unit in ("1", "%"):
        raise RigctlError(
            f"the rig '{rig.name}' does not state the power of '{name}'",
            hint="Add 'power: 2000 W', say, to it",
        )
    return 1.0
