"""Limits, impossible values, rates and silence, as pure functions of rows."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.rig import Limit, Rig, load_rig, parse_rig
from rigctl.runner.interlocks import REARM, Alarm, Interlocks

SHIPPED = load_rig(Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml")
HOT, WARM, PRESSURE, POSITION = 364.0, 293.15, 20e5, 0.05


@pytest.fixture
def rig(workshop: Any) -> Rig:
    rig: Rig = workshop.rig()
    return rig


def row(
    time: float, oil: float = WARM, pressure: float = PRESSURE, position: float = POSITION
) -> tuple[float, ...]:
    return (time, -1.0, oil, pressure, position, 0.0, 0.0, 20e5)


def feed(locks: Interlocks, rows: Sequence[tuple[float, ...]]) -> list[Alarm]:
    return [alarm for item in rows for alarm in locks.check(item)]


def test_a_bench_within_limits_raises_no_alarm(rig: Rig) -> None:
    assert feed(Interlocks(rig), [row(0.01 * i) for i in range(1000)]) == []


def test_a_limit_trips_once_after_its_persistence(rig: Rig) -> None:
    alarms = feed(Interlocks(rig), [row(0.1 * i, pressure=61e5) for i in range(50)])
    assert [(a.name, a.action, a.active) for a in alarms] == [("over_pressure", "stop", True)]
    assert alarms[0].time == pytest.approx(0.1)  # the first sample at least 50 ms after the first one outside
    assert alarms[0].message == "Supply over-pressure: supply_pressure is 61 bar, above the limit of 60 bar"


def test_single_samples_outside_a_limit_do_not_trip_it(rig: Rig) -> None:
    locks = Interlocks(rig)
    rows = [row(0.1 * i, pressure=61e5 if i % 4 == 3 else 30e5) for i in range(50)]
    assert [alarm for alarm in feed(locks, rows) if alarm.action == "stop"] == []


def test_a_limit_trips_where_every_second_sample_is_outside(rig: Rig) -> None:
    """The pressure swings about its limit, or one sensor in two is believed: neither is within the limit."""
    rows = [row(0.01 * i, pressure=61e5 if i % 2 else 30e5) for i in range(50)]
    alarms = [alarm for alarm in feed(Interlocks(rig), rows) if alarm.action == "stop"]
    assert [alarm.name for alarm in alarms] == ["over_pressure"]
    assert alarms[0].time <= 0.15  # 50 ms in total within 100 ms
    assert "in 5 of the last" in alarms[0].message or "in 6 of the last" in alarms[0].message


@pytest.mark.parametrize("impossible", [math.nan, math.inf, -math.inf, 1e8, -6e33])
@pytest.mark.parametrize("every", [2, 3, 4])
@pytest.mark.parametrize("rate", [2.0, 10.0, 100.0])
def test_an_intermittent_sensor_does_not_blind_its_limit(
    rig: Rig, impossible: float, every: int, rate: float
) -> None:
    locks = Interlocks(rig)
    rows = [
        row(i / rate, pressure=impossible if i % every == 0 else 61e5) for i in range(1, int(20.0 * rate))
    ]
    stops = [alarm for alarm in feed(locks, rows) if alarm.action == "stop"]
    assert stops[0].name == "over_pressure"
    assert stops[0].time <= max(0.15, 4.0 / rate)


def test_a_reading_beyond_all_that_is_possible_exceeds_the_limit_before_it(rig: Rig) -> None:
    """That it may be the sensor is no reason to wait longer than for a smaller excess."""
    high = rig.channels["supply_pressure"].band[1] + 1e5
    alarms = feed(Interlocks(rig), [row(0.01 * i, pressure=high) for i in range(10)])
    assert [alarm.name for alarm in alarms] == ["over_pressure"]
    assert alarms[0].time == pytest.approx(0.05)
    assert alarms[0].message.endswith("; that is impossible, the sensor or its line may be broken")


@pytest.mark.parametrize("every", [2, 3, 4])
@pytest.mark.parametrize("rate", [0.5, 2.0, 10.0, 100.0])
def test_a_sensor_that_fails_again_and_again_is_broken(rig: Rig, every: int, rate: float) -> None:
    """One plausible reading in between does not make it whole."""
    rows = [row(i / rate, oil=WARM if i % every else math.nan) for i in range(1, int(60.0 * rate))]
    alarms = [alarm for alarm in feed(Interlocks(rig), rows) if alarm.action == "stop"]
    assert [alarm.name for alarm in alarms] == ["oil_temperature sensor"]
    assert alarms[0].time <= max(5.0 * rig.stale_after, 20.0 / rate)
    assert "gives no value: sensor or line broken, as in" in alarms[0].message


@pytest.mark.parametrize("stale_after", [0.5, 2.0])
def test_the_share_of_missing_readings_is_taken_over_five_times_the_limit_for_silence(
    stale_after: float,
) -> None:
    """A quarter of the readings is more than the fifth that a sensor may lack."""
    rows = [row(0.05 * i, oil=WARM if i % 4 else math.nan) for i in range(1, 1000)]
    locks = Interlocks(SHIPPED.model_copy(update={"stale_after": stale_after}))
    first = next(alarm for alarm in feed(locks, rows) if alarm.action == "stop")
    assert first.name == "oil_temperature sensor"
    assert 4.0 * 0.9 * stale_after <= first.time <= 5.0 * stale_after


def test_a_reading_that_fails_now_and_then_is_no_broken_sensor(rig: Rig) -> None:
    rows = [row(0.1 * i, oil=WARM if i % 8 else math.nan) for i in range(1, 600)]
    assert feed(Interlocks(rig), rows) == []


def test_a_limit_without_a_break_asks_for_it(rig: Rig) -> None:
    text = rig.text.replace("for: 50 ms", "for: 50 ms\n    out_of: 50 ms")
    assert text != rig.text
    rows = [row(0.02 * i, pressure=30e5 if i % 3 == 2 else 61e5) for i in range(500)]
    assert "over_pressure" in [alarm.name for alarm in feed(Interlocks(rig), rows)]
    alarms = feed(Interlocks(parse_rig(text)), rows)
    assert [alarm.name for alarm in alarms if alarm.action == "stop"] == []


def test_the_time_in_which_a_limit_adds_up_is_no_shorter_than_the_time_that_it_takes(rig: Rig) -> None:
    with pytest.raises(RigctlError, match="'out_of' is the time in which 'for' has to add up"):
        parse_rig(rig.text.replace("for: 50 ms", "for: 50 ms\n    out_of: 20 ms"))


def test_rounding_of_times_does_not_delay_the_end_of_the_persistence(rig: Rig) -> None:
    assert 0.95 - 0.9 < 0.05
    alarms = feed(Interlocks(rig), [row(0.9, pressure=61e5), row(0.95, pressure=61e5)])
    assert [alarm.time for alarm in alarms] == [0.95]


def test_missing_values_do_not_reset_the_persistence_of_a_limit(rig: Rig) -> None:
    rows = [row(0.01 * i, pressure=math.nan if i % 2 else 61e5) for i in range(20)]
    assert [alarm.name for alarm in feed(Interlocks(rig), rows)] == ["over_pressure"]


def test_an_alarm_that_recurs_is_cleared_only_after_its_last_cause(rig: Rig) -> None:
    locks = Interlocks(rig)
    warm = 273.15 + 86.0
    raised = feed(locks, [row(0.5 * i, oil=warm if i < 10 or i == 20 else WARM) for i in range(60)])
    assert [(alarm.time, alarm.active) for alarm in raised] == [(2.0, True), (10.5 + REARM, False)]


@pytest.mark.parametrize(
    ("at_the_trip", "in_cleanup", "trips"), [(1.0, 1.0, True), (1.0, 0.0, False), (0.0, 1.0, False)]
)
def test_a_tripped_limit_trips_again_while_the_output_that_was_on_drives_past_it(
    rig: Rig, at_the_trip: float, in_cleanup: float, trips: bool
) -> None:
    """An output that was off may be a pump that cools, whose effect the sensor shows only later."""
    locks = Interlocks(rig)
    rows = [
        (0.1 * i, -1.0, HOT + 0.01 * i, PRESSURE, POSITION, in_cleanup if i > 7 else at_the_trip, 0.0, 20e5)
        for i in range(300)
    ]
    alarms = [alarm for alarm in feed(locks, rows) if alarm.name == "oil_too_hot"]
    assert [alarm.active for alarm in alarms] == [True] * len(alarms)
    again = [alarm.time for alarm in alarms[1:]]
    assert again[:1] == ([pytest.approx(0.6 + 10.0, abs=0.3)] if trips else [])
    assert all("does not return while an output is on again" in alarm.message for alarm in alarms[1:])


@pytest.mark.parametrize("bound", ["above", "below"])
@pytest.mark.parametrize(("drift", "trips"), [(-2e3, False), (0.0, True), (2e3, True)])
def test_a_reading_beyond_its_limit_has_to_come_nearer_to_it_and_not_stay(
    bound: str, drift: float, trips: bool
) -> None:
    """`drift` is away from the limit, Pa/s, while the output that was on at the trip stays on."""
    sign = 1.0 if bound == "above" else -1.0
    limits = {
        action: Limit.model_validate({"channel": "supply_pressure", bound: at, "action": action})
        for action, at in (("stop", "40 bar"), ("warn", "35 bar" if bound == "above" else "45 bar"))
    }
    locks = Interlocks(SHIPPED.model_copy(update={"limits": limits}))
    rows = [(0.125 * i, -1.0, WARM, 40e5 - sign * 3e5, POSITION, 0.0, 0.0, 20e5) for i in range(9)]
    rows += [
        (time, -1.0, WARM, 40e5 + sign * (1e5 + drift * time), POSITION, 1.0, 0.0, 20e5)
        for time in (0.125 * i for i in range(9, 200))
    ]
    alarms = feed(locks, rows)
    assert [(alarm.name, alarm.time) for alarm in alarms[:2]] == [("warn", 0.0), ("stop", 1.125)]
    assert [alarm.time for alarm in alarms[2:3]] == ([pytest.approx(11.25, abs=0.2)] if trips else [])


@pytest.mark.parametrize(
    ("safe", "at_the_trip", "in_cleanup", "trips"),
    [
        (0.0, 1.0, 1.0, True),
        (0.0, 1.0, -1.0, False),
        (0.0, -1.0, 1.0, False),
        (0.5, 1.0, 0.75, True),
        (0.5, 1.0, -1.0, False),
        (0.5, 0.25, 0.75, False),
        (0.5, 0.25, 0.0, True),
        (0.5, 0.25, 0.5, False),
    ],
)
def test_an_output_on_the_other_side_of_its_safe_value_may_drive_back(
    safe: float, at_the_trip: float, in_cleanup: float, trips: bool
) -> None:
    """The valve that extends at the trip and retracts in cleanup, while the reading does not follow yet."""
    safe_state = {**SHIPPED.safe_state, "valve": safe}
    locks = Interlocks(SHIPPED.model_copy(update={"safe_state": safe_state}))
    rows = [
        (0.1 * i, -1.0, WARM, 61e5, POSITION, 0.0, in_cleanup if i > 7 else at_the_trip, 20e5)
        for i in range(200)
    ]
    alarms = [alarm for alarm in feed(locks, rows) if alarm.name == "over_pressure"]
    assert (len(alarms) > 1) is trips


def test_a_tripped_limit_lets_an_output_drive_back_to_it(rig: Rig) -> None:
    locks = Interlocks(rig)
    rows = [(0.1 * i, -1.0, WARM, PRESSURE, 0.248 - 2e-5 * i, 0.0, -1.0, 20e5) for i in range(300)]
    assert [alarm.name for alarm in feed(locks, rows) if alarm.action == "stop"] == ["over_travel"]


def test_a_warning_is_cleared_when_its_cause_has_been_gone_long_enough(rig: Rig) -> None:
    locks = Interlocks(rig)
    warm = 273.15 + 86.0
    assert [a.name for a in feed(locks, [row(0.5 * i, oil=warm) for i in range(10)])] == ["oil_hot"]
    calm = feed(locks, [row(5.0 + 0.5 * i) for i in range(40)])
    assert [(a.name, a.active) for a in calm] == [("oil_hot", False)]
    assert calm[0].time == pytest.approx(5.0 + REARM)
    again = feed(locks, [row(30 + 0.5 * i, oil=warm) for i in range(10)])
    assert [a.active for a in again if a.name == "oil_hot"] == [True]


@pytest.mark.parametrize("value", [math.nan, 1296.9])
def test_a_broken_sensor_trips_after_the_time_limit_for_silence(rig: Rig, value: float) -> None:
    alarms = feed(Interlocks(rig), [row(0.1 * i, oil=value if i > 3 else WARM) for i in range(30)])
    impossible = [a for a in alarms if a.name == "oil_temperature sensor"]
    assert len(impossible) == 1
    assert impossible[0].time == pytest.approx(0.4 + rig.stale_after)
    assert "sensor or line broken" in impossible[0].message


def test_a_rate_limit_trips_on_the_rate_over_its_window(rig: Rig) -> None:
    slow = [row(0.01 * i, position=0.12 * 0.01 * i) for i in range(200)]
    assert feed(Interlocks(rig), slow) == []
    fast = [row(90.0 + 0.01 * i, position=0.9 * 0.01 * i) for i in range(25)]  # a run that has gone on
    alarms = feed(Interlocks(rig), fast)
    assert [a.name for a in alarms] == ["moves_too_fast"]
    assert 90.1 < alarms[0].time < 90.2
    assert "0.9 m/s" in alarms[0].message or "900 mm/s" in alarms[0].message


@pytest.mark.parametrize(("jump", "trips"), [(0.0095, False), (0.0105, True)])
def test_a_rate_is_taken_over_the_whole_window_and_no_more(jump: float, trips: bool) -> None:
    """A jump within 10 ms that is 0.095 or 0.105 m/s over 0.1 s."""
    limit = Limit.model_validate({"channel": "position", "rate_above": "100 mm/s", "over": "0.1 s"})
    locks = Interlocks(SHIPPED.model_copy(update={"limits": {"fast": limit}}))
    rows = [row(90.0 + 0.01 * i, position=0.05 + (jump if i > 50 else 0.0)) for i in range(100)]
    assert bool(feed(locks, rows)) is trips


def test_no_rate_is_computed_before_half_of_its_window(rig: Rig) -> None:
    """2 m/s for 20 ms: the rate over at least half a window exceeds the limit for only 16 ms."""
    rows = [row(0.001 * i, position=0.05 + 0.002 * min(i, 20)) for i in range(300)]
    assert feed(Interlocks(rig), rows) == []


def test_a_rate_is_known_where_samples_are_further_apart_than_its_window() -> None:
    """Read at 10 Hz by a clock that is 1 % slow, over a window of 0.1 s."""
    rows = [row(0.101 * i, position=0.07 * i) for i in range(4)]
    assert [a.name for a in feed(Interlocks(SHIPPED), rows)] == ["moves_too_fast"]
    slow = [row(2.0 * i, position=0.12 * (i % 2)) for i in range(8)]
    assert feed(Interlocks(SHIPPED), slow) == []


def test_quantisation_noise_does_not_count_as_motion(rig: Rig) -> None:
    step = 0.00029325513
    rows = [row(0.01 * i, position=0.05 + step * (i % 3)) for i in range(500)]
    assert feed(Interlocks(rig), rows) == []


def test_arming_is_refused_without_waiting_for_persistence(rig: Rig) -> None:
    locks = Interlocks(rig)
    rows = [row(0.1 * i, oil=HOT) for i in range(3)]
    assert [alarm.name for alarm in locks.check_arming(rows)] == ["oil_too_hot"]
    assert locks.check_arming([row(0.0, oil=HOT), row(0.1)]) == []
    assert [a.name for a in locks.check_arming([row(0.0, position=math.nan)])] == ["position sensor"]
    loose = [row(0.1 * i, oil=HOT if i % 2 else math.nan) for i in range(5)]
    assert {a.name for a in locks.check_arming(loose)} == {"oil_temperature sensor", "oil_too_hot"}


def test_silence_trips_once_and_again_after_samples_resume(rig: Rig) -> None:
    locks = Interlocks(rig)
    assert locks.check_silence(0.9, 0.0, 0.1) is None
    alarm = locks.check_silence(1.0, 0.0, 0.1)
    assert alarm is not None
    assert alarm.action == "stop"
    assert "no sample for 1 s" in alarm.message
    assert locks.check_silence(2.0, 0.0, 0.1) is None
    locks.check(row(3.0))
    assert locks.check_silence(4.5, 3.0, 0.1) is not None


def test_a_slow_rate_does_not_count_as_silence(rig: Rig) -> None:
    assert Interlocks(rig).check_silence(25.0, 0.0, 10.0) is None
    assert Interlocks(rig).check_silence(30.0, 0.0, 10.0) is not None


@given(st.lists(st.floats(0.0, 0.24), min_size=1, max_size=60), st.floats(278.2, 357.0))
def test_values_within_all_limits_never_trip(positions: list[float], oil: float) -> None:
    # 10 s apart: even the whole stroke is slow
    rows = [row(10.0 * i, oil=oil, position=x) for i, x in enumerate(positions)]
    assert [alarm for alarm in feed(Interlocks(SHIPPED), rows) if alarm.action == "stop"] == []


@given(st.lists(st.sampled_from([20e5, 60e5, 61e5, -1e5, 105e5, math.nan]), min_size=1, max_size=80))
def test_the_fast_and_the_full_check_agree(pressures: list[float]) -> None:
    fast, thorough = Interlocks(SHIPPED), Interlocks(SHIPPED)
    for i, pressure in enumerate(pressures):
        thorough._groups[""].busy = True
        item = row(0.03 * i, pressure=pressure)
        assert list(fast.check(item)) == list(thorough.check(item))


def test_noise_on_a_line_is_detected_and_motion_is_not_taken_for_it() -> None:
    sawtooth = (i % 100 if i % 200 < 100 else 100 - i % 100 for i in range(999))
    strokes = [row(0.01 * i, position=0.12 * 0.01 * step) for i, step in enumerate(sawtooth)]
    assert feed(Interlocks(SHIPPED), strokes) == []
    chance = random.Random(1)
    shaken = [row(0.01 * i, position=0.1 + 0.05 * chance.random()) for i in range(100)]
    alarms = [alarm for alarm in feed(Interlocks(SHIPPED), shaken) if alarm.name == "position noise"]
    assert [(alarm.action, alarm.active) for alarm in alarms] == [("warn", True)]


@pytest.mark.parametrize(("times", "reported"), [(5.0, False), (16.0, True)])
def test_noise_of_more_than_ten_times_the_stated_one_is_reported(times: float, reported: bool) -> None:
    channel = SHIPPED.channels["supply_pressure"]
    spread, chance = times * math.hypot(channel.noise_level, channel.resolution), random.Random(2)
    rows = [row(0.01 * i, pressure=30e5 + chance.gauss(0.0, spread)) for i in range(200)]
    alarms = feed(Interlocks(SHIPPED), rows)
    assert [alarm.name for alarm in alarms[:1]] == (["supply_pressure noise"] if reported else [])


def zigzag(*counts: int) -> list[float]:
    """The times of the warnings where the pressure zigzags for some samples, rests for some, and so on."""
    swings = [index % 2 if phase % 2 == 0 else 0 for phase, n in enumerate(counts) for index in range(n)]
    rows = [row(float(time), pressure=20e5 + 5e5 * swing) for time, swing in enumerate(swings)]
    return [alarm.time for alarm in feed(Interlocks(SHIPPED), rows) if "noise" in alarm.name]


def test_noise_is_reported_once_more_than_half_of_32_samples_bend() -> None:
    """The first bend needs three samples, and a swing that stays bends the two after it."""
    assert zigzag(19) == [18.0]
    assert zigzag(17, 100) == []
    assert zigzag(18, 100) == [18.0]


def test_noise_is_reported_again_only_after_32_samples_without_any() -> None:
    assert zigzag(40, 30, 40) == [18.0]
    assert zigzag(40, 60, 40) == [18.0, 117.0]


def standstill(safe: dict[str, float] | None = None, **fields: Any) -> Interlocks:
    """Interlocks of the shipped bench with a single limit: a standstill of the oil temperature."""
    limit = Limit.model_validate({"channel": "oil_temperature", "unchanged": "10 s", **fields})
    changed = {"limits": {"thermometer_stuck": limit}, "safe_state": {**SHIPPED.safe_state, **(safe or {})}}
    return Interlocks(SHIPPED.model_copy(update=changed))


def test_a_reading_that_stays_exactly_the_same_is_a_stuck_sensor() -> None:
    alarms = feed(standstill(message="Thermometer"), [row(float(i)) for i in range(30)])
    assert [(a.name, a.time, a.action, a.active) for a in alarms] == [
        ("thermometer_stuck", 10.0, "stop", True)
    ]
    assert alarms[0].message == "Thermometer: oil_temperature has read exactly 20 degC for 10 s: sensor stuck"
    moving = [row(float(i), oil=WARM + 0.25 * (i // 9 % 2)) for i in range(90)]
    assert feed(standstill(), moving) == []
    gaps = [row(float(i), oil=math.nan if i % 9 == 8 else WARM) for i in range(90)]
    assert [alarm.name for alarm in feed(standstill(), gaps)] == ["thermometer_stuck"]


def test_a_stuck_sensor_is_cleared_by_its_first_change_and_can_trip_again() -> None:
    rows = [row(float(i), oil=WARM if i < 15 else WARM + 1.0) for i in range(30)]
    found = [(a.time, a.active) for a in feed(standstill(action="warn"), rows)]
    assert found == [(10.0, True), (15.0, False), (25.0, True)]


def test_fewer_than_five_equal_readings_are_no_standstill() -> None:
    alarms = feed(standstill(), [row(20.0 * i) for i in range(6)])
    assert [alarm.time for alarm in alarms] == [80.0]  # the fifth


def test_a_standstill_counts_only_while_its_actuator_is_driven() -> None:
    heater = SHIPPED.layout.columns.index("heater")

    def heated(time: float) -> tuple[float, ...]:
        values = list(row(time))
        values[heater] = float(time >= 40.0)
        return tuple(values)

    alarms = feed(standstill(while_on="heater"), [heated(float(i)) for i in range(60)])
    assert [alarm.time for alarm in alarms] == [49.0]  # 10 s after the last reading with the heater off
    assert "while heater was on" in alarms[0].message
    on_when_safe = standstill({"heater": 1.0}, while_on="heater")
    found = [(a.time, a.active) for a in feed(on_when_safe, [heated(float(i)) for i in range(60)])]
    assert found == [(10.0, True), (40.0, False)]
