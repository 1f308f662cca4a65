"""A record as instructions for a bench: the operating point, the initial state, and the steps.

In: the rig, and where the model's inputs come from (`Stage`). Out: the inputs of a record over time, in SI,
for the simulation, and its steps as text, for the procedure. Both come from one `Recipe`, so that what is
simulated is what will be carried out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rigctl.design.virtual_records import PlannedRecord
from rigctl.model.inputs import InputSource, input_values
from rigctl.rig.rig import Rig
from rigctl.rig.roles import MoveRole
from rigctl.steps.waveform.multisine import multisine
from rigctl.steps.waveform.shapes import commands
from rigctl.units import parse_unit, show

#: upper limit on the number of samples while levels hold before a record
_LOOKS = 2000.0
#: the action of a step of a record
Verb = Literal["wait", "extend", "retract", "set", "waveform"]


@dataclass(frozen=True)
class Drive:
    """One actuator along one period of a multisine: lines 1 to `lines` of 1/period, of equal amplitudes.

    Attributes
    ----------
    mean, amplitude: SI; `amplitude` is the largest deviation from the mean.
    period: s.
    rate: commands per second; between two of them the first is held.
    """

    actuator: str
    mean: float
    amplitude: float
    period: float
    lines: int
    rate: float

    def course(self) -> list[tuple[float, float]]:
        """The commands within the period, as the step `waveform` gives them: times in s, SI values."""
        shape = multisine(
            self.mean, (1.0 / self.period, self.lines / self.period), self.period, amplitude=self.amplitude
        )
        return [one for one in commands(shape, 1.0 / self.rate) if one[0] < self.period]

    def text(self, rig: Rig) -> str:
        """As written in a procedure, with the digits by which it finds the same lines."""
        actuator = rig.actuators[self.actuator]
        mean = show(self.mean, actuator.display_unit, digits=6)
        amplitude = show(self.amplitude, actuator.display_unit, difference=True, digits=6)
        low, high = (f"{line / self.period:.9g} Hz" for line in (1, self.lines))
        return (
            f"{{actuator: {self.actuator}, multisine: {{mean: {mean}, from: {low}, "
            f"to: {high}, amplitude: {amplitude}, period: {seconds(self.period)}}}, rate: {self.rate:g} Hz}}"
        )


@dataclass(frozen=True)
class Step:
    """One step of a record: a move or a wait for a time, levels that are held, or a waveform.

    Attributes
    ----------
    seconds: its duration.
    levels: for `set`, by actuator, SI.
    drive: for `waveform`.
    """

    verb: Verb
    seconds: float
    levels: Mapping[str, float] = field(default_factory=dict)
    drive: Drive | None = None


@dataclass(frozen=True)
class Recipe:
    """All that is done for one record.

    Attributes
    ----------
    temperature: to which the oil, or the heated part, is brought before, SI; None if no step does that.
    pressure: set before, SI; None if no step does that.
    before: levels that hold before the record, by actuator, SI.
    rest: time for which they hold, s.
    steps: in the record.
    rate: Hz.
    """

    steps: tuple[Step, ...]
    rate: float
    temperature: float | None = None
    pressure: float | None = None
    before: Mapping[str, float] = field(default_factory=dict)
    rest: float = 0.0

    @property
    def length(self) -> float:
        """Recorded time, s."""
        return sum(step.seconds for step in self.steps)

    @property
    def moves(self) -> bool:
        """Whether something moves in it and must be brought home before."""
        return any(step.verb in ("extend", "retract") for step in self.steps)

    def settings(self, rig: Rig) -> dict[str, str]:
        """The operating point by channel or actuator, as displayed."""
        settings = {}
        for value, role in ((self.temperature, rig.roles.heat), (self.pressure, rig.roles.set_pressure)):
            if value is not None and role is not None:
                settings[role.channel] = written(value, rig.channels[role.channel].unit)
        for name, value in self.before.items():
            settings[name] = rig.actuators[name].show(value)
        return settings


def written(value: float, unit: str) -> str:
    """An SI value as a procedure states it."""
    return show(value, unit, digits=6)


def seconds(value: float) -> str:
    """A time as a procedure states it."""
    return f"{value:.6g} s"


@dataclass(frozen=True)
class Stage:
    """Where recipes are carried out: the rig, and the meaning of its commands to the model.

    Attributes
    ----------
    sources: of the model's inputs, in order.
    standing: values of the inputs that nothing commands, as in the data so far, SI.
    readings: first readings of the channels in the record from which recipes are built, SI.
    """

    rig: Rig
    sources: tuple[InputSource, ...]
    standing: Mapping[str, float]
    readings: Mapping[str, float]

    def course(self, recipe: Recipe, label: str = "designed") -> PlannedRecord:
        """The inputs of a recipe's record, and the first readings of the channels."""
        commands = self.commands_before(recipe)
        # Commands as the runner would give them, in SI: what is simulated is what the procedure will do.
        times, rows = [0.0], [self.inputs(commands)]
        clock = 0.0
        for step in recipe.steps:
            for since, changed in self._commanded(step):
                commands = commands | changed
                row, at = self.inputs(commands), clock + since
                if at > 0.0 and not np.array_equal(row, rows[-1]):
                    times.append(at)
                    rows.append(row)
                elif at == 0.0:
                    rows[0] = row
            clock += step.seconds
            commands = commands | self._after(step)
        return PlannedRecord(np.array(times), np.array(rows), clock, recipe.rate, self.first(recipe), label)

    def standing_course(self, recipe: Recipe, readings: Mapping[str, float] | None = None) -> PlannedRecord:
        """The inputs before the record, while the levels hold, starting at these readings or those so far."""
        row = self.inputs(self.commands_before(recipe))
        start = self.readings if readings is None else readings
        rate = min(recipe.rate, _LOOKS / recipe.rest)
        return PlannedRecord(np.zeros(1), np.array([row]), recipe.rest, rate, dict(start), "rest")

    def first(self, recipe: Recipe) -> dict[str, float]:
        """The first readings of the channels: the value set, else that in the data so far."""
        readings = dict(self.readings)
        roles = self.rig.roles
        if recipe.temperature is not None and roles.heat is not None:
            readings[roles.heat.channel] = recipe.temperature
        if recipe.pressure is not None and roles.set_pressure is not None:
            self._scaled_to(readings, roles.set_pressure.channel, recipe.pressure)
        return readings

    def inputs(self, commands: Mapping[str, float]) -> list[float]:
        """The model's inputs for the actuators' SI values."""
        values = input_values(self.sources, commands)
        return [
            self.standing.get(source.input, value) if not source.actuators else value
            for source, value in zip(self.sources, values, strict=True)
        ]

    def commands_before(self, recipe: Recipe) -> dict[str, float]:
        """Every actuator's value at the start of the record: safe, except what was set."""
        commands = {
            name: actuator.read(self.rig.safe_state[name].text) if name in self.rig.safe_state else 0.0
            for name, actuator in self.rig.actuators.items()
        }
        role = self.rig.roles.set_pressure
        if role is not None and recipe.pressure is not None:
            commands[role.actuator] = recipe.pressure
        return commands | dict(recipe.before)

    def _commanded(self, step: Step) -> list[tuple[float, dict[str, float]]]:
        """The commands of a step: times in s from its start, and what changes then."""
        if step.drive is not None:
            return [(time, {step.drive.actuator: value}) for time, value in step.drive.course()]
        if step.verb == "set":
            return [(0.0, dict(step.levels))]
        role = self._mover(step)
        if role is None:
            return [(0.0, {})]
        return [(0.0, {role.actuator: self.rig.actuators[role.actuator].read(role.value.text)})]

    def _after(self, step: Step) -> dict[str, float]:
        """A move ends with its actuator safe; a level remains."""
        role = self._mover(step)
        return {} if role is None else {role.actuator: self.commands_before(Recipe((), 1.0))[role.actuator]}

    def _mover(self, step: Step) -> MoveRole | None:
        return {"extend": self.rig.roles.extend, "retract": self.rig.roles.retract}.get(step.verb)

    def _scaled_to(self, readings: dict[str, float], channel: str, pressure: float) -> None:
        """Before a record, pressures are in proportion to the set one."""
        known = readings.get(channel, 0.0)
        for name, value in list(readings.items()):
            same = name in self.rig.channels and self.rig.channels[name].quantity == "pressure"
            if same and name != channel and known > 0.0:
                readings[name] = value * pressure / known
        readings[channel] = pressure


def rounded(value: float, unit: str, step: float) -> float:
    """An SI value at a whole number of steps in the unit in which it is written."""
    shown = parse_unit(unit)
    return float(shown.to_si(round(shown.from_si(value) / step) * step))


def lines_of(recipe: Recipe, rig: Rig) -> tuple[str, ...]:
    """The steps of the record, one line each, as in a procedure without its dashes."""
    lines: list[str] = []
    for step in recipe.steps:
        if step.drive is not None:
            lines.append(f"waveform: {step.drive.text(rig)}")
        elif step.verb == "set":
            lines.append(f"set: {levels_text(step.levels, rig)}")
            lines.append(f"wait: {seconds(step.seconds)}")
        else:
            lines.append(f"{step.verb}: {seconds(step.seconds)}")
    return tuple(lines)


def levels_text(levels: Mapping[str, float], rig: Rig) -> str:
    """Levels as written in a procedure: ``{heater_1: 40 %}``."""
    return (
        "{" + ", ".join(f"{name}: {rig.actuators[name].show(value)}" for name, value in levels.items()) + "}"
    )
