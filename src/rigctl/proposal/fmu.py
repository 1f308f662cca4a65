"""From what an FMU says of itself, and the columns of a log, to the text of the files; it is not executed.

In: the FMU's description and a `Table`, or none. Out: a `Proposal`. Columns are paired with the FMU's inputs
and outputs by name, and units, bounds and starting values come from the description; what that does not say
is drafted so that it is seen, and listed in the notes, since an FMU cannot be read to find it out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from rigctl.command_line import quoted
from rigctl.dataset.importing.cells.headings import identifier
from rigctl.errors import Location, RigctlError, nearest_name, require_known
from rigctl.fmu.description import Description, Variable
from rigctl.physics.formulas import reserved_names
from rigctl.proposal.columns import Column, Role, Table
from rigctl.proposal.draft import Draft, Formula, Input, Parameter, amount
from rigctl.proposal.from_columns import begin
from rigctl.proposal.propose import Proposal, file_texts, path_of
from rigctl.proposal.roles import StatedRoles, with_roles
from rigctl.proposal.write import amount_of, part, plain_or_quoted
from rigctl.units import is_angle, is_speed_of_rotation, parse_unit

#: bounds that the FMU does not give lie this factor to either side of the value
_ROOM = 1000.0
#: a bound of this size stands for none
_ENDLESS = 1e30
#: more parameters than a fit can be expected to determine: the user says which are free
_MOST_FREE = 10
#: digits of the FMU's own values
_DIGITS = 12
#: names in a list that a person reads
_MOST_NAMED = 8


@dataclass(frozen=True)
class Pairs:
    """Which columns of a log are inputs and outputs of an FMU.

    Attributes
    ----------
    variables: the FMU's name by that of the column on the bench.
    near: the columns of another, but a similar name.
    conditions: the columns that it does not have, and with which its parameters may change.
    """

    variables: Mapping[str, str]
    near: frozenset[str] = frozenset()
    conditions: frozenset[str] = frozenset()

    def column_of(self, variable: str, table: Table) -> Column | None:
        """The column that is a variable."""
        return next((c for c in table.columns if self.variables.get(c.name) == variable), None)


#: what the user has to know or to fill in, by its kind
_NOTES: Final = {
    "no unit": "{fmu} gives no unit for {names}: drafted as plain numbers. Write the units that it means "
    "in {family}",
    "SI": "{fmu} gives no unit for {names}: taken for SI, of the quantities in the log",
    "log without unit": "The log states no unit for {names}: taken for those of {fmu}; --unit says otherwise",
    "unknown unit": "{fmu} has units that are not known, and does not define them: {names}; left out",
    "no number": "{fmu} gives no number for {names}: left out. What a fit is to change needs one in {family}",
    "no bounds": "{fmu} does not bound {names} on both sides: drafted as a thousandth and a thousand times "
    "the value. Write what is possible in {family}",
    "zero": "{fmu} gives 0 for {names}, and not both bounds: fixed until you write bounds in {family}, and "
    "'fit: true' in the model file",
    "scale": "{fmu} does not say which change of {names} matters: write 'scale' in {family}",
    "settings": "{fmu} has settings of its solver, left out: {names}. What a fit is to change, or what is to "
    "have another value, needs a line in {family}",
    "no input column": "No column is the input {names}: constant, at the value in {family}",
    "no output column": "No column is the output {names}: not compared",
    "none free": "{fmu} has {names} parameters: none is free until you write 'fit: true' in the model file "
    "for those few that are unknown",
}


@dataclass
class _Notes:
    """What is to be said of a draft: by kind, the names that it concerns."""

    fmu: str
    family: str
    of: dict[str, list[str]] = field(default_factory=dict)

    def add(self, kind: str, name: str) -> None:
        self.of.setdefault(kind, []).append(name)

    def lines(self) -> Iterator[str]:
        """One message for each kind."""
        for kind in (kind for kind in _NOTES if kind in self.of):
            names = self.of[kind]
            shown = ", ".join(names[:_MOST_NAMED]) + ", …" * (len(names) > _MOST_NAMED)
            yield _NOTES[kind].format(fmu=self.fmu, family=self.family, names=shown)


def variables_of(about: Description) -> dict[str, Role]:
    """The FMU's inputs and outputs.

    Raises
    ------
    RigctlError
        it has no output.
    """
    roles: dict[str, Role] = dict.fromkeys(about.named("input"), "input")
    roles |= dict.fromkeys(about.named("output"), "output")
    if "output" not in roles.values():
        raise RigctlError("the FMU has no output that is a real number", where=Location(about.path))
    return roles


def pair(
    table: Table,
    about: Description,
    stated: Mapping[str, str],
    leave: Iterable[str] = (),
    conditions: Iterable[str] = (),
) -> Pairs:
    """The columns that are inputs and outputs of an FMU: as stated, of the same name, or of the nearest one.

    Parameters
    ----------
    stated: the FMU's name by that of the column.
    leave: columns that are none.
    conditions: columns that are none, and with which the FMU's parameters may change.

    Raises
    ------
    RigctlError
        a stated name is unknown, a variable is stated twice, a condition is said to be something else, or no
        column is an output.
    """
    roles = variables_of(about)
    require_known(f"--variable: input or output of {about.path.name}", stated.values(), roles)
    found = {table.column(theirs).name: variable for theirs, variable in stated.items()}
    if len(set(found.values())) < len(stated):
        raise RigctlError("--variable: two columns are one variable", value=", ".join(stated.values()))
    conditions = list(conditions)
    names = [name for column in table.columns for name in dict.fromkeys((column.name, column.theirs))]
    require_known("--condition: column", conditions, names)
    apart = {table.column(theirs).name for theirs in conditions}
    omitted = {table.column(theirs).name for theirs in leave}
    if twice := apart & (omitted | found.keys()):
        raise RigctlError("--condition: the column is something else, too", value=min(twice))
    omitted |= apart

    def free() -> tuple[list[Column], dict[str, str]]:
        """The columns and the variables that are left, the latter by their names on a bench."""
        columns = [c for c in table.columns if c.name not in found and c.name not in omitted]
        left = {identifier(name): name for name in reversed(roles) if name not in found.values()}
        return columns, left

    columns, left = free()
    found |= {c.name: left[c.name] for c in columns if c.name in left}
    columns, left = free()
    names = [c.name for c in columns]
    near = {}
    for c in columns:
        name = nearest_name(c.name, left)
        if name is not None and nearest_name(name, names) == c.name and _may_be(c, about, left[name]):
            near[c.name] = left[name]
    found |= near
    if not any(roles[variable] == "output" for variable in found.values()):
        outputs = about.named("output")
        raise RigctlError(
            f"no column has the name of an output of {about.path.name}",
            value=", ".join(c.theirs for c in table.columns),
            expected=", ".join(outputs),
            hint=f"--variable {quoted(f'COLUMN={outputs[0]}')} says which column is {outputs[0]}",
        )
    return Pairs(found, frozenset(near), frozenset(apart))


def _may_be(column: Column, about: Description, variable: str) -> bool:
    unit = about.unit(variable)
    return unit is None or not column.known or unit.dimension == column.display.dimension


def units_from(table: Table, about: Description, pairs: Pairs) -> dict[str, str]:
    """The FMU's units of the columns for which the log states none, by their headings."""
    units = dict[str, str]()
    for column in table.columns:
        variable = pairs.variables.get(column.name)
        unit = about.unit(variable) if variable is not None and not column.known else None
        if unit is not None:
            units[column.theirs] = unit.text
    return units


