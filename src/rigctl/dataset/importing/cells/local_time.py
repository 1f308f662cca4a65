"""Local times as UTC; the order of rows resolves the hour that the end of summer time repeats."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, tzinfo
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from rigctl.errors import RigctlError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: zones change their offset at whole quarters of an hour, s
_QUARTER: Final = 900
_FAR: Final = -(1 << 40)


class LocalState(NamedTuple):
    """The last two local times, s, whether the last was in a repeated hour, and in the second of the two."""

    latest: int = _FAR
    before: int = _FAR
    twice: bool = False
    second: bool = False


class LocalTime:
    """Offsets of local times from UTC, part by part; `state` is carried from one part to the next."""

    def __init__(self, zone: str | None) -> None:
        self.zone = zone_info(zone)
        self.state = LocalState()

    def to_utc(self, stamps: NDArray[Any]) -> NDArray[Any]:
        """Convert the next time stamps without a zone, shape (n,), to UTC."""
        import numpy as np

        if self.zone is UTC:
            return stamps
        nanoseconds = stamps.astype("datetime64[ns]")
        good = ~np.isnat(nanoseconds)
        since = np.where(good, nanoseconds.astype(np.int64), 0) // 1_000_000_000
        return np.asarray(nanoseconds - self.offsets(since, good).astype("timedelta64[s]"))

    def offsets(self, since: NDArray[np.int64], good: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return the offsets from UTC, in s, of the next local times, in s since 1970, shape (n,) each.

        A time of a repeated hour is its second one after a step back by about the repetition; the next
        repeated hour, a year later or in another record, begins with the first again.
        """
        import numpy as np

        offsets = np.zeros(len(since), dtype=np.int64)
        times = since[good]
        if self.zone is UTC or not len(times):
            return offsets
        # Offsets are looked up once for each quarter of an hour, as that is slow, and no zone changes within
        # one.
        quarters, inverse = np.unique(times // _QUARTER, return_inverse=True)
        # Two different offsets only in the hour that the end of summer time repeats, or that its beginning
        # leaves out.
        early, late = (_of_quarters(self.zone, quarters.tolist(), fold)[inverse] for fold in (0, 1))
        twice = early > late
        if twice.any():
            second = self._second(times, twice, early - late)
            offsets[good] = np.where(second, late, early)
        else:
            second = twice
            offsets[good] = early
        # The hour may go on in the next part of the file.
        latest = int(times[-1])
        before = int(times[-2]) if len(times) > 1 else self.state.latest
        self.state = LocalState(latest, before, bool(twice[-1]), bool(second[-1]))
        return offsets

    def _second(
        self, times: NDArray[np.int64], twice: NDArray[np.bool_], shift: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Return which times are those of a repeated hour for the second time."""
        import numpy as np

        known = self.state
        before = np.concatenate([[known.before, known.latest], times])
        back = before[1:-1] - times
        step = np.where(before[:-2] == _FAR, 0, before[1:-1] - before[:-2])  # up to the row before
        inside = twice & np.concatenate([[known.twice], twice[:-1]]) & (np.abs(back) <= shift)
        # rows slightly out of order also step back; with long steps, the second hour begins less far back
        turns = inside & (back >= 0) & ((2 * back >= shift) | (shift - back < 2 * step))
        count = np.cumsum(turns) + int(known.second)
        began = np.maximum.accumulate(np.where(inside, -1, np.arange(len(times))))
        return np.asarray(twice & (count > np.where(began < 0, 0, count[began])))


def _of_quarters(zone: tzinfo, quarters: list[int], fold: int) -> NDArray[np.int64]:
    """Return the offsets of quarters of an hour, counted since 1970 in local time, in s."""
    import numpy as np

    start = datetime(1970, 1, 1)  # noqa: DTZ001 - local times have no zone yet
    moments = [start + timedelta(seconds=quarter * _QUARTER) for quarter in quarters]
    offsets = [moment.replace(tzinfo=zone, fold=fold).utcoffset() for moment in moments]
    return np.array([int(offset.total_seconds()) if offset else 0 for offset in offsets], dtype=np.int64)


def zone_info(name: str | None) -> tzinfo:
    """Return the time zone of that name; UTC for none.

    Raises
    ------
    RigctlError
        there is none of that name.
    """
    from zoneinfo import ZoneInfo, available_timezones

    from rigctl.errors import nearest_name

    if name is None or name.upper() in ("UTC", "Z"):
        return UTC
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError) as problem:
        raise RigctlError(
            "unknown time zone",
            value=name,
            expected="a name such as Europe/Berlin, or UTC",
            nearest=nearest_name(name, available_timezones()),
            hint=None if available_timezones() else "This system has no time zones: pip install tzdata",
        ) from problem
