"""The formulas of a family file, parsed once all names are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from rigctl.engine.symbols import Scalar
from rigctl.expressions.types import ValueType, type_of_unit
from rigctl.files.reader import Reader
from rigctl.physics.family import InputVariable, ModelFamily
from rigctl.physics.formulas import read_formula, variable_types
from rigctl.physics.user.formula import AFTER, BEFORE, TextFormula, unwritten
from rigctl.physics.user.schema import FamilyFile, FormulaField
from rigctl.units import parse_unit

_SECOND = parse_unit("s").dimension


def write_equations(reader: Reader, written: FamilyFile, family: ModelFamily) -> ModelFamily:
    """`family` with its equations; faults in them are reported to `reader`."""
    writer = _Writer(reader, family)
    return replace(
        family,
        states=tuple(
            replace(state, rate=writer.rate(state.name, state.unit, written.states[state.name].rate))
            for state in family.states
        ),
        inputs=tuple(writer.delayed(item, written.inputs[item.name].delay) for item in family.inputs),
        definitions=tuple(
            replace(item, formula=writer.value("definitions", item.name, written.definitions[item.name]))
            for item in family.definitions
        ),
        outputs=tuple(
            replace(item, formula=writer.value("outputs", item.name, written.outputs[item.name]))
            for item in family.outputs
        ),
    )


class _Writer:
    """Parses formulas with the names of one family."""

    def __init__(self, reader: Reader, family: ModelFamily) -> None:
        self.reader = reader
        # A formula may name every variable, and every slot: there, the slot's name stands for the sum or the
        # product of the effects, so that the author decides where in an equation they act.
        self.types = dict(variable_types(family))
        self.types |= {slot.name: type_of_unit(slot.unit, difference=True) for slot in family.slots}
        self.sums = frozenset(slot.name for slot in family.slots if slot.combine == "sum")
        self.factors = frozenset(slot.name for slot in family.slots if slot.combine == "product")

    def rate(self, name: str, unit: str, text: str) -> Callable[..., Scalar]:
        wanted = ValueType(parse_unit(unit).dimension / _SECOND)
        why = f"the unit of {name} per second"
        return self.formula(text, wanted, ("states", name, "rate"), f"the rate of {name}", why)

    def value(self, part: str, name: str, field: FormulaField) -> Callable[..., Scalar]:
        point = parse_unit(field.unit).absolute_temperature
        wanted = type_of_unit(field.unit, difference=not point)
        return self.formula(
            field.formula, wanted, (part, name, "formula"), f"the formula of {name}", "its unit"
        )

    def delayed(self, item: InputVariable, text: str | None) -> InputVariable:
        if text is None:
            return item
        value_type = type_of_unit(item.unit, difference=item.difference)
        keys = ("inputs", item.name, "delay")
        types = {BEFORE: value_type, AFTER: value_type}
        delay = self.formula(text, ValueType(_SECOND), keys, f"the delay of {item.name}", "a time", types)
        return replace(item, delay=delay)

    def formula(
        self,
        text: str,
        wanted: ValueType,
        keys: tuple[str, ...],
        what: str,
        why: str,
        local: dict[str, ValueType] | None = None,
    ) -> Callable[..., Scalar]:
        location = self.reader.document.locate(keys)
        types = self.types | (local or {})
        read = partial(read_formula, text, types, wanted, what=what, why=why, where=location)
        tree = self.reader.read(keys, read)
        return unwritten if tree is None else TextFormula(tree, self.sums, self.factors)
