"""The fields of ``run.json``, each declared once: its values, its meaning, and its columns among all runs.

From `FIELDS` follow the check of every ``run.json``, the columns of the index and of ``rigctl runs sql``, the
catalogue, and the reference page. Values are checked because a forger can compute checksums too, and one
wrong type would end every command that reads all runs.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple, TypeAlias

_Check: TypeAlias = Callable[[Any], bool]

#: characters of a path that leads out of the run's folder
_ELSEWHERE: Final = frozenset("/\\:\0")
#: limits of the integers that the tables over all runs hold
_COUNT: Final = 1 << 31
_LONG: Final = 1 << 63
#: s
_LONGEST: Final = 1e12
#: an instant in the format of `utc`
_CANONICAL: Final = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{6})?\+00:00")


class Column(NamedTuple):
    """A column of the tables over all runs: its type in SQL, and the key of its value within the field."""

    name: str
    sql: str
    key: str | None = None


class Field(NamedTuple):
    """A field of ``run.json``."""

    check: _Check
    meaning: str
    columns: tuple[Column, ...] = ()


def column_values(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of `COLUMNS` for one run; None for what it does not state."""
    values = {}
    for field, column in _PLACES:
        value = info.get(field)
        if column.key is not None and value is not None:
            value = value.get(column.key)
        values[column.name] = utc(value) if column.sql == "TIMESTAMPTZ" else value
    return values


def utc(text: str | None) -> str | None:
    """Format an instant in UTC, so that texts sort by time."""
    if text is None or _CANONICAL.fullmatch(text):
        return text
    return datetime.fromisoformat(text).astimezone(UTC).isoformat()


def wrong_field(info: Mapping[str, Any]) -> str | None:
    """The name of the first field that is not what rigctl writes; None if there is none."""
    for name in _REQUIRED:
        if name not in info:
            return name
    for name, field in FIELDS.items():
        if name in info and not field.check(info[name]):
            return name
    layout = info["layout"]
    if len(layout["units"]) != 2 + len(layout["channels"]) + len(layout["commands"]):  # time and record first
        return "layout"
    return None


def foreign_file(info: Mapping[str, Any]) -> bool:
    """Whether the run claims a file that is not in its folder."""
    return any(_ELSEWHERE.intersection(name) for name in info.get("files", ()))


def _anything(_: Any) -> bool:
    return True


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _seconds(value: Any) -> bool:
    """Whether it is a duration of at most some ten thousand years."""
    return _number(value) and abs(value) < _LONGEST


def _ends(value: Any) -> bool:
    """Whether it is the lower and the upper end of a range."""
    return isinstance(value, list) and len(value) == 2 and all(map(_number, value)) and value[0] < value[1]


def _below(limit: int) -> _Check:
    return lambda value: isinstance(value, int) and not isinstance(value, bool) and -limit <= value < limit


def _instant(value: Any) -> bool:
    """Whether it is a date and a time with its zone, which all calendars used here have."""
    try:
        time = datetime.fromisoformat(value)
        return time.tzinfo is not None and bool(time.astimezone(UTC))
    except (TypeError, ValueError, OverflowError):
        return False


def _or_none(check: _Check) -> _Check:
    return lambda value: value is None or check(value)


def _each(check: _Check) -> _Check:
    return lambda value: isinstance(value, list) and all(map(check, value))


def _by_name(check: _Check) -> _Check:
    return lambda value: isinstance(value, dict) and all(map(check, value.values()))


def _object(required: Mapping[str, _Check], others: Mapping[str, _Check], *, only: bool = False) -> _Check:
    """An object with these fields; with `only`, it has no further ones."""
    checks = {**required, **others}

    def check(value: Any) -> bool:
        if not isinstance(value, dict) or not required.keys() <= value.keys():
            return False
        return all(checks[name](value[name]) if name in checks else not only for name in value)

    return check


_count, _long = _below(_COUNT), _below(_LONG)
_SOURCE: Final = _object({"name": _text}, dict.fromkeys(("text", "sha256", "path"), _text), only=True)
_NAMES: Final = _each(_text)
_MEASURE: Final = _object(
    {"name": _text, "value": _or_none(_number), "unit": _text},
    {
        "low": _or_none(_number),
        "high": _or_none(_number),
        "passed": _or_none(lambda value: isinstance(value, bool)),
        "missing": _or_none(_number),
    },
)
_ANNOTATION: Final = _object(
    dict.fromkeys(("when", "by", "kind", "text"), _text), {"record": _or_none(_count)}, only=True
)
_ABSENCE: Final = _object({"device": _text, "lost": _text, "begin": _number, "end": _or_none(_number)}, {})
_CALIBRATION: Final = _object({}, {"coefficients": _or_none(_each(_number))})
_REQUIRED: Final = ("id", "status", "procedure", "rig", "layout", "started")

