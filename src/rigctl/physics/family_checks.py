"""Validation of a family of models: its equations are written in symbols and evaluated near its start.

In: a family. Out: its flaws, each with the part of the declaration where it stands; none for a sound one.
Every equation must have the dimension of its result, and a finite value and slope throughout the bench's
range, since fits and diagnoses use derivatives everywhere; and every declared name must be used, since an
unused one is probably misspelt.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias, TypeVar

from rigctl.engine.symbols import Expr, Graph, Scalar, check_dimension, derivative, evaluate, variables_of
from rigctl.engine.system import after, before
from rigctl.errors import RigctlError, unknown_name
from rigctl.physics.family import (
    Definition,
    InputVariable,
    ModelFamily,
    OutputVariable,
    ParameterDeclaration,
    Slot,
    StateVariable,
)
from rigctl.physics.scope import Addition, Scope
from rigctl.physics.si_unit import si_unit
from rigctl.units import Dimension, parse_unit

T = TypeVar("T")

_Piece: TypeAlias = StateVariable | InputVariable | ParameterDeclaration | Definition | Slot | OutputVariable

#: collective names of the parts of a family
_PARTS: Mapping[type, str] = {
    StateVariable: "states",
    InputVariable: "inputs",
    ParameterDeclaration: "parameters",
    Definition: "definitions",
    Slot: "slots",
    OutputVariable: "outputs",
}

#: values of variables by name, SI
Point = Mapping[str, float]

#: distances from its start at which each state is tested, in its scale: physically possible values
_EXCURSIONS = (0.0, 0.5, -0.5)
#: test values of a switched input: before and after the command
_SWITCHES = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))


@dataclass(frozen=True)
class Flaw:
    """A fault of a family, in its `part` ("states", "slots", …) with this `name`.

    `unused`: the only fault is that no equation uses it.
    """

    part: str
    name: str
    error: RigctlError
    unused: bool = False


def check_family(family: ModelFamily) -> ModelFamily:
    """The family itself, if it is valid.

    Raises
    ------
    RigctlError
        it is not; the message lists everything that is wrong.
    """
    flaws = [f"{flaw.name}: {flaw.error}" for flaw in examine_family(family)]
    if flaws:
        raise RigctlError(f"the model family {family.name} is not sound: {'; '.join(flaws)}")
    return family


def examine_family(family: ModelFamily) -> tuple[Flaw, ...]:
    """The problems of a family; empty if there are none."""
    # In order: names, units and numbers first, as no equation can be written with a wrong unit; then the
    # equations; and only sound equations are evaluated and searched for unused names. Each stage would
    # otherwise repeat the faults of the one before.
    declared = tuple(_declarations(family))
    if declared or family.program is not None:  # an FMU has its equations
        return declared
    written = _Written(family)
    return tuple(written.flaws or (*_unused(written), *_gaps(written)))


def resting_points(family: ModelFamily) -> Iterator[Point]:
    """Points at the start of the states and slightly beside it, with every kind of switch of the inputs."""
    for excursion in _EXCURSIONS:
        states = {state.name: state.start + excursion * state.scale for state in family.states}
        for old, new in _SWITCHES:
            switched = {
                name: value
                for item in family.inputs
                for name, value in ((before(item.name), old), (after(item.name), new))
            }
            yield {**states, **{item.name: item.value for item in family.inputs}, **switched}


@dataclass(frozen=True)
class Gap:
    """A point where an equation has no finite value or, with `variable`, no finite slope in it."""

    point: Point
    variable: str | None = None

    def error(self, what: str, moving: Sequence[str], shown: Callable[[str], str] = str) -> RigctlError:
        """Message about the equation of `what`, which depends on `moving`; names as `shown`."""
        names = moving if self.variable is None else [self.variable]
        where = ", ".join(f"{shown(name)} = {self.point[name]:g}" for name in names)
        lacks = "value" if self.variable is None else f"slope in {shown(self.variable)}"
        return RigctlError(
            f"{what} has no {lacks} at {where} (SI)",
            expected="a smooth one wherever the bench may be",
            hint="Round the corner: absolute(x, width) under a root or a fraction, positive_part(x, width), "
            "spow(x, n, width) for a power",
        )


def first_gap(expr: Expr, points: Iterable[Point]) -> Gap | None:
    """The first of `points` where `expr` has no finite value, or no finite slope in one of its variables."""
    # A slope without a finite value (√x at 0, |x|^0.5, a kink of infinite steepness) stops a solver or a fit
    # long after the model was accepted, at a point that says nothing of the cause; hence the symbolic
    # derivative of every equation in every variable.
    slopes = [(variable.name, derivative(expr, variable)) for variable in variables_of(expr)]
    for point in points:
        if not math.isfinite(evaluate(expr, point)):
            return Gap(point)
        for name, slope in slopes:
            if not math.isfinite(evaluate(slope, point)):
                return Gap(point, name)
    return None


def _declarations(family: ModelFamily) -> Iterator[Flaw]:
    variables: list[_Piece] = [*family.states, *family.inputs, *family.parameters, *family.definitions]
    spaces: list[Sequence[_Piece]] = [variables, family.slots, family.outputs]
    for space in spaces:
        names = Counter(item.name for item in space)
        for item in space:
            part = _PARTS[type(item)]
            if names[item.name] > 1:
                yield Flaw(part, item.name, RigctlError("this name is used twice", value=item.name))
            try:
                _require_si(item.unit, display=part == "parameters")
            except RigctlError as error:
                yield Flaw(part, item.name, error)
    if not family.outputs:  # without states it is static: its outputs follow its inputs at once
        yield Flaw("outputs", family.name, RigctlError("the family has no outputs"))
    yield from _numbers(family)


def _require_si(unit: str, *, display: bool) -> None:
    parsed = parse_unit(unit)
    if not display and (parsed.factor != 1.0 or parsed.offset != 0.0):
        raise RigctlError("its unit is not SI", value=unit, expected=si_unit(unit))


def _numbers(family: ModelFamily) -> Iterator[Flaw]:
    for state in family.states:
        if not state.scale > 0.0:
            error = RigctlError("the scale must be greater than zero", value=f"{state.scale:g}")
            yield Flaw("states", state.name, error)
    for parameter in family.parameters:
        if not parameter.low <= parameter.value <= parameter.high:
            error = RigctlError("the value is out of bounds", value=f"{parameter.value:g}")
            yield Flaw("parameters", parameter.name, error)
    known = [parameter.name for parameter in family.parameters]
    for rig_name, meant in family.rig_names.items():
        for name in meant:
            if name not in known:
                yield Flaw("parameters", rig_name, unknown_name("parameter", name, known))


class _Written:
    """The equations of a family in symbols, with a probe at every slot."""

    def __init__(self, family: ModelFamily) -> None:
        self.family = family
        self.graph = Graph()
        self.flaws: list[Flaw] = []
        self.used_slots: set[str] = set()
        self.equations: list[tuple[str, str, Expr]] = []
        self.scope = Scope(family, self._variables(), additions=[self._probe(slot) for slot in family.slots])
        self._write()

    def _variables(self) -> dict[str, Scalar]:
        family = self.family
        units = {state.name: state.unit for state in family.states}
        units |= {item.name: item.unit for item in family.inputs}
        units |= {parameter.name: si_unit(parameter.unit) for parameter in family.parameters}
        return {name: self.graph.variable(name, _dimension(unit)) for name, unit in units.items()}

    def _probe(self, slot: Slot) -> Addition:
        """An addition without any effect, which records that some equation uses `slot`."""

        def nothing(m: Scope) -> Scalar:
            self.used_slots.add(slot.name)
            return 0.0 if slot.combine == "sum" else 1.0

        return Addition(slot.name, "what effects add", nothing)

    def _write(self) -> None:
        second = _dimension("s")
        # Definitions first: a fault inside one is reported at the definition, not at the first equation that
        # uses it.
        for definition in self.family.definitions:
            self._equation(
                "definitions",
                definition.name,
                _dimension(definition.unit),
                partial(self._defined, definition.name),
            )
        for state in self.family.states:
            rate = partial(self.scope.rate, state.name)
            self._equation("states", state.name, _dimension(state.unit) / second, rate)
        for output in self.family.outputs:
            value = partial(output.formula, self.scope)
            self._equation("outputs", output.name, _dimension(output.unit), value)
        for item in self.family.inputs:
            if item.delay is not None:
                switch = [self.graph.variable(f(item.name), _dimension(item.unit)) for f in (before, after)]
                self._equation("inputs", item.name, second, partial(item.delay, self.scope, *switch))

    def _defined(self, name: str) -> Scalar:
        return self.scope[name]

    def _equation(self, part: str, name: str, dimension: Dimension, formula: Callable[[], Scalar]) -> None:
        if self.flaws:  # an error would be reported again for every equation that uses it
            return
        try:
            expr = self.graph.expression(_called(formula))
            check_dimension(expr, dimension, f"the equation of {name}")
        except RigctlError as error:
            self.flaws.append(Flaw(part, name, error))
        else:
            self.equations.append((part, name, expr))


def _called(formula: Callable[[], T]) -> T:
    try:
        return formula()
    except RigctlError:
        raise
    except OverflowError as problem:
        raise RigctlError("a number in the equation is out of range", expected="below 1e308") from problem
    except Exception as problem:  # the equation may be a foreign Python function
        raise RigctlError(f"the equation fails: {type(problem).__name__}: {problem}") from problem


def _dimension(unit: str) -> Dimension:
    return parse_unit(unit).dimension


def _unused(written: _Written) -> Iterator[Flaw]:
    family = written.family
    if family.options:  # another variant of the equations may use it
        return
    used = {variable.name for _, _, expr in written.equations for variable in variables_of(expr)}
    used |= written.used_slots
    # inputs and fixed numbers may be used by effects alone
    declared: list[_Piece] = [p for p in family.parameters if not p.fixed]
    for item in [*declared, *family.slots]:
        if item.name not in used:
            error = RigctlError("no equation uses this", value=item.name, hint="Use it, or take it away")
            yield Flaw(_PARTS[type(item)], item.name, error, unused=True)


def _gaps(written: _Written) -> Iterator[Flaw]:
    """The first equation without a finite value or slope; others that use it lack them too."""
    family = written.family
    values = {parameter.name: parameter.value for parameter in family.parameters}
    points: Sequence[Point] = [{**values, **point} for point in resting_points(family)]
    for part, name, expr in written.equations:
        gap = first_gap(expr, points)
        if gap is not None:
            moving = [variable.name for variable in variables_of(expr) if variable.name not in values]
            yield Flaw(part, name, gap.error(name, moving))
            return
