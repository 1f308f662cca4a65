"""Selects runs by an SQL condition that can only read the two tables of the index.

In: a condition that a person has typed, or a browser has sent. Out: rows. The condition becomes part of
an SQL statement, as that is the language it is written in; what it may do is therefore limited by SQLite
itself, with an authoriser that permits reading alone, and limits of length and time. A look at the text
before that makes sure that it is one condition.
"""

from __future__ import annotations

import math
import re
import sqlite3
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import Any, Final, NoReturn

from rigctl.dataset.index.schema import CHANNEL_COLUMNS, INNER_COLUMNS, ORDER, RUN_COLUMNS, VIEWS, quoted
from rigctl.errors import RigctlError, unknown_name

_COLUMNS: Final = (*RUN_COLUMNS, *INNER_COLUMNS)
_READS: Final = frozenset({"runs", "channels", "run", "channel", "channel_name"})
#: steps of the database between two checks for Ctrl-C
_STEPS: Final = 100_000
#: longest condition, and longest text or blob in it, in bytes
_LONGEST: Final = 1_000_000
#: longest pattern of a LIKE, whose time grows with its wildcards
_PATTERN: Final = 1000
#: errors of a condition, not of the file
_ITS_OWN: Final = frozenset(
    {
        sqlite3.SQLITE_ERROR,
        sqlite3.SQLITE_AUTH,
        sqlite3.SQLITE_TOOBIG,
        sqlite3.SQLITE_NOMEM,
        sqlite3.SQLITE_INTERRUPT,
        sqlite3.SQLITE_MISMATCH,
        sqlite3.SQLITE_RANGE,
    }
)
#: functions with effects beyond a query
_FORBIDDEN: Final = frozenset({"load_extension", "readfile", "writefile", "edit", "fts3_tokenizer"})


def select(
    index: sqlite3.Connection, where: str | None = None, last: int | None = None
) -> list[dict[str, Any]]:
    """Return the rows of the runs that meet a condition, oldest first.

    Parameters
    ----------
    where: an expression in SQLite's SQL over the columns of a run, `VIEWS`; all runs if omitted.
    last: number of newest runs to return.

    Raises
    ------
    RigctlError
        the condition is wrong; names the nearest column.
    """
    chosen = "" if where is None else f"WHERE id IN (SELECT id FROM runs WHERE (\n{where}\n))"  # noqa: S608
    newest = ", ".join(f"{column} DESC" for column in ORDER.split(", "))
    sql = f"SELECT {quoted(_COLUMNS)} FROM run {chosen} ORDER BY {newest} LIMIT ?"  # noqa: S608 - guarded
    with _guarded(index, where):
        rows = index.execute(sql, [-1 if last is None else last]).fetchall()
    return [dict(zip(_COLUMNS, row, strict=True)) for row in reversed(rows)]


#: columns of the text search
_SEARCHED: Final = ("id", "procedure", "rig", "operator", "serial_number", "part", "status")


@dataclass(frozen=True)
class Page:
    """Some of the runs that meet a condition, in the requested order.

    `found` is the number that meet it, `all` the number of runs.
    """

    rows: list[dict[str, Any]]
    found: int
    all: int


