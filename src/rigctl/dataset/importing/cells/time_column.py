"""Which column of a file has the times of its rows, if the user has not said so."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from rigctl.dataset.importing.cells.headings import folded, is_date, is_first_axis, split_heading, time_unit
from rigctl.dataset.importing.options import Options


def with_time_column(headings: Iterable[tuple[str, str | None]], options: Options) -> Options:
    """Return the options with the file's time mapped to ``time``, and a date beside it to ``date``.

    The first column that is a time by its name is the time, unless there is one called ``time``. A name of
    the bench is never one. The function gives the same result for the columns as written and as read, so
    that every stage of an import may call it.

    Parameters
    ----------
    headings: name and unit of each column.
    """
    columns = [(name, unit) for name, unit in headings if name]
    if any(options.ours(name) == "time" for name, _ in columns):
        return options
    own = {folded(name) for name in options.own}
    free = [pair for pair in columns if pair[0] not in options.columns and folded(pair[0]) not in own]
    found = next(((name, unit) for name, unit in free if time_unit(name, unit)[0]), None)
    if (
        found is None
        and columns
        and columns[0] in free
        and is_first_axis([n for n, _ in columns], columns[0][1])
    ):
        found = columns[0]
    if found is None:
        return options
    time, written = found
    unit = time_unit(time, written)[1]
    added = {time: f"time [{unit}]" if unit else "time"}
    day = next((name for name, unit in free if unit is None and is_date(name, time)), None)
    if day is not None and folded(day) != "date":
        added[day] = "date"
    return replace(
        options, columns={**options.columns, **added}, may_lack=options.may_lack | frozenset(added)
    )


def is_other_time(name: str, unit: str | None, options: Options) -> bool:
    """Return whether a column is a time by its name, but not the one that is used."""
    mapped = name in options.columns or folded(name) in {folded(known) for known in options.own}
    return not mapped and time_unit(*split_heading(name) if unit is None else (name, unit))[0]
