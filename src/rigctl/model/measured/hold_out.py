"""Records that a fit must not see, selected by a condition: ``oil == 60 degC``, ``record > 20``.

In: measurements, and an expression as a user writes it. Out: indices of records. A condition may name what
differs between records, by the data's name or by a usual one, the levels of actuators, and ``record``; its
quantities are converted by the units in which these are shown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from rigctl.dataset.run import Run
from rigctl.errors import RigctlError, unknown_name
from rigctl.expressions import Expression, ValueType, parse, type_of_unit
from rigctl.expressions.nodes import Comparison, Constant, Name, walk
from rigctl.model.measured.conditions import START, commanded_levels
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model
from rigctl.units import show

#: usual names of operating variables, by dimension, whatever the data call them
_CALLED = {
    "K": ("oil", "temperature", "oil_temperature"),
    "Pa": ("supply", "pressure", "supply_pressure", "pressure_setpoint"),
}
#: operating points closer than this to the given one are meant: temperatures in K, others relative
_SAME_TEMPERATURE = 1.0
_SAME_SHARE = 0.01


def chosen(measurements: Measurements, text: str | None, units: Mapping[str, str]) -> tuple[int, ...]:
    """Indices of the records for which the condition is true; all of them without one.

    Raises
    ------
    RigctlError
        it is not a condition, names something unknown, or selects no record.
    """
    if text is None or not text.strip():
        return tuple(range(len(measurements.records)))
    return _chosen(measurements, text, units, "no record is chosen by this")


def require_names(text: str, model: Model, runs: Sequence[Run]) -> None:
    """Refuse a condition with a name that no run can have, by the names of columns alone: no sample is read.

    A name that passes may still be none of a record's condition, which `check_condition` knows. The names of
    a model without a rig are those of the runs' rigs, and pass, as do all where a damaged run may have them.

    Raises
    ------
    RigctlError
        a name is in none of the runs, or the text is not an expression.
    """
    if model.rig is None:
        return
    known = {"record", *model.rig.actuators, *(item.name for item in model.family.inputs)}
    known.update(called for names in _CALLED.values() for called in names)
    missing = parse(text).names - known
    for run in runs:
        if not missing:
            return
        try:
            layout, columns = run.layout, run.records.columns
        except RigctlError:
            return
        starts = (START + name for name in layout.channels)
        known.update(columns, layout.commands, layout.channels, starts)
        missing -= known
    if missing:
        raise unknown_name("name", min(missing), known)


def check_condition(measurements: Measurements, text: str, units: Mapping[str, str]) -> None:
    """Check that a text is a condition on the records' variables, whether or not it selects one.

    Raises
    ------
    RigctlError
        it is not, or names something unknown.
    """
    _checked(text, _types(measurements, units))


def held_out(
    measurements: Measurements, text: str | None, units: Mapping[str, str], only: str | None = None
) -> tuple[int, ...]:
    """Indices of the records for which the condition is true; none without one.

    Parameters
    ----------
    text: an expression of the operating variables and of ``record``, its number from 1.
    units: of the operating variables.
    only: the condition that selected the records of `measurements` before.

    Raises
    ------
    RigctlError
        it is not a condition, names something unknown, or selects no record or all of them.
    """
    if text is None or not text.strip():
        return ()
    among = "" if only is None else f" of those that '{only}' leaves"
    selected = _chosen(measurements, text, units, f"no record is held out by this{among}")
    if len(selected) == len(measurements.records):
        raise RigctlError(f"this holds every record out{among}: nothing is left to fit on", value=text)
    return selected


def _chosen(measurements: Measurements, text: str, units: Mapping[str, str], none: str) -> tuple[int, ...]:
    named = [
        _named(measurements, record, units) | {"record": k + 1.0}
        for k, record in enumerate(measurements.records)
    ]
    types = _types(measurements, units)
    checked = _checked(text, types)
    # `oil == 60 degC` means the set point, of which a record has 60.3: what is compared by == or != is set to
    # that if it is close
    exact = list(_equalities(checked, types))
    selected = tuple(k for k, values in enumerate(named) if checked.evaluate(_snapped(values, exact, types)))
    if not selected:
        raise RigctlError(none, value=text, expected=_points(measurements, named, units) or None)
    return selected


def _checked(text: str, types: Mapping[str, ValueType]) -> Expression:
    expression = parse(text)
    if not expression.check(types).boolean:
        raise RigctlError("records are chosen by a condition", value=text, expected="e.g. 'oil == 60 degC'")
    return expression.checked(types)


def _types(measurements: Measurements, units: Mapping[str, str]) -> dict[str, ValueType]:
    types: dict[str, ValueType] = {"record": type_of_unit("1")}
    for record in measurements.records:
        for name in record.condition:
            types.setdefault(name, type_of_unit(units[name]))
        for name in _named(measurements, record, units):
            if name not in types and measurements.rig is not None and name in measurements.rig.actuators:
                types[name] = type_of_unit(measurements.rig.actuators[name].display_unit)
            elif name not in types:
                dimension = {called: unit for unit, names in _CALLED.items() for called in names}
                types[name] = type_of_unit(dimension[name])
    return types


def _named(measurements: Measurements, record: MeasuredRecord, units: Mapping[str, str]) -> dict[str, float]:
    """The condition and the levels of the actuators, the former also under the usual names of its dimensions
    if no other variable has them."""
    values = {**commanded_levels(measurements, record), **record.condition}
    for dimension, names in _CALLED.items():
        same = [
            name
            for name in record.condition
            if type_of_unit(units[name]).dimension == type_of_unit(dimension).dimension
        ]
        if len(same) == 1:
            for name in names:
                values.setdefault(name, record.condition[same[0]])
    return values


def _equalities(expression: Expression, types: Mapping[str, ValueType]) -> Iterator[tuple[str, float]]:
    """(name, value) pairs compared by == or !=."""
    assert expression.resolved is not None  # noqa: S101 - it has been checked
    for node in walk(expression.resolved):
        if isinstance(node, Comparison):
            pairs = zip(node.operands, node.operators, node.operands[1:], strict=False)
            for left, operator, right in pairs:
                if operator in ("==", "!="):
                    for one, other in ((left, right), (right, left)):
                        if isinstance(one, Name) and isinstance(other, Constant) and one.name in types:
                            yield one.name, other.value


def _snapped(
    values: Mapping[str, float], exact: list[tuple[str, float]], types: Mapping[str, ValueType]
) -> dict[str, float]:
    """Values sufficiently close to the given ones, set to these."""
    result = dict(values)
    for name, wanted in exact:
        if name in result:
            tolerance = _SAME_TEMPERATURE if types[name].is_temperature else _SAME_SHARE * abs(wanted)
            if math.isclose(result[name], wanted, rel_tol=0.0, abs_tol=tolerance):
                result[name] = wanted
    return result


def _points(measurements: Measurements, named: list[dict[str, float]], units: Mapping[str, str]) -> str:
    ends = []
    for name in [*measurements.variables, "record"]:
        if all(name in values for values in named):
            low, high = min(v[name] for v in named), max(v[name] for v in named)
            unit = units.get(name, "1")
            ends.append(f"{name} from {show(low, unit, digits=4)} to {show(high, unit, digits=4)}")
    return ", ".join(ends)
