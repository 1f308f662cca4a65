"""Local times become the moments that the zone's own data say, in the hour that is there twice too."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from itertools import pairwise
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rigctl.dataset.importing.cells.local_time import LocalTime, zone_info
from rigctl.errors import RigctlError

BERLIN = "Europe/Berlin"
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
#: the ends of two summer times, UTC; the clock goes back by an hour, or by half of one
ENDS = {
    BERLIN: ("2026-10-25T01:00Z", "2027-10-31T01:00Z"),
    "Australia/Lord_Howe": ("2026-04-04T15:00Z", "2027-04-03T15:00Z"),
    "America/St_Johns": ("2026-11-01T04:30Z", "2027-11-07T04:30Z"),
}


def seconds(moment: datetime) -> int:
    return int((moment - EPOCH).total_seconds())


def clock(moment: datetime, zone: str) -> int:
    """What a clock on the wall shows, s since 1970."""
    return seconds(moment.astimezone(ZoneInfo(zone)).replace(tzinfo=UTC))


def read(local: list[int], zone: str, ends: list[int]) -> list[int]:
    """The moments of local times that are read in parts, s since 1970."""
    reader, found = LocalTime(zone), []
    for first, last in pairwise([0, *ends, len(local)]):
        part = np.array(local[first:last], dtype=np.int64)
        found += (part - reader.offsets(part, np.ones(len(part), bool))).tolist()
    return found


@pytest.mark.parametrize("zone", sorted(ENDS))
@given(
    step=st.sampled_from([1, 7, 60, 300, 900, 1200, 1800]),
    before=st.integers(2, 39),  # of two rows alone nobody knows their step
    late=st.integers(0, 1800),
    ends=st.lists(st.integers(1, 79), max_size=4, unique=True).map(sorted),
)
@example(step=900, before=10, late=0, ends=[9, 10, 11, 12])
@settings(max_examples=40)
def test_regular_rows_are_the_moments_at_which_they_were_written(
    zone: str, step: int, before: int, late: int, ends: list[int]
) -> None:
    """Forty rows of each of two autumns in one file, the first of them in summer time."""
    moments = [
        datetime.fromisoformat(end) + timedelta(seconds=late % step + step * (k - before))
        for end in ENDS[zone]
        for k in range(40)
    ]
    local = [clock(one, zone) for one in moments]
    assert read(local, zone, ends) == [seconds(one) for one in moments]


@pytest.mark.parametrize("zone", ["UTC", "Asia/Kathmandu", "America/New_York", "Europe/London"])
def test_times_without_a_repeated_hour_have_the_zones_offset(zone: str) -> None:
    moments = [datetime(2026, month, 15, 12, 34, 56, tzinfo=UTC) for month in range(1, 13)]
    local = [clock(one, zone) for one in moments]
    assert read(local, zone, []) == [seconds(one) for one in moments]


def berlin(*times: str, ends: tuple[int, ...] = ()) -> list[str]:
    """The moments of times of 2026-10-25 unless they have another date, UTC."""
    local = [seconds(datetime.fromisoformat(f"2026-10-25 {one}Z"[-20:])) for one in times]
    return [(EPOCH + timedelta(seconds=one)).strftime("%H:%M:%S") for one in read(local, BERLIN, list(ends))]


def test_a_row_out_of_order_does_not_begin_the_second_hour_and_a_long_step_back_does() -> None:
    assert berlin("02:30:00", "02:29:00", "02:31:00") == ["00:30:00", "00:29:00", "00:31:00"]
    assert berlin("02:40:00", "02:10:00", "02:20:00") == ["00:40:00", "01:10:00", "01:20:00"]
    assert berlin("02:40:00", "02:10:01") == ["00:40:00", "00:10:01"]  # less than half of the hour
    # steps of 50 minutes: half of it is no measure
    assert berlin("01:10:00", "02:00:00", "02:50:00", "02:40:00") == [
        "23:10:00",
        "00:00:00",
        "00:50:00",
        "01:40:00",
    ]
    assert berlin("02:00:00", "02:50:00", "02:40:00", ends=(2,))[-1] == "01:40:00"
    assert berlin("02:00:00", "02:40:00", "02:20:00")[-1] == "01:20:00"
    assert (
        berlin("02:10:00", "02:30:00", "02:10:00")[-1] == "00:10:00"
    )  # of 20 minutes it would have one more
    assert berlin("02:00:00", "02:00:00") == ["00:00:00", "00:00:00"]  # a time twice is no step back
    assert berlin("01:00:00", "02:00:00", "02:00:00") == ["23:00:00", "00:00:00", "01:00:00"]


def test_each_part_continues_where_the_last_one_ended() -> None:
    times = ("02:40:00", "02:10:00", "02:20:00", "03:00:00")
    whole = ["00:40:00", "01:10:00", "01:20:00", "02:00:00"]
    for ends in ((), (1,), (2,), (3,), (1, 2, 3), (1, 1, 2)):
        assert berlin(*times, ends=ends) == whole
    long = ("01:10:00", "02:00:00", "02:50:00", "02:40:00")
    for ends in ((3,), (2, 3), (1, 2, 3)):
        assert berlin(*long, ends=ends)[-1] == "01:40:00"


def test_the_repeated_hour_of_another_record_begins_with_its_first() -> None:
    one = ("02:50:00", "02:10:00")
    for later in ("2027-10-31 02:05:00", "2025-10-26 02:05:00"):
        for ends in ((), (2,)):
            assert berlin(*one, later, ends=ends) == ["00:50:00", "01:10:00", "00:05:00"]
    assert berlin(*one, "03:10:00", "2027-10-31 02:05:00")[-1] == "00:05:00"
    assert berlin(*one, "01:59:59", "02:05:00")[-1] == "00:05:00"


def test_cells_without_a_local_time_are_left_out_of_the_order() -> None:
    reader = LocalTime(BERLIN)
    since = np.array([seconds(datetime(2026, 10, 25, 2, minute, tzinfo=UTC)) for minute in (50, 0, 5)])
    assert reader.offsets(since, np.array([True, False, True])).tolist() == [7200, 0, 3600]
    before = reader.state
    assert reader.offsets(since, np.zeros(3, bool)).tolist() == [0, 0, 0]
    assert reader.state == before
    assert reader.offsets(since[2:] + 60, np.ones(1, bool)).tolist() == [3600]


def test_time_stamps_become_utc_to_the_nanosecond() -> None:
    stamps = np.array(["2026-07-01T12:00:00.000000001", "NaT", "2026-12-01T12:00:00"], "datetime64[ns]")
    found = LocalTime(BERLIN).to_utc(stamps)
    expected = np.array(["2026-07-01T10:00:00.000000001", "NaT", "2026-12-01T11:00:00"], "datetime64[ns]")
    np.testing.assert_array_equal(found, expected)
    for zone in (None, "utc", "Z", "UTC"):
        assert LocalTime(zone).to_utc(stamps) is stamps
    after = np.array(["2026-10-25T03:00:00", "2026-03-29T03:00:00"], "datetime64[ns]")
    found = LocalTime(BERLIN).to_utc(after)
    np.testing.assert_array_equal(found, after - np.array([1, 2], "timedelta64[h]"))
    old = np.array(["1969-12-31T23:00:00.5"], "datetime64[ms]")
    np.testing.assert_array_equal(LocalTime("Asia/Tokyo").to_utc(old), old - np.timedelta64(9, "h"))


def test_an_unknown_zone_is_refused_with_the_nearest() -> None:
    with pytest.raises(RigctlError) as caught:
        zone_info("Europe/Berlim")
    assert "Europe/Berlin" in str(caught.value)
    assert "tzdata" not in str(caught.value)
    assert zone_info("z") is UTC
