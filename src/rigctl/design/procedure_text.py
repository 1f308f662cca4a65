"""A set of records as a readable procedure, which `rigctl check` and `rigctl run` accept unchanged.

In: recipes and the rig. Out: the text of a procedure. Its forecast decides whether a record is proposed at
all, and its numbers are those that were simulated, because recipes are rounded to their written form before
anything is computed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rigctl.design.recipe import Recipe, Stage, levels_text, lines_of, seconds, written
from rigctl.model.measured.record import MeasuredRecord
from rigctl.rig.rig import Rig

#: tolerance of a move to home, as a share of the stroke, and in standard deviations of a reading
_HOME_SHARE, _HOME_SIGMAS = 0.004, 5.0
#: tolerance with which a pressure is set, as a share of its range
_WITHIN = 0.01
#: largest width of a comment
_WIDTH = 112


@dataclass(frozen=True)
class ApproachSettings:
    """How an operating point is established: the tolerance (SI), the settling time and the time-out, s."""

    within: float
    settle: float
    timeout: float


HEAT = ApproachSettings(0.5, 60.0, 4.0 * 3600.0)
PRESS = ApproachSettings(0.0, 2.0, 60.0)  #: its tolerance is the rig's
HOME = ApproachSettings(0.0, 0.0, 30.0)


@dataclass(frozen=True)
class Called:
    """The names of the sweeps over the conditions in the data so far.

    Attributes
    ----------
    temperature, pressure: "" if there was no such sweep.
    """

    temperature: str = ""
    pressure: str = ""


def called_so_far(records: Sequence[MeasuredRecord], stage: Stage) -> Called:
    """The names of the sweeps whose values are the ones that were set."""
    pressures = [source.input for source in stage.sources if _is_pressure(stage.rig, source.actuators)]
    index = [source.input for source in stage.sources].index(pressures[0]) if pressures else -1
    heat = stage.rig.roles.heat
    names = {"temperature": "", "pressure": ""}
    for name in dict.fromkeys(name for record in records for name in record.condition):
        values = [record.condition.get(name) for record in records]
        if index >= 0 and all(
            value is not None and abs(value - record.inputs[0, index]) <= 1e-6 * abs(value)
            for value, record in zip(values, records, strict=True)
        ):
            names["pressure"] = name
        elif (
            heat is not None
            and heat.channel in stage.readings
            and all(value is not None and 250.0 < value < 500.0 for value in values)
        ):
            names["temperature"] = name
    return Called(**names)


def _is_pressure(rig: Rig, actuators: Sequence[tuple[str, float]]) -> bool:
    role = rig.roles.set_pressure
    return role is not None and any(name == role.actuator for name, _ in actuators)


@dataclass(frozen=True)
class Writer:
    """Writes procedures for one rig.

    Attributes
    ----------
    rig_reference: the path by which the procedure refers to its rig file; "" leaves it to the command.
    called: the names of sweeps.
    """

    rig: Rig
    rig_reference: str = ""
    called: Called = Called()

    def text(
        self,
        recipes: Sequence[Recipe],
        *,
        title: str = "next experiment",
        description: str = "",
        why: Sequence[str] = (),
        reasons: Sequence[Sequence[str]] = (),
    ) -> str:
        """The procedure, headed by `why`, with `reasons` above each record."""
        lines = [*_comment(why, ""), f"procedure: {title}"]
        if description:
            lines.append(f"description: {_plain(description)}")
        if self.rig_reference:
            lines.append(f"rig: {_plain(self.rig_reference)}")
        lines += ["", "steps:"]
        at: float | None = None
        for number, recipe in enumerate(recipes):
            comment = reasons[number] if number < len(reasons) else ()
            lines += self._record(number + 1, recipe, comment, heat=recipe.temperature != at)
            at = recipe.temperature
        levels = {name: value for recipe in recipes for name, value in recipe.before.items()}
        if levels:
            lines += ["", "finally:", f"  - set: {self._safe(levels)}"]
        return "\n".join(lines) + "\n"

    def _record(self, number: int, recipe: Recipe, comment: Sequence[str], *, heat: bool) -> list[str]:
        swept = self._swept(recipe)
        steps = [*self._before(recipe, swept, heat=heat), *self._recorded(number, recipe)]
        lines = _comment(comment, "  ")
        if not swept:
            return [*lines, *(f"  {line}" for line in steps)]
        points = ", ".join(f"{name}: [{value}]" for name, value in swept.values())
        zipped = ["    zip: true"] if len(swept) > 1 else []
        return [*lines, f"  - for: {{{points}}}", *zipped, "    do:", *(f"      {line}" for line in steps)]

    def _swept(self, recipe: Recipe) -> dict[str, tuple[str, str]]:
        """For each quantity that is set, the sweep's name and its value."""
        roles, swept = self.rig.roles, {}
        if recipe.temperature is not None and roles.heat is not None and self.called.temperature:
            unit = self.rig.channels[roles.heat.channel].unit
            swept["temperature"] = (self.called.temperature, written(recipe.temperature, unit))
        if recipe.pressure is not None and roles.set_pressure is not None and self.called.pressure:
            unit = self.rig.channels[roles.set_pressure.channel].unit
            swept["pressure"] = (self.called.pressure, written(recipe.pressure, unit))
        return swept

    def _before(self, recipe: Recipe, swept: Mapping[str, tuple[str, str]], *, heat: bool) -> list[str]:
        """The steps that establish the operating point and bring the bench home."""
        roles, steps = self.rig.roles, []
        if recipe.temperature is not None and roles.heat is not None and heat:
            to = self._to(recipe.temperature, roles.heat.channel, swept.get("temperature"))
            steps.append(
                f"- heat: {{to: {to}, within: {HEAT.within:g} K, settle: {seconds(HEAT.settle)}, "
                f"timeout: {HEAT.timeout / 3600.0:g} h}}"
            )
        if recipe.moves:
            steps += self._home()
        if recipe.pressure is not None and roles.set_pressure is not None:
            role = roles.set_pressure
            to = self._to(recipe.pressure, role.channel, swept.get("pressure"))
            steps.append(
                f"- set_pressure: {{to: {to}, within: {self._within()}, settle: {seconds(PRESS.settle)}, "
                f"timeout: {seconds(PRESS.timeout)}}}"
            )
        if recipe.before:
            steps.append(f"- set: {levels_text(recipe.before, self.rig)}")
        if recipe.rest > 0.0:
            steps.append(f"- wait: {seconds(recipe.rest)}")
        return steps

    def _to(self, value: float, channel: str, swept: tuple[str, str] | None) -> str:
        return f"${swept[0]}" if swept else written(value, self.rig.channels[channel].unit)

    def _within(self) -> str:
        role = self.rig.roles.set_pressure
        assert role is not None  # noqa: S101 - asked for where there is one
        actuator, channel = self.rig.actuators[role.actuator], self.rig.channels[role.channel]
        width = float(actuator.high or 0.0) - float(actuator.low or 0.0)
        noise = channel.noise_level
        return written(max(_WITHIN * width, _HOME_SIGMAS * noise), channel.unit)

    def _home(self) -> list[str]:
        role = self.rig.roles.retract
        if role is None or role.position is None:
            return []
        channel = self.rig.channels[role.position]
        stroke = float(self.rig.geometry.get("stroke", 0.0))
        near = max(_HOME_SHARE * stroke, _HOME_SIGMAS * channel.noise_level, 2.0 * channel.resolution)
        condition = f"{role.position} < {written(near, channel.unit)}"
        return [f"- retract: {{until: {condition}, timeout: {seconds(HOME.timeout)}}}"]

    def _recorded(self, number: int, recipe: Recipe) -> list[str]:
        head = f"- record: {{name: designed_{number}, rate: {recipe.rate:g} Hz, channels: all}}"
        return [head, "  do:", *(f"    - {line}" for line in lines_of(recipe, self.rig))]

    def _safe(self, levels: Mapping[str, float]) -> str:
        safe = self.rig.safe_state
        safe_levels = {
            name: self.rig.actuators[name].read(safe[name].text) for name in levels if name in safe
        }
        return levels_text(safe_levels, self.rig)


def _comment(sentences: Sequence[str], indent: str) -> list[str]:
    """Sentences as comments, wrapped."""
    from textwrap import wrap

    return [
        f"{indent}# {line}"
        for sentence in sentences
        for line in wrap(" ".join(sentence.split()), _WIDTH - len(indent) - 2)
    ]


def _plain(text: str) -> str:
    """A text as a YAML scalar."""
    import json

    return json.dumps(text, ensure_ascii=False)