def with_fmu_roles(table: Table, about: Description, pairs: Pairs, stated: StatedRoles) -> Table:
    """The log's table with the roles that the FMU gives its columns.

    Raises
    ------
    RigctlError
        the log has no time, a column is of another dimension than its variable, or `stated` contradicts.
    """
    if table.times is None:
        raise RigctlError(
            "the log has no time, which an FMU needs",
            where=Location(table.path) if table.path is not None else None,
            hint="--unit 'COLUMN=s' says which column is it, or --unit 'COLUMN=50 ms' which numbers the rows",
        )
    roles, reasons = variables_of(about), dict[str, str]()
    by_role: dict[Role, list[str]] = {"input": [], "output": [], "left out": []}
    left = {table.column(name).name for name in stated.omitted}
    for column in table.columns:
        variable = pairs.variables.get(column.name)
        if column.name in pairs.conditions:
            by_role["input"].append(column.name)
            reasons[column.name] = f"condition, with which parameters of {about.path.name} may change"
            continue
        if variable is None:
            by_role["left out"].append(column.name)
            if column.name not in left:
                reasons[column.name] = f"{about.path.name} has no input or output of a similar name"
            continue
        by_role[roles[variable]].append(column.name)
        how = ", the nearest name" if column.name in pairs.near else ""
        reasons[column.name] = f"{variable} of {about.path.name}{how}"
        _require_dimension(column, about, variable)
    by_fmu = replace(
        stated,
        inputs=by_role["input"],
        outputs=by_role["output"],
        omitted=by_role["left out"],
        reasons=reasons,
    )
    return with_roles(table, by_fmu)


