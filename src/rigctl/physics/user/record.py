"""The standard record of a family file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from rigctl.errors import unknown_name
from rigctl.files.quantity import in_dimension
from rigctl.files.reader import Reader
from rigctl.physics.family import InputVariable, ModelFamily, StateVariable
from rigctl.physics.standard_record import StandardRecord, grid
from rigctl.physics.user.schema import RecordField
from rigctl.units import Quantity

_PART = "standard_record"


def read_record(reader: Reader, written: RecordField, family: ModelFamily) -> StandardRecord:
    """The commands and their times, in SI; faults are reported to `reader`."""
    inputs = {item.name: item for item in family.inputs}
    states = {state.name: state for state in family.states}
    switches = tuple(
        (switch.at, _values(reader, (_PART, "switches", index, "set"), "input", switch.set, inputs))
        for index, switch in enumerate(written.switches)
    )
    if switches[0][0] > 0.0:
        switches = ((0.0, {}), *switches)
    return StandardRecord(
        description=written.description or f"the standard record of {family.name}",
        times=grid(written.duration, 1.0 / written.rate),
        switches=switches,
        initial=_values(reader, (_PART, "initial"), "state", written.initial, states),
    )


def _values(
    reader: Reader,
    keys: tuple[str | int, ...],
    kind: str,
    written: Mapping[str, Quantity],
    declared: Mapping[str, InputVariable] | Mapping[str, StateVariable],
) -> dict[str, float]:
    values: dict[str, float] = {}
    for name, quantity in written.items():
        if name not in declared:
            reader.refuse((*keys, name), unknown_name(kind, name, declared), of_key=True)
            continue
        value = reader.read((*keys, name), partial(in_dimension, quantity, declared[name].unit))
        values |= {} if value is None else {name: value}
    return values
