"""`for`: the same steps at every point of a sweep.

In: one or several variables with their values. Out: a group with one iteration for each point, expanded
when the plan is made, so that the preview shows and the checks see every single step. A value that one
step refuses is reported at the value, not at the step.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Self, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.plan.context import Context
from rigctl.plan.fields import Name, ProcedurePart
from rigctl.plan.step import Block
from rigctl.plan.sweep import combine, paired, repeated, shuffled, spaced, stepped
from rigctl.plan.tree import Group, GroupKind
from rigctl.plan.value_text import shown_bindings
from rigctl.plan.values import COUNT, MARK, AnyDifference, AnyValue, Count, Seed
from rigctl.units import Quantity
from rigctl.wording import number_of


class Spaced(ProcedurePart):
    """Values from `from` to `to`, both included: in steps of `step`, or `count` values evenly spaced."""

    from_: AnyValue = Field(alias="from", description="the first value")
    to: AnyValue = Field(description="the last value, if the steps reach it exactly")
    step: AnyDifference | None = Field(
        default=None, description="difference between neighbouring values; negative for a falling range"
    )
    count: Count | None = Field(default=None, description="how many values")

    @model_validator(mode="after")
    def _step_or_count(self) -> Self:
        if (self.step is None) == (self.count is None):
            raise refusal(RigctlError("a range needs a spacing", expected="either 'step' or 'count'"))
        return self


def _known_form(written: Any) -> Any:
    if isinstance(written, list | dict | Spaced) or (isinstance(written, str) and MARK in written):
        return written
    raise refusal(
        RigctlError(
            "this is not a sweep",
            value=None if written is None else str(written),
            expected="a list, or {from, to, step}, or {from, to, count}",
        )
    )


def _form(written: Any) -> str:
    if isinstance(written, list):
        return "ValueList"
    return "Spaced" if isinstance(written, dict | Spaced) else "Variable"


#: a list, an evenly spaced range, or an argument that is a list
Sweep: TypeAlias = Annotated[
    Annotated[list[AnyValue], Tag("ValueList")]
    | Annotated[Spaced, Tag("Spaced")]
    | Annotated[
        str, Tag("Variable"), WithJsonSchema({"type": "string", "pattern": r"^\s*\$[A-Za-z]\w*\s*$"})
    ],
    Discriminator(_form),
    BeforeValidator(_known_form),
]


class ForStep(Block):
    """Execute steps once for each point. Several variables in one mapping are nested, the first one
    outermost, or paired with `zip: true`."""

    verb: ClassVar[str] = "for"
    example: ClassVar[str] = (
        "- for: {oil: [20 degC, 30 degC, 40 degC]}                  # a list\n"
        "  do: [heat: $oil]\n"
        "- for: {supply: {from: 20 bar, to: 50 bar, step: 10 bar}}  # a range; or count: 4\n"
        "  shuffle: 7\n"
        "  repeat: 2\n"
        "  do: [set_pressure: $supply]\n"
        "- for: {open: [0.5 s, 1 s], rest: [1 s, 2 s]}             # paired\n"
        "  zip: true\n"
        "  do:\n"
        "    - extend: $open\n"
        "    - wait: $rest\n"
    )
    for_: dict[Name, Sweep] = Field(alias="for", min_length=1, description="variable: its values")
    zip: bool = Field(
        default=False, description="pair the values of several variables instead of nesting them"
    )
    shuffle: Seed | None = Field(
        default=None, description="seed of a random order of all points; 0 keeps the order as written"
    )
    repeat: Count = Field(
        default=COUNT.read("1"), description="number of repetitions of each point; 0 leaves it out"
    )

    def build(self, context: Context) -> Group:
        """Return a `Group` with one iteration for each point."""
        points = self._points(context)
        seen: dict[str, int] = {}
        iterations: list[Group] = []
        for point in points:
            shown = ", ".join(f"{name}={value}" for name, value in shown_bindings(point).items())
            seen[shown] = seen.get(shown, 0) + 1
            label = shown if seen[shown] == 1 else f"{shown} ({seen[shown]})"
            inner = context.at_point(label, point)
            try:
                block = inner.block(
                    self.do, "do", label=label, kind=GroupKind.ITERATION, bindings=shown_bindings(point)
                )
            except RigctlError as error:
                raise self._at_list(context, point, error) from None
            iterations.append(block)
        names = " and ".join(self.for_)
        points_of = number_of(len(points), "point")
        return context.collect(
            iterations, label=f"for {names}: {points_of}", kind=GroupKind.FOR, cleanup=self
        )

    def _at_list(self, context: Context, point: dict[str, Quantity], error: RigctlError) -> RigctlError:
        """The error of a step that refuses a value of this sweep, located at that value; others unchanged."""
        where = error.where
        lines = context.document.text.splitlines()
        if where.file != context.where().file or not where.line or where.line > len(lines):
            return error
        refused = lines[where.line - 1][(where.column or 1) - 1 :].strip("'\"")
        for name, value in point.items():
            sweep = self.for_.get(name)
            if not re.match(rf"\${name}\b", refused) or not isinstance(sweep, list):
                continue
            for index, written in enumerate(sweep):
                if context.quantity(written, "for", name, index) == value:
                    error.where = context.where("for", name, index)
                    error.hint = error.hint or f"Line {where.line} refuses it"
        return error

    def _points(self, context: Context) -> list[dict[str, Quantity]]:
        for name in self.for_:
            if name in context.variables or name in context.sweep:
                with context.located("for", name):
                    raise RigctlError("this variable exists already", value=name, expected="another name")
        axes = {name: self._values(context, name, sweep) for name, sweep in self.for_.items()}
        with context.located("for"):
            context.allow(max(map(len, axes.values())))
            points = paired(axes) if self.zip else combine(axes, context.allow)
        times = int(context.si(self.repeat, "repeat"))
        with context.located("repeat"):
            context.allow(len(points) * times)
        points = repeated(points, times)
        seed = int(context.optional_si(self.shuffle, "shuffle") or 0)
        return shuffled(points, seed, context.path) if seed else points

    def _values(self, context: Context, name: str, sweep: Any) -> list[Quantity]:
        if isinstance(sweep, Spaced):
            return self._spaced(context, name, sweep)
        if isinstance(sweep, str):
            with context.located("for", name):
                values = context.list_variable(sweep)
        else:
            values = [context.quantity(value, "for", name, index) for index, value in enumerate(sweep)]
        with context.located("for", name):
            if not values:
                raise RigctlError("this sweep is empty", value=name, expected="at least one value")
        for index, value in enumerate(values):
            with (
                context.located("for", name)
                if isinstance(sweep, str)
                else context.located("for", name, index)
            ):
                _check_dimension(value, values)
        return values

    def _spaced(self, context: Context, name: str, sweep: Spaced) -> list[Quantity]:
        first = context.quantity(sweep.from_, "for", name, "from")
        unit = first.unit
        last = context.si(sweep.to, "for", name, "to", unit=unit.text or "1")
        stop = unit.from_si(last)
        if sweep.step is not None:
            size = context.si(sweep.step, "for", name, "step", unit=unit.text or "1") / unit.factor
            with context.located("for", name, "step"):
                return stepped(first, stop, size, context.allow)
        count = int(context.optional_si(sweep.count, "for", name, "count") or 0)
        with context.located("for", name, "count"):
            context.allow(count)
            return spaced(first, stop, count)


def _check_dimension(value: Quantity, values: Sequence[Quantity]) -> None:
    """Refuse a value whose dimension differs from that of the first value with a unit."""
    measured = next((other for other in values if other.unit.text), values[0])
    if value.unit.dimension != measured.unit.dimension:
        raise RigctlError(
            "the values of a sweep have different dimensions" if value.unit.text else "the unit is missing",
            value=str(value),
            expected=f"a value like '{measured}'",
        )
