"""The types of the fields of ``run.json``, which other modules rely on.

A forger can compute checksums too, and one wrong type would end every command that reads all runs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any, Final, TypeAlias

_Check: TypeAlias = Callable[[Any], bool]

#: characters of a path that leads out of the run's folder
_ELSEWHERE: Final = frozenset("/\\:\0")
#: limits of the integers that the tables over all runs hold
_COUNT: Final = 1 << 31
_LONG: Final = 1 << 63
#: s
_LONGEST: Final = 1e12


def wrong_field(info: Mapping[str, Any]) -> str | None:
    """The name of the first field that is not what rigctl writes; None if there is none."""
    for name in _REQUIRED:
        if name not in info:
            return name
    for name, check in _FIELDS.items():
        if name in info and not check(info[name]):
            return name
    layout = info["layout"]
    if len(layout["units"]) != 2 + len(layout["channels"]) + len(layout["commands"]):  # time and record first
        return "layout"
    return None


def foreign_file(info: Mapping[str, Any]) -> bool:
    """Whether the run claims a file that is not in its folder."""
    return any(_ELSEWHERE.intersection(name) for name in info.get("files", ()))


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


def _fields(required: Mapping[str, _Check], others: Mapping[str, _Check], *, only: bool = False) -> _Check:
    """An object with these fields; with `only`, it has no further ones."""
    checks = {**required, **others}

    def check(value: Any) -> bool:
        if not isinstance(value, dict) or not required.keys() <= value.keys():
            return False
        return all(checks[name](value[name]) if name in checks else not only for name in value)

    return check


_SOURCE: Final = _fields({"name": _text}, dict.fromkeys(("text", "sha256", "path"), _text), only=True)
_NAMES: Final = _each(_text)
_MEASURE: Final = _fields(
    {"name": _text, "value": _or_none(_number), "unit": _text},
    {
        "low": _or_none(_number),
        "high": _or_none(_number),
        "passed": _or_none(lambda value: isinstance(value, bool)),
        "missing": _or_none(_number),
    },
)
_ANNOTATION: Final = _fields(
    dict.fromkeys(("when", "by", "kind", "text"), _text), {"record": _or_none(_below(_COUNT))}, only=True
)
_CALIBRATION: Final = _fields({}, {"coefficients": _or_none(_each(_number))})
_REQUIRED: Final = ("id", "status", "procedure", "rig", "layout", "started")
_FIELDS: Final[Mapping[str, _Check]] = {
    **dict.fromkeys(("id", "status", "source", "operator", "clock", "plan_digest"), _text),
    **dict.fromkeys(("reason", "unconfirmed"), _or_none(_text)),
    **dict.fromkeys(("procedure", "rig"), _SOURCE),
    **dict.fromkeys(("backend", "versions", "arguments", "device"), _by_name(_text)),
    **dict.fromkeys(("records", "complete_records"), _below(_COUNT)),
    **dict.fromkeys(("rows", "lost_bytes", "lost_rows"), _below(_LONG)),
    "seed": _or_none(_below(_LONG)),
    "started": _instant,
    "ended": _or_none(_instant),
    "duration": _seconds,
    "layout": _fields(dict.fromkeys(("channels", "commands", "units", "differences"), _NAMES), {}, only=True),
    "calibrations": _by_name(
        _fields({}, {"calibration": _or_none(_CALIBRATION), "range": _or_none(_ends)}),
    ),
    "assumed": _by_name(_number),
    "options": _by_name(lambda _: True),
    "damaged_lines": _each(_below(_LONG)),
    "measures": _each(_MEASURE),
    "test": _fields({}, {"result": _text, "passed": _below(_COUNT), "missed": _below(_COUNT)}),
    "annotations": _each(_ANNOTATION),
    "sessions": _each(lambda value: isinstance(value, dict)),
    "files": _by_name(_fields({"sha256": _text, "bytes": _below(_LONG)}, {}, only=True)),
}
