"""The entries of a survey: runs, records or groups of them, ordered by date or by a column.

In: runs, what forms an entry (``by``), and what orders them (``over``). Out: `Entries` with their places on
one axis. The order matters more than the distances: the test of a change is one of ranks, and two entries at
one place are never told apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Final

import numpy as np

from rigctl.dataset import Run
from rigctl.errors import RigctlError, unknown_name
from rigctl.units import parse_unit, read_si, show

#: values of `--by` and `--over` besides the names of columns
GROUPS: Final = ("run", "record", "day", "week", "month")
DATE: Final = "date"
ORDER: Final = "order"
_DAY = 86_400.0


@dataclass(frozen=True)
class Entry:
    """One point of a survey.

    Attributes
    ----------
    label: a run's id, a record's with its number, or the value of a group.
    runs: paths or addresses of the runs from which it comes.
    records: (run's id, index) of its records; None for all that are usable.
    place: its location on the axis, SI, or s since 1970; NaN if unknown.
    started: when it was measured, ISO 8601; empty if unknown.
    """

    label: str
    runs: tuple[str, ...]
    records: tuple[tuple[str, int], ...] | None
    place: float
    started: str = ""


@dataclass(frozen=True)
class Axis:
    """The axis of the survey: a date, the order, or a column with its unit."""

    name: str
    unit: str = ""

    def text(self, entry: Entry) -> str:
        """The location of an entry, in words."""
        if self.name == DATE:
            return f"{datetime.fromtimestamp(entry.place).astimezone():%Y-%m-%d %H:%M}"
        if self.name == ORDER:
            return f"{entry.place:.0f}"
        return show(entry.place, self.unit)


@dataclass(frozen=True)
class Entries:
    """The entries of a survey, in order.

    Attributes
    ----------
    notes: remarks on the order.
    """

    entries: tuple[Entry, ...]
    axis: Axis
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Member:
    """One record, or a run whose records all belong together."""

    run: Run
    record: int | None


def entries_of(runs: Sequence[Run], by: str = "run", over: str | None = None) -> Entries:
    """The entries of a survey, ordered by their location on the axis.

    Parameters
    ----------
    by: ``run``, ``record``, ``day``, ``week``, ``month``, or a column of the records; records with the same
        value form one entry.
    over: ``date``, ``order``, or a column, an argument or a channel, whose mean is used; by default the date,
        if the runs have one.

    Raises
    ------
    RigctlError
        there is no run, or a column is unknown or without a value.
    """
    if not runs:
        raise RigctlError("a survey needs runs")
    undated = [run for run in runs if not _dated(run)]
    grouped = _grouped(runs, by, undated)
    entries = [_entry(label, members) for label, members in grouped.items()]
    wanted, notes = over, []
    if wanted is None:
        dates = [_date(members) for members in grouped.values()]
        wanted = DATE if not undated and len(set(dates)) == len(dates) else ORDER
        if undated:
            notes.append(
                f"{_some(undated)} of imported data without a date of measurement: ordered as given, "
                "not by date"
            )
    if wanted == DATE and undated and over is not None:
        raise RigctlError(
            f"{_some(undated)} of imported data without a date of measurement",
            value="--over date",
            expected=f"'order', or one of {', '.join(_columns(runs)) or 'no column'}",
        )
    axis, location = _axis(wanted, runs)
    placed = [
        replace(entry, place=location(members) if location is not None else float(k))
        for k, (entry, members) in enumerate(zip(entries, grouped.values(), strict=True), start=1)
    ]
    lost = [entry.label for entry in placed if not math.isfinite(entry.place)]
    if lost:
        notes.append(f"left out, as without a value of {axis.name}: {_listed(lost)}")
    located = sorted((entry for entry in placed if math.isfinite(entry.place)), key=lambda entry: entry.place)
    if not located:
        raise RigctlError(f"no run has a value of {axis.name}", value=axis.name)
    return Entries(tuple(located), axis, tuple(notes))


def _grouped(runs: Sequence[Run], by: str, undated: Sequence[Run]) -> dict[str, list[_Member]]:
    """The entries' members by label, in the order in which they come."""
    ordered = sorted(runs, key=lambda run: run.header.started) if not undated else list(runs)
    if by == "run":
        return {run.id: [_Member(run, None)] for run in ordered}
    label = _labeller(runs, by, undated)
    members_by_label: dict[str, list[_Member]] = {}
    for run in ordered:
        for record in run.usable:
            name = label(run, record)
            if name is not None:
                members_by_label.setdefault(name, []).append(_Member(run, record))
    return _required(members_by_label, runs)


def _labeller(runs: Sequence[Run], by: str, undated: Sequence[Run]) -> Callable[[Run, int], str | None]:
    """A function that gives the label of a record's entry; None for a record that belongs to none."""
    if by == "record":
        several = len(runs) > 1
        return lambda run, record: f"{run.id} record {record + 1}" if several else f"record {record + 1}"
    if by in GROUPS:
        if undated:
            raise RigctlError(
                f"{_some(undated)} of imported data without a date of measurement",
                value=f"--by {by}",
                expected="run, record, or a column",
            )
        return lambda run, record: _period(by, _moment(_Member(run, record)))
    known = _record_columns(runs)
    if by not in known:
        raise unknown_name("group or column", by, [*GROUPS, *known])

    def of_column(run: Run, record: int) -> str | None:
        value = float(_column(run, by)[record])
        return f"{by} {show(value, known[by], digits=6)}" if math.isfinite(value) else None

    return of_column


def _required(members_by_label: dict[str, list[_Member]], runs: Sequence[Run]) -> dict[str, list[_Member]]:
    if not members_by_label:
        count = sum(int(run.info["records"]) for run in runs)
        raise RigctlError(
            f"no record can be used: all {count} are incomplete or excluded",
            hint="'rigctl runs show' lists them",
        )
    return members_by_label


def _entry(label: str, members: Sequence[_Member]) -> Entry:
    runs = tuple(dict.fromkeys(str(member.run.folder) for member in members))
    complete = members[0].record is None
    records = None if complete else tuple((one.run.id, one.record or 0) for one in members)
    dated = all(_dated(one.run) for one in members)
    started = min(map(_moment, members)).isoformat(timespec="seconds") if dated else ""
    return Entry(label, runs, records, math.nan, started)


def _axis(name: str, runs: Sequence[Run]) -> tuple[Axis, Callable[[Sequence[_Member]], float] | None]:
    """The axis of the entries, and the function for an entry's location; None if that is its number."""
    if name == ORDER:
        return Axis(ORDER), None
    if name == DATE:
        return Axis(DATE), _date
    columns = _columns(runs)
    if name not in columns:
        raise unknown_name("column", name, [DATE, ORDER, *columns])
    return Axis(name, columns[name]), lambda members: _mean(members, name, columns[name])


def _mean(members: Sequence[_Member], name: str, unit: str) -> float:
    """The mean over the records of an entry; NaN if none has a value."""
    values = [value for member in members for value in _values(member, name, unit) if math.isfinite(value)]
    return float(np.mean(values)) if values else math.nan


def _values(member: _Member, name: str, unit: str) -> Iterator[float]:
    run, chosen = member.run, member.record
    records = run.usable if chosen is None else (chosen,)
    if name in _record_columns([run]):
        values = _column(run, name)
        yield from (float(values[record]) for record in records)
    elif name in run.header.arguments:
        yield read_si(run.header.arguments[name], unit)
    elif name in run.layout.channels and run.info["rows"]:
        for record in records:
            read = run.signals(name, record)
            yield float(np.nanmean(read)) if np.isfinite(read).any() else math.nan


def _column(run: Run, name: str) -> np.ndarray:
    """(records) a column of a run's records, SI; NaN if a record has no value."""
    if name not in run.records:
        return np.full(int(run.info["records"]), np.nan)
    unit = parse_unit(run.record_units[name])
    return np.array([unit.to_si(float(value)) for value in run.records[name]], dtype=float)


def _record_columns(runs: Sequence[Run]) -> dict[str, str]:
    """The numeric columns of the records, from sweeps and measures, with their units."""
    units: dict[str, str] = {}
    for run in runs:
        for name, unit in run.record_units.items():
            if name not in ("rate", "start", "end") and run.records[name].dtype.kind == "f":
                units.setdefault(name, unit)
    return units


def _columns(runs: Sequence[Run]) -> dict[str, str]:
    """All possible axes of these runs, with their units."""
    units = _record_columns(runs)
    for run in runs:
        for name, text in run.header.arguments.items():
            unit = _unit_of(text)
            if unit is not None:
                units.setdefault(name, unit)
        if run.info["rows"]:
            for name in run.layout.channels:
                units.setdefault(name, run.layout.unit(name))
    return units


def _unit_of(text: str) -> str | None:
    """The unit of an argument that is a quantity; None for any other."""
    _, _, unit = str(text).strip().partition(" ")
    try:
        read_si(text, unit.strip() or "1")
    except (RigctlError, ValueError):
        return None
    return unit.strip() or "1"


def _date(members: Sequence[_Member]) -> float:
    return float(np.mean([_moment(member).timestamp() for member in members]))


def _moment(member: _Member) -> datetime:
    """The start of a record, or of a run."""
    started = member.run.header.started
    if member.record is None or member.run.header.source == "import":
        return started
    return started + timedelta(seconds=float(member.run.records["start"][member.record]))


def _period(by: str, moment: datetime) -> str:
    if by == "week":
        year, week, _ = moment.isocalendar()
        return f"{year}-W{week:02d}"
    return f"{moment:%Y-%m-%d}" if by == "day" else f"{moment:%Y-%m}"


def _dated(run: Run) -> bool:
    """False for imported data of which only the time of import is known."""
    header = run.header
    return header.source != "import" or header.backend.get("imported") != header.started.isoformat()


def _some(runs: Sequence[Run]) -> str:
    ids = [run.id for run in runs]
    return f"{_listed(ids)} {'is' if len(ids) == 1 else 'are'}"


def _listed(names: Sequence[str], most: int = 3) -> str:
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
