"""The times of a file as functions of its cells: what a cell means, and what its form is decided by."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from rigctl.dataset.importing import Options
from rigctl.dataset.importing.cells.times import (
    ArrayClock,
    TimeFormat,
    TimeReader,
    array_clock,
    epoch_of,
    find_format,
    instant,
)
from rigctl.errors import Location, RigctlError

PATH = Path("log.csv")
WHERE = Location(PATH, 1)


def found(*cells: str, unit: str | None = None, **options: str) -> TimeFormat:
    return find_format(cells, unit, Options(**options), PATH, WHERE)  # type: ignore[arg-type]


def read(form: TimeFormat, *cells: str | None) -> list[float | None]:
    """The times of cells in s since the first one or of the clock; None for an invalid one."""
    seconds, bad = TimeReader(form).read(pa.array(cells, pa.string()))
    return [None if wrong else value for value, wrong in zip(seconds.tolist(), bad.tolist(), strict=True)]


def moment(cell: str, order: str) -> str | None:
    """The moment that one cell stands for, UTC; None if it is refused."""
    reader = TimeReader(TimeFormat("date", order=order))
    _, bad = reader.read(pa.array([cell]))
    if bad[0] or reader.origin is None:
        return None
    return instant(reader.origin, None).replace(tzinfo=None).isoformat()


@pytest.mark.parametrize(
    ("cell", "order", "when"),
    [
        ("1.2.69", "dmy", "2069-02-01T00:00:00"),
        ("1.2.70", "dmy", "1970-02-01T00:00:00"),
        ("1.2.99", "dmy", "1999-02-01T00:00:00"),
        ("1.2.00", "dmy", "2000-02-01T00:00:00"),
        ("1.2.100", "dmy", None),
        ("2.1.1999", "mdy", "1999-02-01T00:00:00"),
        ("1.1.1678", "dmy", "1678-01-01T00:00:00"),
        ("31.12.1677", "dmy", None),
        ("31.12.2261", "dmy", "2261-12-31T00:00:00"),
        ("1.1.2262", "dmy", None),
        ("1.12.2026", "dmy", "2026-12-01T00:00:00"),
        ("1.13.2026", "dmy", None),
        ("1.0.2026", "dmy", None),
        ("0.1.2026", "dmy", None),
        ("31.1.2026", "dmy", "2026-01-31T00:00:00"),
        ("31.4.2026", "dmy", None),
        ("29.2.2024", "dmy", "2024-02-29T00:00:00"),
        ("29.2.2026", "dmy", None),
        ("1-Jan-2026", "dmy", "2026-01-01T00:00:00"),
        ("1-December-2026", "dmy", "2026-12-01T00:00:00"),
        ("1-Foo-2026", "dmy", None),
        ("2026-03-04 23:59:59", "ymd", "2026-03-04T23:59:59"),
        ("2026/03/04 24:00:00", "ymd", None),
        ("2026/03/04 23:60:00", "ymd", None),
        ("2026/03/04 23:59:60", "ymd", "2026-03-05T00:00:00"),  # a leap second
        ("2026/03/04 23:59:61", "ymd", None),
        ("2026/03/04 12:30 am", "ymd", "2026-03-04T00:30:00"),
        ("2026/03/04 12:30 p.m.", "ymd", "2026-03-04T12:30:00"),
        ("2026/03/04 1:30 PM", "ymd", "2026-03-04T13:30:00"),
        ("2026/03/04 11:30 AM", "ymd", "2026-03-04T11:30:00"),
        ("2026/03/04 12:00+01", "ymd", "2026-03-04T11:00:00"),
        ("2026/03/04 12:00-0130", "ymd", "2026-03-04T13:30:00"),
        ("2026/03/04 12:00 UTC", "ymd", "2026-03-04T12:00:00"),
        ("2026/03/04 12:00:00,25", "ymd", "2026-03-04T12:00:00.250000"),
        ("2026/03/04 12:00:00.0000019999", "ymd", "2026-03-04T12:00:00.000001"),
        ("20260304", "ymd", "2026-03-04T00:00:00"),
        ("20260304 0102", "ymd", "2026-03-04T01:02:00"),
    ],
)
def test_a_cell_is_a_moment_or_is_refused(cell: str, order: str, when: str | None) -> None:
    assert moment(cell, order) == when


@pytest.mark.parametrize(
    ("cells", "order"),
    [
        (("13/12/2026",), "dmy"),
        (("12/13/2026",), "mdy"),
        (("01/02/2026", "13/02/2026"), "dmy"),
        (("01/02/2026", "01/13/2026"), "mdy"),
        (("12/11/2026",), None),
        (("13/13/2026",), None),
        (("12.12.2026",), "dmy"),
        (("2026/13/12",), "ymd"),
        (("12/Mar/2026", "13/Apr/2026"), "dmy"),
        (("12/Mar/2026", "13/04/2026"), "dmy"),
    ],
)
def test_the_order_of_a_date_is_decided_by_a_number_above_twelve(
    cells: tuple[str, ...], order: str | None
) -> None:
    if order is None:
        with pytest.raises(RigctlError, match="day and month cannot be told apart") as caught:
            found(*cells)
        day, month, _ = cells[0].split("/")
        assert f"day-first (day {day}, month {month})" in str(caught.value)
    else:
        assert found(*cells).order == order


def test_an_order_that_the_dates_contradict_is_refused() -> None:
    assert found("12/12/2026", dates="day-first").order == "dmy"
    assert found("12/12/2026", dates="month-first").order == "mdy"
    assert found("13/12/2026", dates="day-first").order == "dmy"
    for cell, dates in (("13/12/2026", "month-first"), ("12/13/2026", "day-first"), ("13/12/2026", "iso")):
        with pytest.raises(RigctlError):
            found(cell, dates=dates)


def test_a_clock_passes_midnight_only_by_a_step_back_of_more_than_half_a_day() -> None:
    clock = TimeFormat("clock")
    assert read(clock, "23:00:00", "01:00:00", "01:00:01") == [82800.0, 90000.0, 90001.0]
    assert read(clock, "13:00:00", "12:59:59", "13:00:01") == [46800.0, 46799.0, 46801.0]
    assert read(clock, "18:00:00", "06:00:00") == [64800.0, 21600.0]  # half a day back: out of order
    assert read(clock, "18:00:01", "06:00:00") == [64801.0, 108000.0]
    days = [f"{hour:02}:00:00" for _ in range(3) for hour in (0, 8, 16)]
    assert read(clock, *days) == [28800.0 * index for index in range(9)]


def test_a_clock_continues_from_one_part_of_a_file_to_the_next() -> None:
    reader = TimeReader(TimeFormat("clock"))
    parts = (["", None], ["23:59:59"], ["", "00:00:01"], ["00:00:02"])
    seconds = [reader.read(pa.array(part, pa.string()))[0] for part in parts]
    known = np.concatenate(seconds)
    assert known[~np.isnan(known)].tolist() == [86399.0, 86401.0, 86402.0]
    at_zero = TimeReader(TimeFormat("clock"))
    assert [float(at_zero.read(pa.array([cell]))[0][0]) for cell in ("00:00:00", "13:00:00")] == [
        0.0,
        46800.0,
    ]


def test_a_cell_that_is_no_time_of_day_is_refused_and_an_empty_one_is_missing() -> None:
    clock = TimeFormat("clock")
    assert read(clock, "1:59:59.5", "1:60:00", "1:00:60", "soon") == [7199.5, None, None, None]
    assert read(TimeFormat("clock", minutes=True), "90:30.25", "1:59", "1:60") == [5430.25, 119.0, None]
    seconds, bad = TimeReader(clock).read(pa.array(["12:00:00 am", " ", None]))
    assert seconds[0] == 0.0
    assert np.isnan(seconds[1:]).all()
    assert not bad.any()


@pytest.mark.parametrize(
    ("cells", "unit", "kind", "minutes"),
    [
        (("1:02:03",), None, "clock", False),
        (("1:02 pm",), None, "clock", False),
        (("1:02.5",), None, "clock", True),
        (("1:02,5",), None, "clock", True),
        (("1:02.5", "1:03"), None, "clock", True),
        (("1:02:03", "later"), None, "clock", False),
        (("1:02",), "min:s", "clock", True),
        (("1:02",), "h:min", "clock", False),
        (("1:02:03",), "min:s", "clock", False),
        (("0", "0.5"), None, "number", False),
        (("0,5", "1,5"), None, "number", False),
        (("1", "2", "late"), None, "number", False),
        (("1", "late", "later"), None, "number", False),
        (("1", "2", "2026-01-01"), None, "number", False),
        (("1", "2026-01-01"), None, "date", False),
        (("1", "2026-01-01", "2026-01-02"), None, "date", False),
        (("45000", "45001"), None, "number", False),  # s of a long test, and no days
        (("45000", "45001"), "s", "number", False),
        (("45000", "45001"), "day", "epoch", False),
        (("1775217600",), None, "epoch", False),
        (("1775217600",), "ms", "number", False),
        (("1775217600,5",), None, "epoch", False),
        ((), None, "number", False),
        (("", " "), None, "number", False),
    ],
)
def test_the_form_of_times_follows_from_their_cells_and_unit(
    cells: tuple[str, ...], unit: str | None, kind: str, minutes: bool
) -> None:
    form = found(*cells, unit=unit)
    assert (form.kind, form.minutes) == (kind, minutes)


def test_times_of_no_known_form_and_clocks_of_two_numbers_are_refused() -> None:
    with pytest.raises(RigctlError, match="hours and minutes, or minutes and seconds"):
        found("1:02", "1:03")
    with pytest.raises(RigctlError, match="neither numbers nor dates"):
        found("soon", "later")
    with pytest.raises(RigctlError):
        found("2026-01-01", zone="Europe/Nowhere")


def test_only_dates_without_a_zone_are_naive() -> None:
    assert found("2026-01-01 12:00").naive
    assert not found("2026-01-01 12:00", "2026-01-01 12:00Z").naive
    assert not found("20260101T120000Z").naive


@pytest.mark.parametrize(
    ("cells", "epoch", "decimal"),
    [
        (("1775217600", "1775217601"), (10**9, 0), "."),
        (("1775217600", "1775217600.5"), (10**9, 0), "."),
        (("1775217600", "1775217600,5"), (10**9, 0), ","),
        (("3858062400",), (10**9, -2_082_844_800), "."),
        (("1775217600000",), (10**6, 0), "."),
    ],
)
def test_counts_since_an_epoch_have_its_scale_and_their_decimal_sign(
    cells: tuple[str, ...], epoch: tuple[int, int], decimal: str
) -> None:
    form = found(*cells)
    assert (form.kind, form.epoch, form.decimal) == ("epoch", epoch, decimal)
    reader = TimeReader(form)
    reader.read(pa.array(cells))
    assert reader.origin == 1775217600 * 10**9


@pytest.mark.parametrize(
    ("form", "absolute", "example"),
    [
        (TimeFormat("epoch"), True, "a count since an epoch"),
        (TimeFormat("clock"), False, "a time such as 14:05:30"),
        (TimeFormat("clock", minutes=True), False, "a time such as 01:30.5"),
        (TimeFormat("date"), True, "a date and time such as 2026-03-21 14:05:30"),
        (TimeFormat("date", order="dmy"), True, "a date and time such as 21.03.2026 14:05:30"),
        (TimeFormat("date", order="mdy"), True, "a date and time such as 03/21/2026 14:05:30"),
    ],
)
def test_the_example_in_a_message_is_of_the_form_itself(
    form: TimeFormat, absolute: bool, example: str
) -> None:
    assert (form.absolute, form.expected) == (absolute, example)
    assert not TimeFormat("number").absolute
    if form.kind != "epoch":
        again = found(example.removeprefix("a date and time such as ").removeprefix("a time such as "))
        assert (again.kind, again.order, again.minutes) == (form.kind, form.order, form.minutes)


DAY = 86400 * 10**9


@pytest.mark.parametrize(
    ("values", "unit", "epoch"),
    [
        ((6.3e8, 2.9e9), None, ("s", 10**9, 0)),
        ((6.29e8,), None, None),
        ((2.91e9,), None, None),
        ((3.0e9, 4.5e9), None, ("s", 10**9, -2_082_844_800)),
        ((2.9e9, 3.0e9), None, None),  # no single epoch fits both
        ((4.51e9,), None, None),
        ((7.531e5,), "day", None),
        ((1.7e9,), "K", None),
        ((6.3e11, 2.9e12), "ms", ("ms", 10**6, 0)),
        *(((value,), None, None) for value in (6.29e11, 2.91e12, 6.29e14, 2.91e15, 6.29e17, 2.91e18)),
        ((6.3e14, 2.9e15), None, ("us", 10**3, 0)),
        ((6.3e17, 2.9e18), None, ("ns", 1, 0)),
        ((32874.0, 58000.0), "day", ("day", DAY, -25569)),
        ((32873.0,), "day", None),
        ((58001.0,), "day", None),
        ((7.26e5, 7.53e5), "day", ("day", DAY, -719529)),
        ((7.26e5,), None, None),
        ((45000.0,), "K", None),
        ((45000.0,), "furlongs", None),
        ((), None, None),
    ],
)
def test_a_count_is_one_since_an_epoch_only_within_its_years_and_unit(
    values: tuple[float, ...], unit: str | None, epoch: tuple[str, int, int] | None
) -> None:
    assert epoch_of(values, unit) == epoch


def test_counts_keep_every_digit_and_may_have_a_sign_or_a_power_of_ten() -> None:
    seconds = TimeFormat("epoch")
    assert read(seconds, "1775217600", "1775217600.000000001", "+1775217601", "1.7752176e9", "x") == [
        0.0,
        1e-9,
        1.0,
        0.0,
        None,
    ]
    assert read(TimeFormat("epoch", decimal=","), "1775217600,25", "1775217600,75", "1775217600.5") == [
        0.0,
        0.5,
        None,
    ]
    reader = TimeReader(seconds)
    reader.read(pa.array(["1775217600.25"]))
    assert reader.origin == 1775217600_250_000_000
    days = TimeFormat("epoch", epoch=(DAY, -25569))
    assert read(days, "46115.5", "46115.75", "4.61165e4") == [0.0, 21600.0, 86400.0]
    assert read(TimeFormat("epoch", epoch=(1, 0)), "9223372036854775806", "9999999999999999999") == [
        0.0,
        1e-9,
    ]


def test_time_stamps_and_counts_in_arrays_start_at_their_earliest() -> None:
    stamps = np.array(["2026-01-01T00:00:01", "NaT", "2026-01-01T00:00:00"], "datetime64[us]")
    clock = array_clock([stamps[:0], stamps], None)
    assert clock == ArrayClock(int(datetime(2026, 1, 1, tzinfo=UTC).timestamp()) * 10**9)
    np.testing.assert_array_equal(clock.seconds(stamps), [1.0, np.nan, 0.0])
    counts = np.array([46115.5, np.nan, 46115.25])
    clock = array_clock([counts], "day")
    assert clock is not None
    assert instant(clock.origin, None) == datetime(2026, 4, 3, 6, tzinfo=UTC)
    np.testing.assert_array_equal(clock.seconds(counts), [21600.0, np.nan, 0.0])
    none = np.full(2, "NaT", "datetime64[s]")
    for values in (np.array([0.0, 1.0]), np.array(["a"]), none):
        assert array_clock([values], None) is None
    assert array_clock([], None) is None
    assert array_clock([stamps, counts], None) is None
    assert array_clock([counts, np.array(["a"])], "day") is None
    assert array_clock([stamps[:0], counts], "day") == clock


def test_an_instant_is_shown_in_its_zone() -> None:
    noon = int(datetime(2026, 7, 1, 12, tzinfo=UTC).timestamp()) * 10**9
    assert instant(noon + 1999, "Europe/Berlin").isoformat() == "2026-07-01T14:00:00.000001+02:00"
    assert instant(noon, None).utcoffset() == timedelta(0)


def test_dates_with_and_without_separators_may_stand_in_one_file() -> None:
    assert read(TimeFormat("date"), "2026/03/04", "20260305", "4 March") == [0.0, 86400.0, None]
    mixed = ("1-Jan-2026", "2-2-2026", "3-March-2026")
    assert read(TimeFormat("date", order="dmy"), *mixed) == [0.0, 32 * 86400.0, 61 * 86400.0]
    assert read(TimeFormat("date"), "2026/03/04 1:00 pm", "2026/03/04 14:00") == [0.0, 3600.0]


def test_seconds_count_from_the_first_time_of_all_parts_even_where_that_is_the_epoch() -> None:
    for form, cells in (
        (TimeFormat("date", naive=True), ["1970-01-01", None, "1970-01-01 00:00:01"]),
        (TimeFormat("date"), ["1970/01/01", "no", "1970/01/01 00:00:01"]),
        (TimeFormat("epoch"), ["0", "", "1"]),
        (TimeFormat("date", naive=True), ["2026-01-01", "2026-01-01 00:00:00.5", "2026-01-01 00:00:01"]),
    ):
        assert read(form, *cells)[::2] == [0.0, 1.0]
        reader = TimeReader(form)
        parts = [reader.read(pa.array([cell], pa.string()))[0][0] for cell in cells]
        assert parts[::2] == [0.0, 1.0]


@pytest.mark.parametrize("naive", [True, False])
def test_times_without_a_zone_are_local_and_those_with_one_are_not(naive: bool) -> None:
    form = TimeFormat("date", zone="Europe/Berlin", naive=naive)
    reader = TimeReader(form)
    seconds, _ = reader.read(pa.array(["2026-07-01 12:00", "2026-12-01 12:00"]))
    assert reader.origin == int(datetime(2026, 7, 1, 10, tzinfo=UTC).timestamp()) * 10**9
    assert seconds[1] == (153 * 24 + 1) * 3600.0
    mixed = read(form, "2026-07-01 12:00", "2026-07-01 12:00Z", "2026-07-01 12:00-01:00", "2026-07-01 13:00")
    assert mixed == [0.0, 7200.0, 10800.0, 3600.0]


def test_a_time_with_a_zone_between_local_ones_does_not_break_their_order() -> None:
    """The hour after the end of summer time is there twice; a step back by 45 minutes begins it again."""
    form = TimeFormat("date", zone="Europe/Berlin")
    cells = [f"2026-10-25 {clock}" for clock in ("02:50", "00:55Z", "02:05")]
    assert read(form, *cells) == [0.0, 300.0, 900.0]
    assert read(form, cells[0], "soon", cells[2]) == [0.0, None, 900.0]
