"""The closed loop, against simulations of it that share no code with it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.cadence import Cadence
from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.planning import preview
from rigctl.rig import load_rig
from rigctl.steps.control.oscillation import OscillationDetector
from rigctl.steps.control.pid import AntiWindup, Bounds, Gains, Pid
from rigctl.testing import RunLog, VirtualBench

HEATERS = shipped("rigs", "heater-board.yaml")
#: the channel follows the level with this time constant, gain 1, s
LAG = 0.2
BAR = 1e5


@pytest.fixture
def press(tmp_path: Path) -> Callable[..., RunLog]:
    """Control the pressure of a bench that is a first-order lag, in a record."""
    rig = load_rig(shipped("rigs", "oil-circuit-modbus.yaml"))
    bench = VirtualBench(tmp_path, options={"plant": "roles", "noise": "off", "quantised": "off"})

    def run(fields: str, before: str = "", rate: int = 100, **more: object) -> RunLog:
        loop = f"actuator: relief_valve, channel: supply_pressure, rate: {rate} Hz, {fields}"
        record = f"  - record: {{name: loop, rate: {rate} Hz}}\n    do:\n      - control: {{{loop}}}\n"
        steps = f"steps:\n{before}{record}"
        return bench.run(steps, rig=rig, **more)  # type: ignore[arg-type]

    return run


def first_order(
    setpoint: float, gain: float, integral: float, high: float, count: int, period: float, track: float | None
) -> np.ndarray:
    """Readings under a PI controller in bar; without `track` its integral winds up."""
    pressure, inside, found = 0.0, 0.0, []
    kept = math.exp(-period / LAG)
    for index in range(count):
        found.append(pressure)
        error = setpoint - pressure
        wanted = gain * error + inside
        output = min(max(wanted, 0.0), high)
        if index:
            inside += integral * error * period
            inside += (output - wanted) * period / track if track else 0.0
        pressure = output + (pressure - output) * kept
    return np.array(found)


def test_the_integral_does_not_wind_up_while_the_output_is_limited(press: Callable[..., RunLog]) -> None:
    done = press("to: 40 bar, gain: 3, integral: 15 1/s, high: 50 bar, start: zero, for: 3 s")
    assert done.result.folder is not None
    record = open_run(done.result.folder).record(0)
    found = record.channels["supply_pressure"] / BAR
    begin = int(np.flatnonzero(found > 0.0)[0]) - 1
    found = found[begin : begin + 250]
    expected = first_order(40.0, 3.0, 15.0, 50.0, 250, 0.01, track=0.2)
    wound_up = first_order(40.0, 3.0, 15.0, 50.0, 250, 0.01, track=None)
    assert found == pytest.approx(expected, abs=1e-6)
    assert wound_up.max() > 44.0
    assert found.max() - 40.0 < 0.01 * (wound_up.max() - 40.0)
    assert record.measures["control_saturated"] > 0.0
    clamped = press(
        "to: 40 bar, gain: 3, integral: 15 1/s, high: 50 bar, start: zero, for: 3 s, anti_windup: clamping"
    )
    assert clamped.result.folder is not None
    again = open_run(clamped.result.folder).record(0).channels["supply_pressure"] / BAR
    assert again.max() - 40.0 < 0.5 * (wound_up.max() - 40.0)
    assert again[-1] == pytest.approx(40.0, abs=0.05)


def test_an_oscillating_loop_ends_with_outputs_safe(press: Callable[..., RunLog]) -> None:
    done = press("to: 30 bar, gain: 6, for: 20 s", rate=10)
    assert done.result.status == "failed"
    assert "the loop oscillates" in str(done.result.reason)
    assert "once in 0.2 s" in str(done.result.reason)
    assert done.commands("relief_valve")[-1][1] == 0.0
    assert done.result.duration < 6.0


def test_noise_and_decaying_ringing_are_not_oscillation() -> None:
    random = np.random.default_rng(3)
    noise, ringing = OscillationDetector(2.5), OscillationDetector(2.5)
    for index in range(20_000):
        time = index * 0.01
        assert noise.add(time, random.normal()) is None
        assert ringing.add(time, 100.0 * math.exp(-time / 4.0) * math.sin(6.0 * time)) is None
    lasting = OscillationDetector(2.5)
    found = [lasting.add(i * 0.01, 3.0 * math.sin(6.0 * i * 0.01)) for i in range(2000)]
    amplitude, period = next(one for one in found if one is not None)
    assert (amplitude, period) == (pytest.approx(3.0, rel=0.01), pytest.approx(math.pi / 3.0, rel=0.02))


@pytest.mark.parametrize("anti_windup", AntiWindup)
@pytest.mark.parametrize(
    ("gain", "integral", "ahead"), [(1e308, 1e308, 0.0), (1.0, 1.0, math.inf), (1e308, 0.0, -math.inf)]
)
def test_the_output_stays_within_limits_and_recovers_from_extreme_values(
    anti_windup: AntiWindup, gain: float, integral: float, ahead: float
) -> None:
    """Infinity minus infinity is NaN, which would stay in the integral once it got there."""
    gains = Gains(gain, integral, 0.0, 0.1, 1.0, anti_windup)
    loop = Pid(gains, Bounds(0.0, 100.0, math.inf), 0.0, bumpless=True)
    for k in range(20):
        assert 0.0 <= loop.update(0.1 * k, 20.0, 45.0, ahead) <= 100.0
    for k in range(20, 400):
        low = loop.update(0.1 * k, 90.0, 45.0, 0.0)
    assert low == 0.0


def updates(cadence: Cadence, times: np.ndarray, spacing: float) -> np.ndarray:
    return np.array([time for time in times if cadence.is_due(time, spacing)])


@given(st.integers(1, 8), st.floats(0.0, 0.45), st.floats(1e-3, 10.0), st.integers(0, 2**32 - 1))
def test_early_and_late_readings_cost_a_loop_no_update(
    every: int, jitter: float, period: float, seed: int
) -> None:
    """With `every` readings a period, each earlier or later by up to `jitter` of the time between two."""
    spacing, offsets = period / every, np.random.default_rng(seed).uniform(-jitter, jitter, 40 * every + 1)
    offsets[0] = 0.0  # the first one fixes the grid
    found = updates(Cadence(period), (np.arange(offsets.size) + offsets) * spacing, spacing)
    assert found == pytest.approx(np.arange(41) * period, abs=(jitter + 1e-9) * spacing)


@given(st.floats(1.0, 20.0), st.integers(0, 2**32 - 1))
def test_a_loop_keeps_its_rate_between_readings_that_do_not_divide_its_period(
    times: float, seed: int
) -> None:
    """What came of 20 Hz in a record of 30 Hz used to be 15."""
    phase = np.random.default_rng(seed).uniform(0.0, 1.0)
    found = updates(Cadence(1.0), (phase + np.arange(int(100 * times))) / times, 1.0 / times)
    assert found.size == pytest.approx(100, abs=1)
    assert np.abs(found - found[0] - np.arange(found.size)).max() <= 0.5 / times + 1e-9


@given(st.floats(0.0, 1.0), st.floats(0.0, 0.45), st.integers(0, 2**32 - 1))
def test_an_actuator_is_not_commanded_in_less_than_its_shortest_interval(
    shortest: float, jitter: float, seed: int
) -> None:
    times = np.arange(200) + np.random.default_rng(seed).uniform(-jitter, jitter, 200)
    found = updates(Cadence(1.0, shortest), times, 1.0)
    assert np.diff(found).min() >= shortest - 0.02


def test_after_a_gap_no_updates_are_made_up_for() -> None:
    times = np.array([0.0, 1.0, 2.0, 7.3, 8.2, 8.3, 9.3, 10.2, 10.3])
    assert updates(Cadence(1.0), times, 0.1).tolist() == [0.0, 1.0, 2.0, 7.3, 8.3, 9.3, 10.3]


def controller(
    bounds: Bounds, anti_windup: AntiWindup = AntiWindup.CLAMPING, gain: float = 0.0, integral: float = 1.0
) -> Pid:
    return Pid(Gains(gain, integral, 0.0, 0.1, 0.1, anti_windup), bounds, 0.5, bumpless=True)


def test_the_rate_limit_applies_to_rising_and_falling_outputs() -> None:
    loop = controller(Bounds(0.0, 10.0, 2.0), gain=1.0, integral=0.0)
    outputs = [loop.update(0.1 * k, 0.0, 5.0 if k < 10 else -5.0, 0.0) for k in range(20)]
    assert np.diff(outputs) == pytest.approx([0.2] * 9 + [-0.2] * 10)


@pytest.mark.parametrize("high", [True, False])
def test_a_clamped_integral_returns_from_the_limit(*, high: bool) -> None:
    """It is held only while it would drive the output further beyond the limit."""
    sign = 1.0 if high else -1.0
    loop = controller(Bounds(0.0, 1.0, math.inf))
    outputs = [loop.update(float(k), 0.0, sign * (0.3 if k < 5 else -0.3), 0.0) for k in range(9)]
    assert outputs[4] == (1.0 if high else 0.0)
    assert 0.0 < outputs[-1] < 1.0
    below = [loop.update(9.0 + k, 0.0, 0.0, 0.0) for k in range(3)]
    assert below[0] == below[-1], "with no error nothing moves"


def test_an_integral_that_would_overflow_keeps_its_value() -> None:
    for anti_windup in AntiWindup:
        loop = controller(Bounds(0.0, 1.0, math.inf), anti_windup, integral=1e300)
        setpoints = [1e20, 1e20, 0.0, 1e-301, 0.0]
        outputs = [loop.update(float(k), 0.0, setpoint, 0.0) for k, setpoint in enumerate(setpoints)]
        assert outputs[2:] == pytest.approx([0.5, 0.5, 0.6])


def test_back_calculation_in_a_late_update_does_not_overshoot_the_limit() -> None:
    """100 tracking times in one update: a first-order correction would be a hundred times too large."""
    loop = controller(Bounds(0.0, 1.0, math.inf), AntiWindup.BACK_CALCULATION)
    moved = ((0.0, 3.0), (1.0, 3.0), (2.0, 0.0), (12.0, 0.0), (12.1, 0.0))
    outputs = [loop.update(time, 0.0, setpoint, 0.0) for time, setpoint in moved]
    assert outputs == pytest.approx([0.5, 0.5, 1.0, 1.0, 1.0])


def test_the_loop_starts_without_a_bump_and_respects_the_rate_limit(press: Callable[..., RunLog]) -> None:
    before = "  - set: {relief_valve: 20 bar}\n  - wait: 3 s\n"
    done = press(
        "to: 30 bar, ramp: 10 bar/s, gain: 1, integral: 5 1/s, derivative: 0.01 s, max_rate: 15 bar/s, "
        "for: 4 s",
        before,
    )
    given = [(t, v / BAR) for t, v in done.commands("relief_valve") if v > 0.0]
    times, values = (np.array(column) for column in zip(*given[1:], strict=True))
    assert values[0] == pytest.approx(20.0, abs=0.2)
    assert np.abs(np.diff(values) / np.diff(times)).max() <= 15.0 * (1.0 + 1e-6)
    assert values[-1] == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize(
    ("fields", "before", "cancelled"),
    [
        ("to: 30 bar, gain: 1, integral: 5 1/s", 0, True),
        ("to: 30 bar, gain: 1, integral: 5 1/s, start: zero", 0, False),
        ("to: 30 bar, gain: 1, integral: 5 1/s, ramp: 10 bar/s", 0, False),
        ("to: 1 bar, gain: 1, integral: 5 1/s", 0, False),
        ("to: 30 bar, gain: 1", 0, False),
        ("to: 30 bar, gain: 1, integral: 5 1/s", 20, False),  # an operating point is kept
    ],
)
def test_a_bumpless_start_that_cancels_a_large_step_says_so(
    press: Callable[..., RunLog], fields: str, before: int, *, cancelled: bool
) -> None:
    done = press(
        f"{fields}, for: 1 s", f"  - set: {{relief_valve: {before} bar}}\n  - wait: 3 s\n" * (before > 0)
    )
    told = [one for one in done.messages("note") if "bumpless" in one]
    assert len(told) == cancelled
    if cancelled:
        assert told[0].startswith("start: bumpless cancels a step of 30 bar of 'relief_valve'")
        assert told[0].endswith("'start: zero' makes this step")


def heat(tmp_path: Path, fields: str, before: str = "", **options: object) -> RunLog:
    text = f"{before}  - control: {{actuator: heater_1, channel: temperature_1, rate: 1 Hz, {fields}}}\n"
    return VirtualBench(tmp_path, HEATERS).run(f"steps:\n{text}", options=options)


def test_feed_forward_from_a_model_removes_the_remaining_error(tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    model.write_text("parameters:\n  loss: {value: 16 mW/K, fit: true}\n  power: 1 W\n", encoding="utf-8")
    formula = f"feed_forward: loss*(setpoint - ambient_temperature)/power, parameters_of: {model}"
    steps = "to: 40 degC, gain: 2 %/K, for: 20 min, then: stay"
    left = []
    for fields in (steps, f"{steps}, {formula}"):
        done = heat(tmp_path, fields)
        assert done.result.folder is not None
        run = open_run(done.result.folder)
        left.append(313.15 - float(run.signals("temperature_1")[-3]))
        assert {one["name"] for one in run.info["measures"]} >= {"control_jitter_p50", "control_jitter_p99"}
    assert left[0] > 4.0
    assert abs(left[1]) < 0.2


def test_an_undefined_feed_forward_keeps_its_last_value(press: Callable[..., RunLog]) -> None:
    """It used to count as 0 while undefined."""
    formula = "setpoint*sqrt(-1 - setpoint/(1 bar))"
    never = press(f"to: 20 bar, gain: 0, feed_forward: {formula}, for: 20 s", rate=10)
    assert never.result.status == "failed"
    assert f"has no value: '{formula}' is undefined" in str(never.result.reason)
    assert 1.0 <= never.result.duration < 3.0
    assert not any(value for _, value in never.commands("relief_valve"))
    # on the ramp from 0 to 20 bar it is defined below 12 bar only
    partly = press(
        "to: 20 bar, ramp: 10 bar/s, gain: 0, for: 3 s, "
        "feed_forward: setpoint + 0 bar*sqrt(12 - setpoint/(1 bar))",
        rate=10,
    )
    assert partly.result.status == "finished"
    assert max(value for _, value in partly.commands("relief_valve")) == pytest.approx(12 * BAR, abs=1e5)
    notes = [one for one in partly.messages("note") if "was undefined at" in one]
    assert len(notes) == 1


def test_the_loop_settles_or_reports_its_readings(tmp_path: Path) -> None:
    pi = "gain: 10 %/K, integral: 0.1 %/(K*s)"
    done = heat(tmp_path, f"to: 35 degC, {pi}, within: 0.5 K, settle: 30 s, timeout: 15 min")
    assert done.result.status == "finished"
    assert done.commands("heater_1")[-1][1] == 0.0
    late = heat(tmp_path, f"to: 60 degC, {pi}, within: 0.5 K, settle: 30 s, timeout: 30 s")
    assert "did not settle at 60 degC ± 0.5 K within 30 s" in str(late.result.reason)
    tripped = heat(
        tmp_path, f"to: 60 degC, {pi}, for: 5 min", faults=("sensor_out_of_range:temperature_1@20 s",)
    )
    assert tripped.result.status == "failed"
    assert tripped.commands("heater_1")[-1][1] == 0.0


def test_between_records_the_bench_is_read_as_often_as_the_loop_needs(tmp_path: Path) -> None:
    text = "steps:\n  - control: {actuator: heater_1, channel: temperature_1, to: 40 degC, gain: 1 %/K, "
    done = VirtualBench(tmp_path, HEATERS).run(f"{text}integral: 0.1 %/(K*s), rate: 20 Hz, for: 5 s}}\n")
    given = [time for time, value in done.commands("heater_1") if value > 0.0]
    assert np.diff(given) == pytest.approx(0.05)
    assert len(given) > 95
    assert done.result.folder is not None
    kept = {one["name"]: one["value"] for one in open_run(done.result.folder).info["measures"]}
    assert kept["control_jitter_p99"] == pytest.approx(0.0, abs=1e-6)


def test_after_a_loop_its_output_is_safe_and_the_sampling_rate_is_restored(tmp_path: Path) -> None:
    """This happens before the next step, not only at the end of the run."""
    loop = "{actuator: heater_1, channel: temperature_1, to: 40 degC, gain: 5 %/K, rate: 20 Hz, for: 5 s}"
    steps = f"steps:\n  - control: {loop}\n  - set: {{heater_2: 10 %}}\n  - wait: 9 s\n"
    done = VirtualBench(tmp_path, HEATERS).run(steps)
    begin = done.commands("heater_1")[0][0]
    off = next(time for time, value in done.commands("heater_1") if value == 0.0)
    assert off - begin == pytest.approx(5.0, abs=0.1)
    assert done.result.folder is not None
    times = open_run(done.result.folder).signals("time") - begin
    slow = 1.0 / load_rig(HEATERS).monitor_rate
    assert np.diff(times[(times > 0.0) & (times < 4.5)]) == pytest.approx(0.05, abs=1e-6)
    assert np.diff(times[(times > 6.5) & (times < 13.5)]) == pytest.approx(slow, abs=1e-6)


@pytest.mark.parametrize("fault", ["sensor_open", "sensor_out_of_range"])
def test_an_impossible_reading_holds_the_output_and_is_counted(
    press: Callable[..., RunLog], fault: str
) -> None:
    done = press(
        "to: 30 bar, gain: 0.5, integral: 2 1/s, for: 2 s",
        options={"faults": (f"{fault}:supply_pressure@1 s..1.035 s",)},
    )
    assert done.result.status == "finished", done.result.reason
    (told,) = (
        text for text in done.messages("note") if "readings of supply_pressure could not be used" in text
    )
    assert told.startswith(("3 ", "4 "))
    assert not [value for time, value in done.commands("relief_valve") if 1.0 < time < 1.035]


def test_equal_seeds_give_byte_identical_samples(tmp_path: Path) -> None:
    found = []
    for name in ("a", "b"):
        done = heat(tmp_path / name, "to: 40 degC, gain: 5 %/K, for: 1 min", noise="on", seed=7)
        assert done.result.folder is not None
        found.append((done.result.folder / "samples.parquet").read_bytes())
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ("to: 120 degC, gain: 1 %/K, for: 1 min", "would trip the limit"),
        ("to: 40 degC, gain: 1 %, for: 1 min", "wrong dimension"),
        ("to: 40 degC, gain: 1 %/K, integral: -1 %/(K*s), for: 1 min", "acts against the gain"),
        ("to: 40 degC, gain: 1 %/K", "the loop has no end"),
        ("to: 40 degC, gain: 1 %/K, within: 1 K", "settling needs all three"),
        ("to: 40 degC, gain: 1 %/K, high: 150 %, for: 1 min", "out of range"),
        ("to: 40 degC, gain: 1 %/K, for: 1 min, feed_forward: setpoint", "feed_forward"),
        ("to: 40 degC, gain: 1 %/K, for: 1 min, feed_forward: convecton*setpoint", "convection"),
        ("to: 40 degC, gain: 1 %/K, for: 1 min, parameters_of: m.yaml", "parameters without a formula"),
        ("to: 40 degC, gain: 1 %/K, for: 1 min, max_rate: 0 %/s", "a rate that the actuator does not allow"),
    ],
)
def test_a_loop_that_does_not_fit_the_rig_is_refused(tmp_path: Path, fields: str, said: str) -> None:
    text = f"steps:\n  - control: {{actuator: heater_1, channel: temperature_1, {fields}}}\n"
    with pytest.raises(RigctlError) as caught:
        VirtualBench(tmp_path, HEATERS).plan(text)
    assert said in str(caught.value)
    assert caught.value.where.line == 3


def test_a_loop_faster_than_its_record_is_refused_and_its_duration_is_forecast(tmp_path: Path) -> None:
    loop = "control: {actuator: heater_1, channel: temperature_1, to: 40 degC, gain: 1 %/K, for: 90 s}"
    bench = VirtualBench(tmp_path, HEATERS)
    with pytest.raises(RigctlError, match="faster than the record's samples"):
        bench.plan(f"steps:\n  - record: {{name: r, rate: 2 Hz}}\n    do:\n      - {loop}\n")
    assert preview(bench.plan(f"steps:\n  - {loop}\n")).seconds == pytest.approx(90.0)
