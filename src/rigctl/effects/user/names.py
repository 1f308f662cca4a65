"""The names that a term may use, and the type of each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from rigctl.effects.declaration import EffectParameter
from rigctl.errors import RigctlError
from rigctl.expressions.types import ValueType, type_of_unit
from rigctl.files.yaml import read_document
from rigctl.physics.family import ModelFamily, Slot
from rigctl.physics.formulas import reserved_names, variable_types


def term_types(
    family: ModelFamily, slot: Slot, parameters: Iterable[EffectParameter]
) -> Mapping[str, ValueType]:
    """The types of all names that a term at `slot` may use.

    The slot's own temperatures are differences.
    """
    types = dict(variable_types(family))
    types |= {name: type_of_unit(unit, difference=True) for name, unit in slot.local}
    return types | {p.name: type_of_unit(p.unit, difference=p.difference) for p in parameters}


def slot_type(slot: Slot) -> ValueType:
    """The type of every term at `slot`; what is added to a temperature is a difference."""
    return type_of_unit(slot.unit, difference=True)


def taken_names(family: ModelFamily) -> frozenset[str]:
    """The names that a parameter of an effect may not have, because they already mean something."""
    local = {name for slot in family.slots for name, _ in slot.local}
    return frozenset({*variable_types(family), *local}) | reserved_names()


def name_in_file(path: Path) -> str | None:
    """The name of the effect declared in a file; None if it is not an effect file. Nothing else is read."""
    try:
        data = read_document(path).data
    except RigctlError:
        return None
    name = data.get("effect") if isinstance(data, Mapping) else None
    return name if isinstance(name, str) else None


def names_beside(path: Path | None) -> frozenset[str]:
    """The names of the effects whose files are in the folder of `path`, except its own."""
    if path is None or not path.parent.is_dir():
        return frozenset()
    others = [other for other in path.parent.glob("*.y*ml") if other.name != path.name]
    return frozenset(name for name in map(name_in_file, sorted(others)) if name is not None)