def select_page(
    index: sqlite3.Connection,
    *,
    where: str | None = None,
    search: str = "",
    sort: str = "started",
    descending: bool = True,
    first: int = 0,
    count: int = 50,
    seconds: float | None = None,
) -> Page:
    """Return a page of the runs.

    Parameters
    ----------
    where: as in `select`.
    search: words, each of which must occur in one of the run's names.
    sort: a column of a run; runs without a value are last.
    first: index of the first run among those that meet the condition, from 0.
    seconds: time limit for the condition.

    Raises
    ------
    RigctlError
        the condition is wrong, or there is no such column.
    """
    if sort not in RUN_COLUMNS:
        raise unknown_name("column", sort, RUN_COLUMNS)
    conditions = [f"id IN (SELECT id FROM runs WHERE (\n{where}\n))"] if where else []  # noqa: S608
    words = ["%" + re.sub(r"([%_^])", r"^\1", word) + "%" for word in search.split()]
    texts = " || ' ' || ".join(f"coalesce({name}, '')" for name in _SEARCHED)
    conditions += [f"({texts}) LIKE ? ESCAPE '^'" for _ in words]
    chosen = f"WHERE {' AND '.join(conditions)}" if conditions else ""
    way = " DESC" if descending else ""
    keys = ORDER.split(", ") if sort == "started" else [f'"{sort}"', *ORDER.split(", ")]
    order = ", ".join(f"{key}{way}" for key in keys)
    missing = f'"{sort}" IS NULL, ' if sort != "started" else ""
    sql = f"SELECT {quoted(_COLUMNS)} FROM run {chosen} ORDER BY {missing}{order} LIMIT ? OFFSET ?"  # noqa: S608
    with _guarded(index, where, seconds):
        rows = index.execute(sql, [*words, count, first]).fetchall()
        (matching,) = index.execute(f"SELECT count(*) FROM run {chosen}", words).fetchone()  # noqa: S608
    (every,) = index.execute("SELECT count(*) FROM run").fetchone()
    return Page([dict(zip(_COLUMNS, row, strict=True)) for row in rows], matching, every)


#: true or false for every run
_NUMBER: Final = re.compile(r"[-+.\d\s]*")


@contextmanager
def _guarded(index: sqlite3.Connection, where: str | None, seconds: float | None = None) -> Iterator[None]:
    """Restrict the database to reading its own tables, in limited memory and time, and handle Ctrl-C."""
    if where is None:
        yield
        return
    if where.count("(") != where.count(")") or ";" in where or _NUMBER.fullmatch(where):
        raise RigctlError("not one condition", value=where, expected="e.g. rig = 'bench' AND records > 20")
    # From here to `finally`: read only, in bounded memory and time. The progress handler also lets Ctrl-C
    # through.
    index.set_authorizer(_authorise)
    end = math.inf if seconds is None else monotonic() + seconds
    index.set_progress_handler(lambda: monotonic() > end, _STEPS)
    index.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST)
    index.setlimit(sqlite3.SQLITE_LIMIT_LIKE_PATTERN_LENGTH, _PATTERN)
    try:
        yield
    # Mistakes in the condition are the user's; anything else is the file's, and handled by
    # `rigctl.dataset.index.file`.
    except sqlite3.DatabaseError as problem:
        # one without a code is of the binding: a '?' in the condition
        code = getattr(problem, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
        if code & 0xFF in _ITS_OWN:
            _refuse(problem, where)
        raise
    except (MemoryError, UnicodeError) as problem:
        _refuse(problem, where)
    finally:
        index.set_authorizer(None)
        index.set_progress_handler(None, 0)


def _authorise(action: int, first: str | None, second: str | None, *_: str | None) -> int:
    if action in (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_RECURSIVE):
        return sqlite3.SQLITE_OK
    if action == sqlite3.SQLITE_READ and first in _READS:
        return sqlite3.SQLITE_OK
    if action == sqlite3.SQLITE_FUNCTION and second not in _FORBIDDEN:
        return sqlite3.SQLITE_OK
    return sqlite3.SQLITE_DENY


def _refuse(problem: Exception, where: str) -> NoReturn:
    text = str(problem) or "it needs too much memory"
    if text == "interrupted":
        text = "it takes too long"
    names: Sequence[str] = sorted({name for columns in VIEWS.values() for name in columns})
    if column := re.search(r"no such column: (\S+)", text):
        raise unknown_name("column", column.group(1).rpartition(".")[2], names) from problem
    if table := re.search(r"no such table: (\S+)", text):
        raise unknown_name("table", table.group(1), VIEWS) from problem
    raise RigctlError(
        f"the condition cannot be understood: {text}",
        value=textwrap.shorten(where, 200),
        expected="e.g. rig = 'bench' AND records > 20",
        hint=f"Of a run there are {', '.join(RUN_COLUMNS)}; of its channels {', '.join(CHANNEL_COLUMNS)}",
    ) from problem
