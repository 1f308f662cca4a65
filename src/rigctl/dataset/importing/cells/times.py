"""Times in the formats of loggers: dates and times of day, seconds since an epoch, elapsed times.

In: the texts, or numbers, of a time column. Out: seconds since the first sample, and where the times are
absolute, that sample's instant. Absolute times are converted to integer nanoseconds since 1970-01-01 UTC
first, and then to seconds since the first sample, so that no digit is lost.

A `TimeFormat` is found once, from the first rows (`find_format`), and then holds for the whole file: a
cell of another form is a fault of its row. The kinds are tried in the order in which they exclude each
other: numbers (elapsed, or a count since an epoch by its size and unit), a time of day, a date. Where two
readings are possible and would differ, as day and month, or hours and minutes, the user is asked; nothing
is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from rigctl.dataset.importing.cells.local_time import LocalState, LocalTime, zone_info
from rigctl.errors import Location, RigctlError
from rigctl.units import parse_unit

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import NDArray

    from rigctl.dataset.importing.options import DateOrder, Options

Kind = Literal["number", "epoch", "date", "clock"]

_SECOND: Final = 1_000_000_000
_DAY: Final = 86400.0
#: a clock that steps back by more than this has passed midnight, s
_MIDNIGHT: Final = 43200.0

_ZONE: Final = r"(?P<z>[Zz]|UTC|GMT|[+-]\d{2}(?::?\d{2})?)?"
_TIME: Final = (
    r"(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9})\d*)?)?(?:\s*(?P<p>[AaPp])\.?[Mm]\.?)?"
)
_DATE: Final = (
    r"^\s*(?P<a>\d{1,4})[-./ ](?P<b>\d{1,2}|[A-Za-z]{3,9})[-./ ,]\s?(?P<c>\d{1,4})(?:[T,; _]\s*"
    + _TIME
    + r")?\s*"
    + _ZONE
    + r"\s*$"
)
#: without separators: 20260303T120000
_COMPACT: Final = (
    r"^\s*(?P<a>\d{4})(?P<b>\d{2})(?P<c>\d{2})(?:[T _](?P<h>\d{2})(?P<m>\d{2})(?:(?P<s>\d{2})"
    r"(?:[.,](?P<f>\d{1,9})\d*)?)?(?P<p>[AaPp])?)?\s*" + _ZONE + r"\s*$"
)
_CLOCK: Final = (
    r"^\s*(?P<h>\d{1,4}):(?P<m>\d{2})(?::(?P<s>\d{2}))?(?:[.,:](?P<f>\d{1,9})\d*)?"
    r"(?:\s*(?P<p>[AaPp])\.?[Mm]\.?)?\s*$"
)
_NUMBER: Final = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
_PARTS: Final = re.compile(r"\s*(\d{1,4})([-./ ])(\d{1,2}|[A-Za-z]{3,9})[-./ ,]\s?(\d{1,4})")
_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")

#: counts since an epoch: unit, nanoseconds per count, counts from 1970 to the epoch, and plausible range
_EPOCHS: Final[Sequence[tuple[str, int, int, float, float]]] = (
    ("s", _SECOND, 0, 6.3e8, 2.9e9),  # 1990 to 2061
    ("s", _SECOND, -2_082_844_800, 3.0e9, 4.5e9),  # LabVIEW's, since 1904
    ("ms", 1_000_000, 0, 6.3e11, 2.9e12),
    ("us", 1_000, 0, 6.3e14, 2.9e15),
    ("ns", 1, 0, 6.3e17, 2.9e18),
    ("day", 86400 * _SECOND, -25569, 32874.0, 58000.0),  # a spreadsheet's, since 1899-12-30
    ("day", 86400 * _SECOND, -719529, 7.26e5, 7.53e5),  # MATLAB's datenum
)
#: of clocks whose ``12:30`` is minutes and seconds
_CLOCK_UNITS: Final = ("mm:ss", "m:s", "min:s", "min:sec")


@dataclass(frozen=True)
class TimeFormat:
    """The format of a file's times.

    Parameters
    ----------
    kind: a plain number in the unit of its heading, a count since an epoch, a date, or a clock.
    order: of the numbers of a date, ``ymd``, ``dmy`` or ``mdy``.
    epoch: nanoseconds per count, and counts from 1970 to the epoch.
    zone: time zone of times without one.
    minutes: ``12:30`` is minutes and seconds.
    naive: the times have no time zone.
    """

    kind: Kind
    order: str = "ymd"
    epoch: tuple[int, int] = (_SECOND, 0)
    zone: str | None = None
    minutes: bool = False
    naive: bool = False
    decimal: str = "."

    @property
    def absolute(self) -> bool:
        """Whether the times are absolute."""
        return self.kind in ("epoch", "date")

    @property
    def expected(self) -> str:
        """An example of the format, for messages."""
        if self.kind == "epoch":
            return "a count since an epoch"
        if self.kind == "clock":
            return "a time such as 01:30.5" if self.minutes else "a time such as 14:05:30"
        shown = {"ymd": "2026-03-21", "dmy": "21.03.2026", "mdy": "03/21/2026"}[self.order]
        return f"a date and time such as {shown} 14:05:30"


class TimeReader:
    """Reads the times of one file, part by part, as seconds since `origin` or of the clock.

    Parameters
    ----------
    origin: time zero in nanoseconds since 1970 UTC; None until the first time stamp has been read.
    """

    def __init__(self, form: TimeFormat, origin: int | None = None) -> None:
        self.form = form
        self.origin = origin
        self._latest = 0.0
        self._days = 0.0
        self._local = LocalTime(form.zone)

    @property
    def state(self) -> tuple[int | None, float, float, LocalState]:
        """The state reached by the texts so far."""
        return self.origin, self._latest, self._days, self._local.state

    @state.setter
    def state(self, state: tuple[int | None, float, float, LocalState]) -> None:
        self.origin, self._latest, self._days, self._local.state = state

    def read(self, texts: pa.Array) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the seconds of each text, NaN for none, and which texts are invalid, shape (n,) each."""
        import numpy as np
        import pyarrow.compute as pc

        blank = pc.fill_null(pc.equal(pc.utf8_trim_whitespace(texts), ""), fill_value=True)
        missing = np.asarray(blank.to_numpy(zero_copy_only=False), dtype=bool)
        if self.form.kind == "clock":
            seconds, good = _clock(texts, minutes=self.form.minutes)
            seconds = self._past_midnight(seconds, good)
        else:
            epoch = self.form.kind == "epoch"
            instants, good = _epoch(texts, self.form) if epoch else _dates(texts, self.form, self._local)
            if self.origin is None and good.any():
                self.origin = int(instants[good][0])
            seconds = (instants - (self.origin or 0)) / 1e9
        return np.where(good, seconds, np.nan), ~good & ~missing

    def _past_midnight(self, seconds: NDArray[np.float64], good: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Continue a clock that restarts at midnight."""
        import numpy as np

        known = seconds[good]
        if not len(known):
            return seconds
        # The last time of the previous part comes first, so that a midnight between two parts is seen.
        steps = np.diff(known, prepend=self._latest)
        days = self._days + np.cumsum(steps < -_MIDNIGHT)
        self._latest, self._days = float(known[-1]), float(days[-1])
        seconds = seconds.copy()
        seconds[good] = known + _DAY * days
        return seconds


@dataclass(frozen=True)
class ArrayClock:
    """Converts times stored as numbers or time stamps to seconds since the first sample.

    Parameters
    ----------
    origin: time zero in nanoseconds since 1970 UTC.
    epoch: nanoseconds per count, and counts from 1970 to the epoch; None for time stamps.
    """

    origin: int
    epoch: tuple[int, int] | None = None

    def seconds(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """Return seconds since `origin`; NaN for missing times."""
        import numpy as np

        absent = np.isnat(values) if values.dtype.kind == "M" else ~np.isfinite(values.astype(np.float64))
        return np.where(absent, np.nan, (_nanoseconds(values, absent, self.epoch) - self.origin) / 1e9)


def array_clock(first: Sequence[NDArray[Any]], unit: str | None) -> ArrayClock | None:
    """Return the clock of times stored as numbers or time stamps; None for elapsed times.

    Parameters
    ----------
    first: some of the times of every part of the file.
    """
    import numpy as np

    known = [values for values in first if len(values)]
    if known and all(values.dtype.kind == "M" for values in known):
        stamps = np.concatenate([values.astype("datetime64[ns]") for values in known])
        stamps = stamps[~np.isnat(stamps)]
        return ArrayClock(int(stamps.astype(np.int64).min())) if len(stamps) else None
    if not known or any(values.dtype.kind not in "fiu" for values in known):
        return None
    numbers = np.concatenate([values.astype(np.float64) for values in known])
    epoch = epoch_of(numbers[np.isfinite(numbers)].tolist(), unit)
    if epoch is None:
        return None
    everything = np.concatenate(known)
    absent = ~np.isfinite(everything.astype(np.float64))
    return ArrayClock(int(_nanoseconds(everything, absent, epoch[1:])[~absent].min()), epoch[1:])


def _nanoseconds(
    values: NDArray[Any], absent: NDArray[np.bool_], epoch: tuple[int, int] | None
) -> NDArray[np.int64]:
    """Return nanoseconds since 1970 of time stamps or counts, 0 for missing ones."""
    import numpy as np

    if epoch is None:
        return np.where(absent, 0, values.astype("datetime64[ns]").astype(np.int64))
    scale, offset = epoch
    # Whole and fractional part separately: a count of nanoseconds has more digits than a float.
    present = np.where(absent, 0, values)
    integers = np.floor(present).astype(np.int64)
    behind = np.round((present - integers).astype(np.float64) * scale).astype(np.int64)
    return (integers + offset) * scale + behind


def find_format(
    cells: Sequence[str], unit: str | None, options: Options, path: Path, where: Location
) -> TimeFormat:
    """Detect the format of times from the first of them.

    Raises
    ------
    RigctlError
        the format is ambiguous or unknown.
    """
    present = [cell.strip() for cell in cells if cell.strip()]
    # 1. Most cells are numbers: a few texts among them are faults of their rows, not another format.
    numbers = [cell for cell in present if _NUMBER.fullmatch(cell.replace(",", "."))]
    if not present or 2 * len(numbers) > len(present):
        return _number_format(numbers, unit)
    zone = checked_zone(options.zone)
    # 2. A time of day, which no date looks like.
    if any(re.match(_CLOCK, cell) for cell in present):
        return _clock_format(present, unit, where)
    # 3. Dates, with separators or without.
    dates = [found for cell in present if (found := re.match(_DATE, cell) or re.match(_COMPACT, cell))]
    if not dates and numbers:
        return _number_format(numbers, unit)
    if not dates:
        raise RigctlError(
            "time: neither numbers nor dates",
            value=present[0],
            expected="seconds, or a date and time such as 2026-03-21 14:05:30",
            where=where,
        )
    order = _date_order([found.string for found in dates], options.dates, where)
    return TimeFormat("date", order=order, zone=zone, naive=not any(found["z"] for found in dates))


def checked_zone(name: str | None) -> str | None:
    """Return the name of a time zone after checking that it exists.

    Raises
    ------
    RigctlError
        there is none of that name.
    """
    zone_info(name)
    return name


def instant(nanoseconds: int, zone: str | None) -> datetime:
    """Return the calendar time of nanoseconds since 1970 UTC, to the microsecond."""
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=nanoseconds // 1000)
    return moment.astimezone(zone_info(zone))


def epoch_of(values: Sequence[float], unit: str | None) -> tuple[str, int, int] | None:
    """Return the unit, nanoseconds per count and count of 1970 of an epoch; None for elapsed times."""
    if not values:
        return None
    low, high = min(values), max(values)
    length = None if unit is None else _length_of(unit)
    # By size: the ranges of the table do not overlap, so that the first that fits is the only one. Elapsed
    # times are smaller than any of them, unless they are in a unit that makes them years.
    for name, scale, offset, least, most in _EPOCHS:
        fits = name != "day" if unit is None else length == scale
        if least <= low and high <= most and fits:
            return name, scale, offset
    return None


def _length_of(unit: str) -> int | None:
    """Return the nanoseconds of a unit of time in any spelling, ``µs`` or ``usec``; None for others."""
    try:
        parsed = parse_unit(unit)
    except RigctlError:
        return None
    return round(parsed.factor * _SECOND) if parsed.dimension == parse_unit("s").dimension else None


def _number_format(cells: Sequence[str], unit: str | None) -> TimeFormat:
    decimal = "," if any("," in cell for cell in cells) else "."
    epoch = epoch_of([float(cell.replace(",", ".")) for cell in cells], unit)
    if epoch is None:
        return TimeFormat("number")
    return TimeFormat("epoch", epoch=epoch[1:], decimal=decimal)


def _clock_format(cells: Sequence[str], unit: str | None, where: Location) -> TimeFormat:
    # Two colons, or am and pm: hours, minutes, seconds. One colon alone may be h:min or min:s.
    unambiguous = [cell for cell in cells if cell.count(":") >= 2 or "m" in cell.casefold()]
    minutes = (unit or "").casefold().replace(" ", "") in _CLOCK_UNITS
    fraction = any("." in cell or "," in cell for cell in cells)
    if not unambiguous and not fraction and ":" not in (unit or ""):
        raise RigctlError(
            "time: hours and minutes, or minutes and seconds?",
            value=cells[0],
            hint="Say which in the unit: --columns 'NAME=time [h:min]', or 'NAME=time [min:s]'",
            where=where,
        )
    return TimeFormat("clock", minutes=not unambiguous and (minutes or fraction))


def _date_order(cells: Sequence[str], wanted: DateOrder | None, where: Location) -> str:
    """Return which number of a date is the day, from unambiguous dates or else from the options.

    Raises
    ------
    RigctlError
        the dates are ambiguous.
    """
    split = [match for cell in cells if (match := _PARTS.match(cell))]
    # A year of four digits comes first only in ISO order, whatever the separator.
    if not split or len(split[0][1]) == 4:
        return "ymd"
    if any(not match[3].isdigit() for match in split):
        return "dmy"  # 21-Mar-2026
    # A number above 12 is no month. It need not be in the first row: all sampled dates count.
    first, second = (max(int(match[group]) for match in split) for group in (1, 3))
    certain = "dmy" if first > 12 >= second else "mdy" if second > 12 >= first else None
    option = {"day-first": "dmy", "month-first": "mdy"}.get(wanted or "")
    if certain and option and certain != option:
        raise RigctlError(
            f"time: {wanted} does not fit",
            value=cells[0],
            expected="--dates " + ("day-first" if certain == "dmy" else "month-first"),
            where=where,
        )
    # What the user says; then what the numbers show; then the point, which no month-first country writes.
    order = option or certain or ("dmy" if split[0][2] == "." else None)
    if order is None or wanted == "iso":
        day, month = split[0][1], split[0][3]
        raise RigctlError(
            "time: not an ISO date" if wanted == "iso" else "time: day and month cannot be told apart",
            value=cells[0],
            expected=f"--dates day-first (day {day}, month {month}) or --dates month-first",
            where=where,
        )
    return order


def _groups(texts: pa.Array, pattern: str, names: str) -> dict[str, Any]:
    """Return the named groups of a pattern, "" for those that did not match, and which texts matched."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.compute as pc

    matches = pc.extract_regex(texts, pattern)
    matched = np.asarray(pc.is_valid(matches).to_numpy(zero_copy_only=False), dtype=bool)
    # flattened, so that the groups of texts that did not match are null too
    parts = dict(zip([item.name for item in matches.type], matches.flatten(), strict=True))
    empty = pa.nulls(len(texts), pa.string())
    groups = {name: pc.fill_null(parts.get(name, empty), "") for name in names}
    return {**groups, "matched": matched}


def _whole(texts: pa.Array) -> NDArray[np.int64]:
    """Return the integers of texts of digits, 0 for empty ones."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.compute as pc

    numbers = pc.if_else(pc.equal(texts, ""), "0", texts).cast(pa.int64())
    return np.asarray(numbers.to_numpy(), dtype=np.int64)


def _fraction(texts: pa.Array) -> NDArray[np.int64]:
    """Return the nanoseconds of up to nine digits after a decimal point."""
    import pyarrow.compute as pc

    return _whole(pc.utf8_rpad(texts, 9, padding="0"))


def _half_day(hours: NDArray[np.int64], marks: pa.Array) -> NDArray[np.int64]:
    """Return 24-hour hours from 12-hour ones with am and pm."""
    import numpy as np
    import pyarrow.compute as pc

    if not pc.any(pc.not_equal(marks, "")).as_py():
        return hours
    letter = np.asarray(pc.utf8_lower(marks).to_numpy(zero_copy_only=False), dtype=object)
    late = np.where(letter == "p", 12, 0)
    return np.where(letter == "", hours, hours % 12 + late)


def _clock(texts: pa.Array, *, minutes: bool) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    import numpy as np

    part = _groups(texts, _CLOCK, "hmsfp")
    first, second, third = (_whole(part[name]) for name in "hms")
    fraction = _fraction(part["f"]) / 1e9
    if minutes:
        return first * 60.0 + second + fraction, part["matched"] & (second < 60)
    hours = _half_day(first, part["p"])
    good = part["matched"] & (second < 60) & (third < 60)
    return np.asarray(hours * 3600.0 + second * 60.0 + third + fraction), good


def _epoch(texts: pa.Array, form: TimeFormat) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return nanoseconds since 1970 of counts since an epoch, without loss of digits."""
    import numpy as np

    sign = re.escape(form.decimal)
    part = _groups(texts, rf"^\s*\+?(?P<w>\d{{1,19}})(?:{sign}(?P<d>\d+))?(?P<e>[eE][+-]?\d+)?\s*$", "wde")
    good = part["matched"]
    scale, offset = form.epoch
    with np.errstate(over="ignore"):
        nanoseconds = (_whole(_short(part["w"])) + offset) * scale
    behind = np.array([float(f"0.{text}") for text in part["d"].to_pylist()])
    exponents = np.asarray(part["e"].to_numpy(zero_copy_only=False), dtype=object) != ""
    for index in np.flatnonzero(exponents).tolist():
        count = float(texts[index].as_py().replace(form.decimal, ".")) + offset
        nanoseconds[index] = round(count * scale)
        behind[index] = 0.0
    return nanoseconds + np.round(behind * scale).astype(np.int64), good


def _short(texts: pa.Array) -> pa.Array:
    """Return the digits limited to the largest 64-bit integer."""
    import pyarrow.compute as pc

    large = pc.and_(pc.equal(pc.utf8_length(texts), 19), pc.greater(texts, "9223372036854775807"))
    return pc.if_else(large, "9223372036854775807", texts)


def _dates(
    texts: pa.Array, form: TimeFormat, local: LocalTime
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return nanoseconds since 1970 UTC of dates and times."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.compute as pc

    # The usual case first, all at once. One cell that Arrow does not read sends the whole part the slow way.
    if form.order == "ymd" and form.naive and form.zone is None:
        try:  # proper ISO: twenty times as fast
            quick = texts.cast(pa.timestamp("ns"))
            if not quick.null_count:
                return np.asarray(quick.cast(pa.int64()).to_numpy()), np.ones(len(texts), dtype=bool)
        except pa.ArrowInvalid:
            pass
    names = "abchmsfpz"
    part = _groups(texts, _DATE, names)
    # A file may have both forms; the second pattern is tried only for what the first has left.
    if not part["matched"].all():
        compact = _groups(texts, _COMPACT, names)
        if compact["matched"].any():
            take = pa.array(part["matched"])
            part = {
                **{name: pc.if_else(take, part[name], compact[name]) for name in names},
                "matched": part["matched"] | compact["matched"],
            }
    year, month, day = (part["abc"[form.order.index(letter)]] for letter in "ymd")
    days, good = _days(_whole(year), _months(month), _whole(day))
    hours = _half_day(_whole(part["h"]), part["p"])
    minutes, seconds = _whole(part["m"]), _whole(part["s"])
    # A leap second is written as :60.
    good &= part["matched"] & (hours < 24) & (minutes < 60) & (seconds <= 60)
    since = days * 86400 + hours * 3600 + minutes * 60 + seconds
    shift, named = _offsets(part["z"])
    # An offset in the text counts before the zone of the file.
    if not named.all():
        shift = np.where(named, shift, local.offsets(since, good & ~named))
    return (since - shift) * _SECOND + _fraction(part["f"]), good


def _months(texts: pa.Array) -> NDArray[np.int64]:
    """Return months from numbers or English names; 0 for neither."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.compute as pc

    named = pc.match_substring_regex(texts, "^[A-Za-z]")
    if not pc.any(named).as_py():
        return _whole(texts)
    short = pc.utf8_slice_codeunits(pc.utf8_lower(texts), 0, 3)
    indices = pc.fill_null(pc.index_in(short, value_set=pa.array(_MONTHS)), -1)
    digits = pc.if_else(named, "0", texts)
    numbers = np.asarray(indices.to_numpy(), dtype=np.int64) + 1
    return np.where(np.asarray(named.to_numpy(zero_copy_only=False), dtype=bool), numbers, _whole(digits))


def _days(
    year: NDArray[np.int64], month: NDArray[np.int64], day: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return days since 1970, and which dates exist; two-digit years are in 1970 to 2069."""
    import numpy as np

    year = np.where(year < 70, year + 2000, np.where(year < 100, year + 1900, year))
    good = (month >= 1) & (month <= 12) & (day >= 1) & (year >= 1678) & (year <= 2261)
    months = np.where(good, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
    first = months.astype("datetime64[D]")
    good &= day <= ((months + 1).astype("datetime64[D]") - first).astype(np.int64)
    return first.astype(np.int64) + day - 1, good


def _offsets(texts: pa.Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the offsets from UTC as written, in s, and which texts have one."""
    import numpy as np

    shifts, named = np.zeros(len(texts), dtype=np.int64), np.zeros(len(texts), dtype=bool)
    encoded = texts.dictionary_encode()
    codes = encoded.indices.to_numpy()
    for code, text in enumerate(encoded.dictionary.to_pylist()):
        if text:
            rows = codes == code
            named[rows] = True
            shifts[rows] = _offset(text)
    return shifts, named


def _offset(text: str) -> int:
    if text[0].isalpha():
        return 0
    digits = text[1:].replace(":", "").ljust(4, "0")
    seconds = int(digits[:2]) * 3600 + int(digits[2:]) * 60
    return -seconds if text[0] == "-" else seconds
