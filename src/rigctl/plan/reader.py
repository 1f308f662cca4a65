"""The context in which a step is read: the rig, the variables in scope, and the step's location in its file.

In: values and names as they were written. Out: SI values, channels, conditions, or an error that names
the place. An error raised deeper down knows what is wrong but not where: `located` adds that, and the
name of the field.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar

from rigctl.errors import Location, RigctlError, unknown_name
from rigctl.expressions import BOOLEAN, Expression, ValueType, parse, type_of_unit
from rigctl.files.nodes import Key
from rigctl.files.yaml import Document
from rigctl.plan.statistics import DURATION, STATISTICS
from rigctl.plan.value_text import shown_variable
from rigctl.plan.values import MARK, Value, Variable, Variables, substituted
from rigctl.rig import Actuator, Channel, HeatRole, MoveRole, Rig, SetRole
from rigctl.units import Quantity, show

_Role = TypeVar("_Role", HeatRole, SetRole, MoveRole)

_VARIABLE = re.compile(r"\$([A-Za-z]\w*)")


@dataclass
class Findings:
    """What has been found so far during the expansion, in order of execution."""

    answers: dict[str, ValueType] = field(default_factory=dict)  #: measures and operators' answers
    nodes: int = 0


@dataclass(frozen=True, kw_only=True)
class Reader:
    """Resolves the fields of one step; every error names the location of the mistake.

    In the methods, `keys` are the keys in the file that lead from the step to the part in question.
    """

    rig: Rig
    document: Document
    keys: tuple[Key, ...] = ()
    variables: Variables = field(default_factory=dict)
    findings: Findings

    def where(self, *keys: Key) -> Location:
        """Return the location of a part of the step, or of the nearest enclosing part present in the file."""
        return self.document.locate((*self.keys, *keys))

    @contextmanager
    def located(self, *keys: Key) -> Iterator[None]:
        """Add the location to an error raised inside, and the name of the field in front of its message."""
        try:
            yield
        except RigctlError as error:
            name = self._written_name(keys)
            if error.where.line is None and name and f"'{name}'" not in error.what:
                error.what = f"{name}: {error.what}"
            raise error.at(self.where(*keys)) from None

    def _written_name(self, keys: tuple[Key, ...]) -> str | None:
        """Return the last of `keys` that is present in the file, since a short form omits some of them."""
        for end in range(len(keys), 0, -1):
            key = keys[end - 1]
            if isinstance(key, str) and self.where(*keys[:end]) != self.where(*keys[: end - 1]):
                return key
        return None

    @property
    def answers(self) -> Mapping[str, ValueType]:
        """The types of the measures and operators' answers of the preceding steps, by name."""
        return self.findings.answers

    def types(self) -> Mapping[str, ValueType]:
        """The types of the channels and commands, by name."""
        return self.rig.layout.types()

    def si(self, value: Value, *keys: Key, unit: str | None = None, difference: bool | None = None) -> float:
        """Return a value in SI; `unit` and `difference` apply if its kind leaves them open."""
        with self.located(*keys):
            return value.si(self.variables, unit, difference=difference)

    def optional_si(
        self, value: Value | None, *keys: Key, unit: str | None = None, difference: bool | None = None
    ) -> float | None:
        """As `si`, for an optional field."""
        return None if value is None else self.si(value, *keys, unit=unit, difference=difference)

    def quantity(self, value: Value, *keys: Key) -> Quantity:
        """Return a value with its unit."""
        with self.located(*keys):
            return value.quantity(self.variables)

    def variable(self, value: Value, *keys: Key) -> Variable:
        """Return a value with its unit, or the list to which a single ``$name`` refers."""
        found = self.variables.get(value.text.strip().removeprefix(MARK)) if MARK in value.text else None
        return found if isinstance(found, tuple) else self.quantity(value, *keys)

    def list_variable(self, text: str) -> list[Quantity]:
        """Return the values of ``$name``, which must be a list."""
        name = text.strip().removeprefix(MARK)
        if name not in self.variables:
            raise unknown_name("variable", name, self.variables)
        found = self.variables[name]
        return list(found) if isinstance(found, tuple) else [found]

    def condition(self, text: str, *keys: Key, answers: bool = False) -> Expression:
        """Return a condition on channels and commands; with `answers` also on measures and answers."""
        with self.located(*keys):
            types = {**self.types(), **self.answers} if answers else self.types()
            expression = substituted(parse(text), self.variables)
            if not answers:
                for name in sorted(expression.names & self.answers.keys()):
                    raise RigctlError(
                        "an answer or measure does not change while a step waits",
                        value=name,
                        expected="a channel or a command",
                    )
            return expression.checked(types, expected=BOOLEAN)

    def channel(self, name: str, *keys: Key) -> Channel:
        """Return a channel of the rig."""
        if name not in self.rig.channels:
            with self.located(*keys):
                raise unknown_name("channel", name, self.rig.channels)
        return self.rig.channels[name]

    def heat_role(self) -> HeatRole:
        """Return the actuator and channel of `heat`."""
        role = self._role("heat", self.rig.roles.heat)
        self.driven(role.actuator, "heat")
        return role

    def pressure_role(self) -> SetRole:
        """Return the actuator and channel of `set_pressure`."""
        return self._role("set_pressure", self.rig.roles.set_pressure)

    def move_role(self, verb: str) -> MoveRole:
        """Return the actuator of `extend` or `retract`."""
        role = self._role(verb, self.rig.roles.extend if verb == "extend" else self.rig.roles.retract)
        self.driven(role.actuator, verb)
        return role

    def driven(self, name: str, *keys: Key) -> Actuator:
        """Return an actuator that rigctl itself drives; `keys` locate its name.

        Raises
        ------
        RigctlError
            there is no actuator of this name, or it is operated by hand.
        """
        with self.located(*keys):
            if name not in self.rig.actuators:
                raise unknown_name("actuator", name, self.rig.actuators)
            if self.rig.actuators[name].by == "operator":
                raise RigctlError(
                    "this actuator is turned by hand",
                    value=name,
                    expected="a driven one",
                    hint="'set' and 'prompt' ask the operator",
                )
        return self.rig.actuators[name]

    def _role(self, verb: str, role: _Role | None) -> _Role:
        if role is None:
            raise RigctlError(
                f"the rig '{self.rig.name}' cannot {verb.replace('_', ' ')}",
                hint=f"Say under 'roles' in {self.rig.path or 'the rig file'} what '{verb}' uses",
                where=self.where(verb),
            )
        return role

    def fill_in(self, text: str, *keys: Key) -> str:
        """Return a text with every ``$name`` replaced by its value."""

        def value(match: re.Match[str]) -> str:
            name = match.group(1)
            if name not in self.variables:
                raise unknown_name("variable", name, self.variables)
            return shown_variable(self.variables[name])

        with self.located(*keys):
            return _VARIABLE.sub(value, text)

    def learn(self, name: str, unit: str, *keys: Key, difference: bool = False) -> None:
        """Make a measure or an answer available to later steps."""
        taken = self.rig.layout.columns
        with self.located(*keys):
            if name in taken or name in STATISTICS or name == DURATION:
                raise RigctlError("this name has a meaning of its own", value=name, expected="another name")
            kind = type_of_unit(unit, difference=difference)
            known = self.answers.get(name)
            if known is not None and known != kind:
                raise RigctlError(
                    "this name is used for values of two dimensions", value=name, expected="another name"
                )
            self.findings.answers[name] = kind

    def check_bounds(
        self, low: float | None, high: float | None, unit: str, verb: str, *, difference: bool = False
    ) -> None:
        """Refuse limits that no value can satisfy."""
        if low is not None and high is not None and low > high:
            with self.located(verb, "low"):
                raise RigctlError(
                    "larger than 'high'",
                    value=show(low, unit, difference=difference),
                    expected=f"at most {show(high, unit, difference=difference)}",
                )
