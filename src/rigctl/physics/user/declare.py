"""The declarations in a family file: names, units and numbers, before any formula is parsed.

In: the validated file. Out: a family whose equations are placeholders (`unwritten`); faulty declarations are
left out and reported. Formulas may use any name of the file in any order, so all names and their dimensions
have to be known before the first formula is read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeVar

from rigctl.errors import RigctlError
from rigctl.files.quantity import in_dimension
from rigctl.files.reader import Reader
from rigctl.physics.family import (
    Definition,
    InputVariable,
    ModelFamily,
    OutputVariable,
    ParameterDeclaration,
    Slot,
    StateVariable,
)
from rigctl.physics.formulas import reserved_names
from rigctl.physics.interpolation import Curve
from rigctl.physics.scope import Scope
from rigctl.physics.si_unit import si_unit
from rigctl.physics.standing import Standing, range_of
from rigctl.physics.user.formula import AFTER, BEFORE, unwritten
from rigctl.physics.user.schema import (
    ConstantField,
    FamilyFile,
    FormulaField,
    InputField,
    ParameterField,
    SlotField,
    StateField,
    TableField,
)
from rigctl.units import Quantity, interval_unit, parse_unit

Field = TypeVar("Field")
Declared = TypeVar("Declared")

#: the parts of a file whose names formulas may use
_NAMED = ("states", "inputs", "parameters", "constants", "definitions", "slots", "tables")


def declare(reader: Reader, written: FamilyFile) -> ModelFamily:
    """The family without its equations; faulty declarations are omitted and reported to `reader`."""
    _refuse_names(reader, written)
    path = reader.document.path
    parameters = _each(reader, "parameters", written.parameters, _parameter)
    constants = _each(reader, "constants", written.constants, _constant)
    return ModelFamily(
        name=written.family,
        title=written.title or written.family,
        source=written.source or (path.name if path else ""),
        states=_each(reader, "states", written.states, _state),
        inputs=_each(reader, "inputs", written.inputs, _input),
        parameters=(*parameters, *constants),
        definitions=_each(reader, "definitions", written.definitions, _definition),
        slots=_each(reader, "slots", written.slots, _slot),
        outputs=_each(reader, "outputs", written.outputs, _output),
        tables={curve.name: curve for curve in _each(reader, "tables", written.tables, _table)},
        generic=written.generic_effects,
    )


def _refuse_names(reader: Reader, written: FamilyFile) -> None:
    methods = (name for name in vars(Scope) if not name.startswith("_"))  # attributes of `m` in Python terms
    taken = dict.fromkeys((*reserved_names(), *methods, BEFORE, AFTER), "has a meaning of its own")
    for part in _NAMED:
        for name in getattr(written, part):
            if name in taken:
                error = RigctlError(f"this name {taken[name]}", value=name, expected="another name")
                reader.refuse((part, name), error, of_key=True)
            taken[name] = f"is already one of the {part}"


def _each(
    reader: Reader, part: str, fields: Mapping[str, Field], make: Callable[[str, Field], Declared]
) -> tuple[Declared, ...]:
    declared = [reader.read((part, name), partial(make, name, field)) for name, field in fields.items()]
    return tuple(item for item in declared if item is not None)


def _unit(quantity: Quantity) -> str:
    return quantity.unit.text or "1"


def _difference(unit: str) -> bool:
    """Whether a temperature in `unit` is a difference: one in degC is a point on the scale."""
    return not parse_unit(unit).absolute_temperature


def _state(name: str, field: StateField) -> StateVariable:
    unit = _unit(field.start.value)
    scale = in_dimension(field.scale, unit, difference=True)
    if not scale > 0.0:
        raise RigctlError("the scale must be greater than zero", value=str(field.scale))
    std = 0.0 if field.start.std is None else in_dimension(field.start.std, unit, difference=True)
    if field.start.std is not None and not std > 0.0:
        raise RigctlError("the standard deviation must be greater than zero", value=str(field.start.std))
    return StateVariable(
        name, si_unit(unit), scale, unwritten, field.start.value.si, field.meaning, _difference(unit), std
    )


def _input(name: str, field: InputField) -> InputVariable:
    unit = _unit(field.value)
    return InputVariable(
        name,
        si_unit(unit),
        field.value.si,
        field.meaning,
        role=field.role,
        difference=_difference(unit),
        hold=field.hold,
        shown=unit,
    )


def _parameter(name: str, field: ParameterField) -> ParameterDeclaration:
    unit = _unit(field.value)
    low, high = (in_dimension(end, unit) for end in field.bounds)
    if low >= high:
        bounds = ", ".join(map(str, field.bounds))
        raise RigctlError("the bounds leave no room", value=bounds, expected="the lower one first")
    if not low <= field.value.si <= high:
        expected = " to ".join(map(str, field.bounds))
        raise RigctlError("the value is out of bounds", value=str(field.value), expected=expected)
    return ParameterDeclaration(
        name, unit, field.value.si, field.meaning, low, high, False, (False, False), *_standing(name, field)
    )


def _constant(name: str, field: ConstantField) -> ParameterDeclaration:
    standing, limits = _standing(name, field)
    return ParameterDeclaration(
        name,
        _unit(field.value),
        field.value.si,
        field.meaning,
        low=-float("inf"),
        fixed=standing != "assumed",  # a guess has derivatives: it is no number in the equations
        standing=standing,
        range=limits,
    )


def _standing(
    name: str, field: ParameterField | ConstantField
) -> tuple[Standing, tuple[float, float] | None]:
    """How well a value is known, and the range of a guess, SI."""
    unit = _unit(field.value)
    stated = None if field.range is None else tuple(in_dimension(end, unit) for end in field.range)
    standing = field.standing or ""
    low_high = None if stated is None else (stated[0], stated[1])
    return standing, range_of(name, field.value.si, unit, standing, low_high)


def _definition(name: str, field: FormulaField) -> Definition:
    return Definition(name, si_unit(field.unit), unwritten, field.meaning, _difference(field.unit))


def _output(name: str, field: FormulaField) -> OutputVariable:
    return OutputVariable(name, si_unit(field.unit), unwritten, field.meaning, shown=field.unit)


def _table(name: str, field: TableField) -> Curve:
    over, unit = parse_unit(field.over), parse_unit(field.unit)
    return Curve(
        name,
        field.over,
        field.unit,
        tuple(over.to_si(x) for x, _ in field.points),
        tuple(unit.to_si(y) for _, y in field.points),
        field.kind,
        field.meaning,
    )


def _slot(name: str, field: SlotField) -> Slot:
    if field.combine == "product" and not parse_unit(field.unit).dimension.dimensionless:
        raise RigctlError("a factor has no unit", value=field.unit, expected="'combine: sum', or no unit")
    shown = interval_unit(field.unit)
    return Slot(name, si_unit(field.unit), field.meaning, field.combine, field.kind, shown=shown)
