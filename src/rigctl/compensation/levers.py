"""What is varied, and over what: how each acts on a record, and the range of the rig."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.design.recipe import Recipe, Stage
from rigctl.design.scheme import schemes_of
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.measured.record import MeasuredRecord
from rigctl.physics.family import ModelFamily
from rigctl.rig.rig import Rig

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Lever:
    """A quantity of the operating point at the start of a record.

    Attributes
    ----------
    name: of the channel, or of the input.
    unit: in which it is shown.
    low, high: range of the rig, SI; infinite if not stated.
    role: ``heat``, ``set_pressure``, or "" for an input of the model.
    inputs: columns of a record's inputs that it sets, each with its factor.
    """

    name: str
    unit: str
    low: float
    high: float
    role: str
    inputs: tuple[tuple[int, float], ...] = ()

    def of(self, record: MeasuredRecord, outputs: Sequence[str]) -> float:
        """Its value in a record, SI: as set, or as first read."""
        if self.inputs:
            column, factor = self.inputs[0]
            course = record.inputs[:, column] / factor  # the last value may be set for the next record
            return float(course[np.argmax(course != 0.0)])
        present = record.values[:, list(outputs).index(self.name)]
        present = present[np.isfinite(present)][:5]
        return float(np.median(present)) if present.size else float("nan")

    def steady(self, record: MeasuredRecord) -> bool:
        """Whether it has a single value throughout a record, apart from times at which it is off."""
        inside = record.switch_times < record.times[-1] - 1e-9  # at its end the next value may be set
        courses = (record.inputs[inside, column] for column, _ in self.inputs)
        return all(np.unique(course[course != 0.0]).size <= 1 for course in courses)

    def set(self, inputs: Floats, value: float) -> None:
        """Write it into a record's inputs, except where they are off."""
        for column, factor in self.inputs:
            course = inputs[:, column]
            on = course != 0.0 if bool(course.any()) else np.ones(course.size, dtype=bool)
            inputs[on, column] = value * factor

    def recipe(self, recipe: Recipe, value: float) -> Recipe:
        """The recipe with this value."""
        if self.role == "heat":
            return replace(recipe, temperature=value)
        return replace(recipe, pressure=value) if self.role == "set_pressure" else recipe


def levers_of(stage: Stage, records: Sequence[MeasuredRecord], outputs: Sequence[str]) -> dict[str, Lever]:
    """All quantities with which a record of this rig may start, by name."""
    rig = stage.rig
    known = {free.name: free for scheme in schemes_of(stage, records) for free in scheme.free}
    levers: dict[str, Lever] = {}
    heat, pressure = rig.roles.heat, rig.roles.set_pressure
    if heat is not None and heat.channel in outputs:
        free = known.get("temperature")
        low, high = (free.low, free.high) if free is not None else (-np.inf, np.inf)
        levers[heat.channel] = Lever(heat.channel, rig.channels[heat.channel].unit, low, high, "heat")
    moves = {role.actuator for role in (rig.roles.extend, rig.roles.retract) if role is not None}
    for column, source in enumerate(stage.sources):
        for actuator, factor in source.actuators:
            if actuator in moves or (heat is not None and actuator == heat.actuator) or not factor:
                continue
            declared = rig.actuators[actuator]
            if declared.low is None or declared.high is None:
                continue
            low, high = float(declared.low), float(declared.high)
            unit = declared.display_unit
            if pressure is not None and actuator == pressure.actuator:
                free = known.get("pressure")
                low, high = (free.low, free.high) if free is not None else (low, high)
                role, names = "set_pressure", [pressure.channel, actuator]
            else:
                role, names = "", [actuator]
            for name in names:
                levers[name] = Lever(name, unit, low, high, role, ((column, factor),))
    for column, source in enumerate(stage.sources):
        if not source.actuators and source.input in stage.standing:
            unit = next((u for n, u in _shown(stage) if n == source.channel), "")
            if unit:
                levers[source.input] = Lever(source.input, unit, -np.inf, np.inf, "", ((column, 1.0),))
    return levers


def _shown(stage: Stage) -> list[tuple[str, str]]:
    return [(name, channel.unit) for name, channel in stage.rig.channels.items()]


def require_levers(rig: Rig, family: ModelFamily, wanted: Mapping[str, str]) -> None:
    """Check without a fit that the names of `wanted`, by option, may be quantities of the operating point.

    Raises
    ------
    RigctlError
        one is neither, as `levers_of` has it, a channel that is set, an actuator nor an input of the model.
    """
    roles = [role for role in (rig.roles.heat, rig.roles.set_pressure) if role is not None]
    moves = {role.actuator for role in (rig.roles.extend, rig.roles.retract) if role is not None}
    names = {role.channel for role in roles} | (set(rig.actuators) - moves)
    names |= {item.name for item in family.inputs}
    for option, name in wanted.items():
        if name not in names:
            raise _unknown(name, option, names)


def lever(known: Mapping[str, Lever], name: str, option: str) -> Lever:
    """The requested quantity.

    Raises
    ------
    RigctlError
        there is none; the message gives the nearest name.
    """
    if name not in known:
        if not known:
            raise RigctlError("nothing of this rig's operating point can be set", value=name)
        raise _unknown(name, option, known)
    return known[name]


def _unknown(name: str, option: str, known: Iterable[str]) -> RigctlError:
    return unknown_name(f"quantity of the operating point for {option}", name, known)