#: the order is that of the columns
FIELDS: Final[Mapping[str, Field]] = {
    "format": Field(_anything, "2: the version of this layout"),
    "id": Field(_text, "the run's id", (Column("id", "VARCHAR"),)),
    "status": Field(
        _text, "`running`, `finished`, `failed`, `aborted`, `interrupted`", (Column("status", "VARCHAR"),)
    ),
    "reason": Field(
        _or_none(_text), "why it did not finish, or what its files lack although it finished; null"
    ),
    "unconfirmed": Field(
        _or_none(_text),
        "outputs that may still have been on at the end, since the bench did not confirm that they were off",
        (Column("unconfirmed", "VARCHAR"),),
    ),
    "absences": Field(
        _each(_ABSENCE),
        "of several devices those that were lost while the run paused for them or went on without them: "
        "`device`, `lost` (`pause` or `continue`), `begin` and `end` in s, null if it did not come back; "
        "absent without any",
    ),
    "procedure": Field(
        _SOURCE,
        "`name`, `text` word for word, `sha256` of it, `path`",
        (Column("procedure", "VARCHAR", "name"),),
    ),
    "rig": Field(_SOURCE, "the same of the rig", (Column("rig", "VARCHAR", "name"),)),
    "source": Field(
        _text,
        "`bench` for a run that was executed, on a real bench or a simulated one; `import` for imported data",
        (Column("source", "VARCHAR"),),
    ),
    "operator": Field(_text, "person in charge", (Column("operator", "VARCHAR"),)),
    "device": Field(
        _by_name(_text),
        "device under test: `serial_number`, `part`, `notes`; absent if not given",
        (
            Column("serial_number", "VARCHAR", "serial_number"),
            Column("part", "VARCHAR", "part"),
            Column("device_notes", "VARCHAR", "notes"),
        ),
    ),
    "test": Field(
        _object({}, {"result": _text, "passed": _count, "missed": _count}),
        "`result` of the measures with limits: `pass` if the run finished and all of them are met, `fail` if "
        "one was missed, `incomplete`, or `none` without any; the numbers `passed` and `missed`",
        (
            Column("test", "VARCHAR", "result"),
            Column("passed", "INTEGER", "passed"),
            Column("missed", "INTEGER", "missed"),
        ),
    ),
    "backend": Field(
        _by_name(_text),
        "identity of the bench: `kind`, `name` and more; for a simulated one `plant` with its hidden "
        "effects, `seed`, `noise`, `faults`; of several devices `NAME.kind`, `NAME.port` and more of each; "
        "for an import `kind`, `file`, `sha256` of each file, and `imported`, the time of import",
        (Column("backend", "VARCHAR", "kind"),),
    ),
    "seed": Field(
        _or_none(_long),
        "seed for everything random on a simulated bench; null on a real one",
        (Column("seed", "BIGINT"),),
    ),
    "started": Field(
        _instant,
        "date and time with time zone; for an import that of its data, if known",
        (Column("started", "TIMESTAMPTZ"),),
    ),
    "ended": Field(_or_none(_instant), "likewise, or null", (Column("ended", "TIMESTAMPTZ"),)),
    "duration": Field(_seconds, "s of bench time", (Column("duration", "DOUBLE"),)),
    "records": Field(_count, "number of records", (Column("records", "INTEGER"),)),
    "complete_records": Field(
        _count, "number of those that were completed", (Column("complete_records", "INTEGER"),)
    ),
    "rows": Field(_long, "number of samples", (Column("rows", "BIGINT"),)),
    "layout": Field(
        _object(dict.fromkeys(("channels", "commands", "units", "differences"), _NAMES), {}, only=True),
        "`channels`, `commands`, `units` (of time, record, channels, commands), `differences`",
    ),
    "calibrations": Field(
        _by_name(_object({}, {"calibration": _or_none(_CALIBRATION), "range": _or_none(_ends)})),
        "by channel: `quantity`, `raw`, `calibration`, `noise` (SI)",
    ),
    "assumed": Field(
        _by_name(_number),
        "for an import: SI values of constant inputs that were not recorded, by name; absent without any",
    ),
    "clock": Field(_text, "`real`, `virtual`, `10x` …; `recorded` for an import"),
    "options": Field(
        _by_name(_anything),
        "options with which the bench is opened when the run is resumed: `port`, `baud`, or `plant`, "
        "`effects`, `noise`, `seed` of a simulated one; absent if there are none",
    ),
    "versions": Field(_by_name(_text), "`python`, `system`, `rigctl`, `numpy`, `numba`, `pyarrow`"),
    "plan_digest": Field(_text, "hash of the expanded plan, compared before a run is resumed"),
    "arguments": Field(_by_name(_text), "arguments of the procedure"),
    "lost_bytes": Field(_long, "bytes of the journal in damaged frames and after the last complete one"),
    "lost_rows": Field(
        _long, "samples known to be missing: between complete frames, or counted in the log but not present"
    ),
    "damaged_lines": Field(_each(_long), "damaged lines of the log, whose content is lost"),
    "measures": Field(
        _each(_MEASURE),
        "those outside any record: `name`, `value`, `unit`, `low`, `high` (in that unit), `passed`",
    ),
    "sessions": Field(
        _each(lambda value: isinstance(value, dict)),
        "`session`, `offset`, `started`, `operator`, `backend`, `clock`, `seed`, `versions`, `written`, "
        "`ended`, `status`, `reason` of each",
    ),
    "annotations": Field(
        _each(_ANNOTATION), "`when`, `by`, `kind` (`note`, `exclude`, `include`), `text`, `record` of each"
    ),
    "files": Field(
        _by_name(_object({"sha256": _text, "bytes": _long}, {}, only=True)),
        "`sha256` and `bytes` of each file; `rigctl runs verify` compares them",
    ),
    "checksum": Field(
        _anything,
        "SHA-256 of all other fields: as JSON in ASCII, keys sorted, without blanks. A changed file is "
        "refused; `rigctl runs verify` reconstructs it from the log and keeps the changed file as "
        "`run.json.changed-N`",
    ),
}
_PLACES: Final = tuple((name, column) for name, field in FIELDS.items() for column in field.columns)
#: columns of the table `runs`, and their types
COLUMNS: Final[Mapping[str, str]] = {column.name: column.sql for _, column in _PLACES}