def _require_dimension(column: Column, about: Description, variable: str) -> None:
    if not _may_be(column, about, variable):
        unit = about.variable(variable).unit
        raise RigctlError(
            f"the column {column.theirs} has another dimension than {variable} of {about.path.name}",
            value=column.unit,
            expected=f"as {unit}",
            hint=f"--unit {quoted(f'{column.theirs}={unit}')} if its heading is wrong; "
            f"--leave {quoted(column.theirs)} leaves it out",
        )


def table_of_fmu(about: Description) -> tuple[Table, Pairs]:
    """The columns of an FMU without a log: its inputs, commanded, and its outputs."""
    names = dict[str, str]()
    columns = list[Column]()
    for variable, role in variables_of(about).items():
        unit = _unit(about, variable, None, lambda kind, name: None)
        if unit is None:
            continue
        name = _free_name(variable, names)
        names[name] = variable
        columns.append(Column(name, name, unit, np.empty(0), role=role, stepped=True, origin="commanded"))
    return Table(None, tuple(columns), None, np.empty(0, dtype=np.int64)), Pairs(names)


def propose_fmu(
    name: str, about: Description, fmu: str, table: Table, pairs: Pairs, own: Iterable[str] = ()
) -> Proposal:
    """The files for an FMU and a table of its inputs and outputs.

    Parameters
    ----------
    fmu: its path as the family file names it.
    own: columns that have their unit from the FMU.
    """
    notes = _Notes(about.path.name, path_of("family", name))
    for theirs in own:
        notes.add("log without unit", theirs)
    draft, lines = _drafted(name, about, fmu, table, pairs, notes)
    files = file_texts(name, table, draft, "\n".join(lines) + "\n")
    return Proposal(name, None, table, draft, None, files, fmu=fmu, notes=tuple(notes.lines()))


def _drafted(
    name: str, about: Description, fmu: str, table: Table, pairs: Pairs, notes: _Notes
) -> tuple[Draft, list[str]]:
    """The draft, and the lines of the family file."""
    names, inputs, outputs = dict[str, str](), dict[str, dict[str, str]](), dict[str, dict[str, str]]()
    for variable, role in variables_of(about).items():
        column = pairs.column_of(variable, table)
        unit = _unit(about, variable, column, notes.add)
        if unit is None:
            continue
        ours = column.name if column is not None else _free_name(variable, {*names, *pairs.variables})
        names[ours] = variable
        one = about.variable(variable)
        if column is None:
            notes.add(f"no {role} column", variable)
        if role == "input":
            inputs[ours] = _input(one, ours, unit, column)
        else:
            outputs[ours] = _output(one, ours, unit, column, notes)
    conditions = {
        column.name: {"value": _typical(column)}
        for column in table.columns
        if column.name in pairs.conditions
    }
    parameters = _parameters(about, {**names, **dict.fromkeys(conditions, "")}, notes)
    draft = Draft(
        title=f"The model {about.path.name}",
        equations=(),
        inputs={
            ours: Input(fields["value"], fields.get("meaning", ""))
            for ours, fields in (inputs | conditions).items()
        },
        outputs={ours: Formula(fields["unit"], ours) for ours, fields in outputs.items()},
        parameters={ours: one for ours, (_, one) in parameters.items()},
    )
    return draft, [*_family(name, about, fmu, inputs, conditions, parameters, outputs)]


def _typical(column: Column) -> str:
    """A value to count from: the median of the column."""
    present = column.values[np.isfinite(column.values)]
    return amount(float(np.median(present)) if present.size else column.display.offset, column.unit)


def _input(one: Variable, ours: str, unit: str, column: Column | None) -> dict[str, str]:
    straight = column is not None and column.origin == "commanded" and not column.stepped
    return {
        "value": _amount(one.start or 0.0, unit),
        "variable": _other_name(one.name, ours),
        "hold": "linear" if straight else "",
        "meaning": plain_or_quoted(one.meaning),
    }


def _output(one: Variable, ours: str, unit: str, column: Column | None, notes: _Notes) -> dict[str, str]:
    if column is not None and column.values.size:
        scale = begin(column)[1]
    else:
        difference = "K" if parse_unit(unit).absolute_temperature else unit
        scale = _amount(0.01 * abs(one.nominal or 1.0), difference)
        if not one.nominal:
            notes.add("scale", one.name)
    return {
        "unit": plain_or_quoted(unit),
        "variable": _other_name(one.name, ours),
        "scale": scale,
        "meaning": plain_or_quoted(one.meaning),
    }


