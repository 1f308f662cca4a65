"""The columns of a file of measurements, with a name, a unit and SI values each.

In: a file of any kind that is imported, and what the user says of its units. Out: a `Table`, in SI, with the
options that an import of this file needs. It is read by the importer's own functions, so that what is
drafted from a log is what an import of it will contain.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.dataset.importing.formats.table import Heading, Source
from rigctl.dataset.importing.options import Options, TimePolicy
from rigctl.errors import RigctlError, require_known, unknown_name
from rigctl.physics.formulas import reserved_names
from rigctl.units import Unit, find_unit, interval_unit, parse_unit

Floats = NDArray[np.float64]
Role = Literal["input", "output", "left out"]
#: a command is known exactly, a measured input has noise
Origin = Literal["commanded", "measured", "unclear"]

#: rows that are examined: enough to classify a column
_MOST_ROWS: Final = 200_000
#: rows from which an even rise is the time, or a number
_MANY_STEPS: Final = 30
_RECORDS: Final = ("record", "run", "experiment", "trial", "segment")


@dataclass(frozen=True)
class Column:
    """One column of a file.

    Attributes
    ----------
    name: on the bench; `theirs` is its heading without the unit.
    unit: for display.
    values: (n) SI, NaN where one is missing; empty without a file.
    stated: whether the heading has the unit in brackets, as an import reads it.
    known: whether it has a unit at all, in the file or from the user; otherwise it is drafted as a number.
    headed: what the heading has for a unit; `unread` if that is none.
    role, reason: its role for the bench, and the reason for that.
    stepped: whether it holds between samples: constant except for single steps, like a command.
    origin: of an input, whether it is commanded or measured.
    """

    name: str
    theirs: str
    unit: str
    values: Floats = field(repr=False)
    stated: bool = True
    known: bool = True
    unread: str = ""
    headed: str = ""
    role: Role = "output"
    reason: str = ""
    stepped: bool = False
    origin: Origin = "measured"

    @property
    def display(self) -> Unit:
        """The unit, parsed."""
        return parse_unit(self.unit)

    @property
    def shown(self) -> Floats:
        """The values in the unit."""
        return (self.values - self.display.offset) / self.display.factor

    @property
    def key(self) -> str:
        """The heading for which an import is told the unit."""
        return _key(self.theirs, self.headed)

    @property
    def interval(self) -> str:
        """The unit of a difference of its values."""
        return interval_unit(self.unit)


@dataclass(frozen=True)
class Table:
    """A file's columns, and when its rows were taken.

    Attributes
    ----------
    times: (n) seconds; None for a table without time.
    record: (n) which record each row belongs to.
    renamed: the option for an import, ``theirs=ours [unit]``, with a unit only where the heading has none.
    options: what the user said of how to read the file.
    policy: what an import must do with times that do not increase; None if they all do, or the user said it.
    """

    path: Path | None
    columns: tuple[Column, ...]
    times: Floats | None
    record: NDArray[np.int64]
    renamed: tuple[str, ...] = ()
    options: Options = field(default_factory=Options)
    policy: TimePolicy | None = None

    def column(self, name: str) -> Column:
        """The column with this name, on the bench or in the file.

        Raises
        ------
        RigctlError
            there is none; it says the nearest.
        """
        for column in self.columns:
            if name in (column.name, column.theirs):
                return column
        raise unknown_name("column", name, [column.name for column in self.columns])

    @property
    def pieces(self) -> list[NDArray[np.intp]]:
        """The rows of each record."""
        return [np.flatnonzero(self.record == code) for code in np.unique(self.record)]


def read_columns(path: Path, units: Mapping[str, str], options: Options | None = None) -> Table:
    """The numeric columns of a file of measurements, with names for a bench.

    Parameters
    ----------
    units: of columns whose heading has none, by name.
    options: of the import. Rows that repeat the one before are left out, and a step back in time begins a
        record, unless they say otherwise.

    Raises
    ------
    RigctlError
        the file cannot be read, has no numbers or two columns of one name, or a unit is unknown.
    """
    from rigctl.dataset.importing.cells.headings import counts_rows, folded
    from rigctl.dataset.importing.cells.time_column import is_other_time, with_time_column
    from rigctl.dataset.importing.columns import interval
    from rigctl.dataset.importing.formats.formats import open_source
    from rigctl.dataset.importing.read_table import stamped_column, table_of

    plain_options = options or Options()
    # The file is opened twice: first for its headings, by which the columns of time and records are found,
    # then with these named, as an import reads them. So a draft's own log can be imported with the options
    # that it prints.
    source = open_source(path, plain_options)
    headings = {heading.name: _heading(heading, units) for heading in source.headings}
    _check_units(units, headings.values())
    plain = {name: heading.plain.strip().casefold() for name, heading in headings.items()}
    found = with_time_column(((one.name, one.unit) for one in source.headings), plain_options)
    time = next((name for name in headings if found.ours(name) == "time"), None)
    record = next((name for name, ours in plain.items() if ours in _RECORDS), None)
    time = time or stamped_column(path, source, found)
    time = time or _given_time(path, headings, plain_options)
    # a time may be written as a date, which only a time is read from
    named = {name: meaning for name, meaning in ((time, "time"), (record, "record")) if name is not None}
    as_named = replace(plain_options, columns={**named, **found.columns})
    source = open_source(path, as_named)
    read = {heading.name: heading for heading in source.headings}
    table = table_of(source, path, as_named, most=_MOST_ROWS)
    _refuse_repeated(source, [column.name for column in table.columns])
    # The record of each row: as a column says, and a new one wherever time steps back.
    codes = _codes(table.records, len(table.columns[0].values))
    times = None
    renamed = list[str]()
    clock = None if time is None else table.column(time)
    if time is not None and clock is not None:
        heading = _heading(read[time], units)
        given = heading.unit if heading.given else None
        unit = "s" if read[time].seconds else given or as_named.unit_of(time) or read[time].unit or "s"
        times = (
            clock.values * ((given and interval(replace(read[time], unit=unit))) or parse_unit(unit)).factor
        )
        codes = codes + np.concatenate([[0], np.cumsum(np.diff(times) < 0.0)]) if times.size else codes
        said = not (read[time].seconds or heading.stated) and (given or as_named.unit_of(time))
        renamed += _time_pair(_key(time, heading.headed) if said else time, unit if said else None)
    renamed += [f"{record}=record"] if record is not None and record.casefold() != "record" else []
    renamed += [f"{name}=-" for name in table.texts]
    # What is left is measured or commanded; which, the roles decide (`rigctl.proposal.roles`).
    columns = list[Column]()
    for one in table.columns:
        if one.name == time or (time is not None and is_other_time(one.name, one.unit, as_named)):
            continue
        column = _column(_heading(read[one.name], units), one.values, [c.name for c in columns])
        if times is not None and counts_rows(one.name, one.values):
            column = replace(column, role="left out", reason="it counts the rows")
        columns.append(column)
        if not column.stated:
            renamed.append(f"{column.key}={column.name} [{column.unit}]")
        elif folded(column.theirs) != column.name:
            renamed.append(f"{column.theirs}={column.name}")
    if not columns:
        raise RigctlError(
            "there is nothing measured in this file", value=path.as_posix(), expected="columns of numbers"
        )
    policy = None if times is None or plain_options.times else _policy(columns, times, codes)
    return Table(path, tuple(columns), times, codes, tuple(renamed), plain_options, policy)


def _time_pair(theirs: str, unit: str | None) -> list[str]:
    """The option that makes a column the time; without a unit if the heading states it, or nobody does."""
    if unit is None:
        return [] if theirs.casefold() == "time" else [f"{theirs}=time"]
    return [f"{theirs}=time [{unit}]"]


def _refuse_repeated(source: Source, numeric: Sequence[str]) -> None:
    """Refuse two columns of numbers with one heading: `rigctl import` could not tell them apart."""
    seen = set[str]()
    for heading in source.headings:
        if heading.name in seen and heading.name in numeric:
            raise RigctlError(
                "the column is there twice",
                value=heading.name,
                hint="Rename one of them in the file",
                where=heading.where,
            )
        seen.add(heading.name)


def _policy(columns: Sequence[Column], times: Floats, codes: NDArray[np.int64]) -> TimePolicy | None:
    """How an import must treat these times: copies of a row are dropped, a step back begins a record."""
    again = np.flatnonzero((np.diff(times) == 0.0) & (np.diff(codes) == 0)) + 1
    if again.size:
        same = (np.array_equal(c.values[again], c.values[again - 1], equal_nan=True) for c in columns)
        return "drop" if all(same) else None
    back = np.diff(times) < 0.0
    return "split" if (back & (np.diff(codes) == 1)).any() else None


def _key(name: str, headed: str) -> str:
    return f"{name} [{headed}]" if headed and not set(headed) & set("[]=") else name


@dataclass(frozen=True)
class _Heading:
    name: str  # as an import knows the column
    unit: str | None
    stated: bool
    plain: str  # without a unit in it
    given: bool = False  # the unit is the user's
    unread: str = ""  # what stands in the unit's place, and is no unit
    headed: str = ""  # what stands there, unit or not


def _heading(read: Heading, units: Mapping[str, str]) -> _Heading:
    from rigctl.dataset.importing.cells.headings import counts_turns, split_ending

    name, unit = read.name, "s" if read.seconds else read.unit
    headed = read.unit or ""
    plain, guessed = split_ending(name)
    stated = unit is not None and find_unit(unit) is not None
    if stated and guessed != unit:  # 'Channel A [V]' is no current
        plain, guessed = name, None
    given = units.get(name, units.get(_plain_name(plain)))
    if given is not None:
        if not _is_interval(given):
            parse_unit(given)
        return _Heading(name, given, False, plain, given=True, headed=headed)
    unit_text = unit if stated else guessed
    if unit_text is not None and counts_turns(plain, unit_text):
        return _Heading(name, "rpm", False, plain, headed=headed)
    return _Heading(name, unit_text, stated, plain, unread="" if stated else headed, headed=headed)


def _is_interval(unit: str) -> bool:
    """Whether a unit is a time from row to row, as the user states it: ``50 ms``, and not ``1/min``."""
    return re.match(r"[\d.]+\s*[a-zµ]", unit) is not None


def _given_time(path: Path, headings: Mapping[str, _Heading], options: Options) -> str | None:
    """The column to which the user has given a time from row to row, or a unit of time while it rises evenly.

    A duration, such as the time that a drive takes to stop, has a unit of time as well.
    """
    given = {name: one.unit for name, one in headings.items() if one.given and one.unit}
    stated = next((name for name, unit in given.items() if _is_interval(unit)), None)
    seconds = parse_unit("s").dimension
    named = [
        n for n, unit in given.items() if not _is_interval(unit) and parse_unit(unit).dimension == seconds
    ]
    if stated is not None or not named:
        return stated
    from rigctl.dataset.importing.formats.formats import open_source
    from rigctl.dataset.importing.read_table import table_of

    table = table_of(open_source(path, options), path, options, most=_MOST_ROWS)
    columns = ((name, table.column(name)) for name in named)
    return next((name for name, one in columns if one is not None and rises_evenly(one.values)), None)


def rises_evenly(values: Floats) -> bool:
    """Whether a column of many rows increases by the same amount each time, as a time does."""
    steps = np.diff(values)
    return len(steps) >= _MANY_STEPS and steps[0] > 0.0 and bool(np.allclose(steps, steps[0], rtol=1e-3))


def _check_units(units: Mapping[str, str], headings: Iterable[_Heading]) -> None:
    known = {name for heading in headings for name in (heading.name, _plain_name(heading.plain))}
    require_known("--unit: column", units, known)


def _codes(records: Sequence[str] | None, rows: int) -> NDArray[np.int64]:
    """The record of each row, as a number that leaves room for records within it."""
    if records is None:
        return np.zeros(rows, dtype=np.int64)
    numbers = {text: 1000 * k for k, text in enumerate(dict.fromkeys(records))}
    return np.array([numbers[text] for text in records], dtype=np.int64)


def _column(heading: _Heading, values: Floats, taken: list[str]) -> Column:
    name = _plain_name(heading.plain)
    while name in taken:
        name += "_2"
    unit = heading.unit or "1"
    parsed = parse_unit(unit)
    values = values * parsed.factor + parsed.offset
    known = heading.stated or heading.unit is not None
    return Column(
        name,
        heading.name,
        unit,
        values,
        heading.stated,
        known=known,
        unread=heading.unread,
        headed=heading.headed,
    )


def _plain_name(text: str) -> str:
    """A name that an expression can use: ``Motor Speed`` is ``motor_speed``."""
    from rigctl.dataset.importing.cells.headings import identifier

    name = identifier(text)
    name = name if name[:1].isalpha() else f"channel_{name}".strip("_")
    return f"{name}_value" if name in _RESERVED or name in reserved_names() else name[:60]


#: reserved by tables, formulas and templates
_RESERVED: Final = frozenset(
    (  # noqa: SIM905
        "time record and or not true false abs min max sqrt exp log tanh first last mean std duration total "
        "factor before after rate total constant option table rest gain time_constant natural_frequency "
        "damping_ratio drive mass damping stiffness extra_force resistance motor_constant inertia friction "
        "inductance extra_torque voltage_error pump_gain corner gravity discharge_coefficient heat_capacity "
        "conductance extra_heat rated_power at_rest linear quadratic loss"
    ).split(" ")
)