def _parameters(
    about: Description, taken: Mapping[str, str], notes: _Notes
) -> dict[str, tuple[str, Parameter]]:
    """The FMU's name and the draft of each parameter; those that set a start are none."""
    starts = {about.start_of(name) for name in about.named("output")}
    found = dict[str, tuple[str, Parameter]]()
    wanted = [about.variable(name) for name in about.named("parameter") if name not in starts]
    for one in (one for one in wanted if one.settable):
        if one.name.rpartition(".")[2].startswith("_"):  # as tools name what is none of the model
            notes.add("settings", one.name)
            continue
        unit = _unit(about, one.name, None, notes.add)
        if unit is None:
            continue
        if one.start is None or not math.isfinite(one.start):
            notes.add("no number", one.name)
            continue
        ours = _free_name(one.name, {*taken, *found})
        low, high, kind = _bounds(one, one.start)
        if kind:
            notes.add(kind, one.name)
        meaning = one.meaning or one.name
        found[ours] = one.name, Parameter(one.start, unit, low, high, meaning, kind != "zero", _DIGITS)
    if len(found) > _MOST_FREE:
        notes.add("none free", str(len(found)))
        return {ours: (theirs, replace(one, fit=False)) for ours, (theirs, one) in found.items()}
    return found


def _bounds(one: Variable, value: float) -> tuple[float, float, str]:
    """The FMU's bounds, or assumed ones where it gives none; and what is to be said of them."""
    low, high = (end if end is not None and abs(end) < _ENDLESS else None for end in (one.low, one.high))
    low = low if low is not None and low <= value else None
    high = high if high is not None and high >= value and high != low else None
    if low is not None and high is not None:
        return low, high, ""
    if value == 0.0:
        return (-1.0 if low is None else low), (1.0 if high is None else high), "zero"
    ends = sorted((value / _ROOM, value * _ROOM))
    return (ends[0] if low is None else low), (ends[1] if high is None else high), "no bounds"


def _unit(
    about: Description, variable: str, column: Column | None, note: Callable[[str, str], None]
) -> str | None:
    """The unit in the family file; None if the FMU's is neither known nor defined."""
    one, known = about.variable(variable), about.unit(variable)
    if known is not None:
        return known.text
    if one.unit:
        if one.unit in about.bases:
            return about.bases[one.unit]
        note("unknown unit", f"{variable} ({one.unit})")
        return None
    if column is None or not column.known:
        note("no unit", variable)
        return "1"
    note("SI", variable)
    return _in_si(column)


def _in_si(column: Column) -> str:
    """The unit in SI of a column's quantity."""
    unit = column.unit
    if column.display.factor == 1.0 and column.display.offset == 0.0:
        return unit
    if is_speed_of_rotation(unit):
        return "rad/s"
    if is_angle(unit):
        return "rad"
    return str(column.display.dimension).replace(" ", "*")


def _free_name(variable: str, taken: Iterable[str]) -> str:
    """A name that formulas can use, which none of `taken` is."""
    name = identifier(variable)[:60]
    name = name if name[:1].isalpha() else f"v_{name}".strip("_")
    name = f"{name}_value" if name in reserved_names() or name in ("time", "record") else name
    plain, number = name, 2
    while name in set(taken):
        name, number = f"{plain}_{number}", number + 1
    return name


def _other_name(variable: str, ours: str) -> str:
    return "" if variable == ours else plain_or_quoted(variable)


def _amount(value: float, unit: str) -> str:
    return amount_of(value, unit, _DIGITS)


def _family(
    name: str,
    about: Description,
    fmu: str,
    inputs: Mapping[str, Mapping[str, str]],
    conditions: Mapping[str, Mapping[str, str]],
    parameters: Mapping[str, tuple[str, Parameter]],
    outputs: Mapping[str, Mapping[str, str]],
) -> Iterator[str]:
    yield f"# {about.path.name} as a model, to be edited: drafted from its description. An FMU is a program:"
    yield f"# it runs only when it is named on the command line, with '--family {fmu}'."
    yield ""
    yield f"family: {name}"
    yield f"fmu: {plain_or_quoted(fmu)}"
    yield from part(
        "inputs",
        "What is commanded, or measured and given from outside: a channel or an actuator of the same name.",
        inputs,
    )
    yield from part(
        "conditions",
        "What is measured and no variable of the FMU, and with which its parameters may change.",
        conditions,
    )
    yield from part(
        "parameters",
        "What a fit may change, and within which bounds; all others keep the FMU's own values.",
        {
            ours: {
                "value": _amount(one.value, one.unit),
                "variable": _other_name(theirs, ours),
                "bounds": f"[{_amount(one.low, one.unit)}, {_amount(one.high, one.unit)}]",
                "meaning": plain_or_quoted(one.meaning) if one.meaning != theirs else "",
            }
            for ours, (theirs, one) in parameters.items()
        },
    )
    yield from part(
        "outputs", "What channels of these names read; `scale` is a change that matters.", outputs
    )
