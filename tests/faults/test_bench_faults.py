"""Faults of the bench end the run safely or are reported; on the simulated bench, in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from rigctl.dataset import open_run, verify
from rigctl.errors import ExitCode

Do = Callable[..., Any]

STROKES = """\
steps:
  - repeat: 20
    do:
      - record: {name: stroke, rate: 100 Hz}
        do:
          - extend: {until: position > 100 mm, timeout: 3 s}
          - wait: 0.2 s
          - retract: {until: position < 1 mm, timeout: 3 s}
finally:
  - set: {heater: off, valve: neutral}
"""
HEATING = """\
steps:
  - heat: {to: 60 degC, within: 0.5 K, settle: 60 s, timeout: 3 h}
  - wait: 2 h
finally:
  - set: {heater: off, valve: neutral}
"""


def breaks(do: Do, steps: str, fault: str, **options: object) -> Any:
    done = do(steps, options={"faults": [fault], "noise": "on", "quantised": "on", **options})
    assert done.result.status == "failed"
    assert done.result.exit_code is ExitCode.FAILED
    assert done.states[-1] == "failed"
    if "lost" not in fault:
        for actuator in ("heater", "valve"):
            commands = done.commands(actuator)
            assert not commands or commands[-1][1] == 0.0
    verdict = verify(done.result.folder)
    assert verdict.good
    return done


@pytest.mark.parametrize("fault", ["sensor_open:position@5 s", "sensor_out_of_range:position@5 s"])
def test_a_broken_position_sensor_trips_within_1_5_s_and_keeps_earlier_records(do: Do, fault: str) -> None:
    done = breaks(do, STROKES, fault)
    assert "position is" in done.result.reason or "sensor or line broken" in done.result.reason
    assert 5.0 < done.result.duration < 6.5
    assert done.records[-1][1] == "tripped"
    assert all(outcome == "complete" for _, outcome in done.records[:-1])


def test_a_stuck_position_ends_the_move_in_time(do: Do) -> None:
    done = breaks(do, STROKES, "sensor_stuck:position@5 s")
    assert done.records[-1][1] == "timed_out"
    assert done.result.duration < 9.0


def test_a_noisy_position_is_detected(do: Do) -> None:
    done = do(STROKES, options={"faults": ["sensor_noisy:position@5 s"], "noise": "on", "quantised": "on"})
    (alarm,) = [e for e in done.events("alarm") if e["name"] == "position noise"]
    assert 5.0 < alarm["time"] < 5.6
    assert do(STROKES, options={"noise": "on", "quantised": "on"}).events("alarm") == []


def test_an_open_thermocouple_stops_the_heating(do: Do) -> None:
    done = breaks(do, HEATING, "sensor_open:oil_temperature@10 min")
    assert "oil_temperature is 1024 degC, above the limit of 90 degC" in done.result.reason
    assert "that is impossible, the sensor or its line may be broken" in done.result.reason
    assert done.result.duration < 602.0


def test_a_stuck_thermocouple_lets_the_heating_time_out(do: Do) -> None:
    done = breaks(do, HEATING, "sensor_stuck:oil_temperature@10 min")
    assert "did not settle at 60 degC ± 0.5 K within 10800 s" in done.result.reason


def test_a_heater_stuck_on_trips_the_over_temperature_interlock(do: Do) -> None:
    done = breaks(do, HEATING, "heater_stuck_on@30 min")
    assert "Oil over-temperature" in done.result.reason
    assert [e["name"] for e in done.events("alarm")] == ["oil_hot", "oil_too_hot"]


def test_a_stuck_valve_fails_the_run_with_the_position_in_its_reason(do: Do) -> None:
    done = breaks(do, STROKES, "valve_stuck@5 s")
    assert done.outcome("extend") == "complete"  # a timed move is not told that nothing moves; the next is
    assert "'position < 1 mm' was not reached within 3 s; position was" in done.result.reason
    assert done.result.duration < 10.0


@pytest.mark.parametrize("steps", [STROKES, HEATING])
def test_missing_samples_end_a_run_after_1_s_in_a_record_and_while_heating(do: Do, steps: str) -> None:
    done = breaks(do, steps, "samples_stop@5 s")
    assert "no sample for 1 s" in done.result.reason
    assert done.result.duration == pytest.approx(6.0, abs=0.3)


def test_an_unreached_set_point_reports_the_readings(do: Do) -> None:
    steps = "steps:\n  - set_pressure: {to: 30 bar, within: 0.5 bar, settle: 2 s, timeout: 60 s}\n"
    done = breaks(do, steps, "setpoint_never_reached:supply_pressure@0 s")
    assert "it was 20" in done.result.reason


def test_a_lost_bench_ends_the_run_and_skips_the_cleanup_steps(do: Do) -> None:
    done = breaks(do, STROKES, "backend_lost@5 s")
    assert "does not answer" in done.result.reason
    assert done.records[-1][1] == "lost"
    assert any("cleanup step left out" in text for text in done.messages("note"))
    assert any("could not be made safe from here" in text for text in done.messages("fault"))


RETRIED = STROKES.replace("rate: 100 Hz}", "rate: 100 Hz, retries: 2}")


@pytest.mark.parametrize(
    "fault", ["samples_stop@5 s..8 s", "backend_lost@5 s..8 s", "samples_stop@5 s..5.1 s"]
)
def test_a_record_interrupted_by_a_lost_bench_is_measured_again(do: Do, fault: str) -> None:
    done = do(RETRIED, options={"faults": [fault]})
    assert done.result.status == "finished", done.result.reason
    outcomes = [outcome for _, outcome in done.records]
    assert outcomes.count("complete") == 20
    assert outcomes.count("interrupted") == 1
    paths = [path for path, _ in done.records]
    again = outcomes.index("interrupted")
    assert paths[again] == paths[again + 1]
    run = open_run(done.result.folder)
    assert len(run.records) == 21


def test_a_record_with_its_own_cleanup_is_also_measured_again(do: Do) -> None:
    steps = RETRIED.replace(
        "        do:\n          - extend", "        finally: [wait: 0.1 s]\n        do:\n          - extend"
    )
    assert steps != RETRIED
    done = do(steps, options={"faults": ["samples_stop@7 s..9 s"]})
    assert done.result.status == "finished", done.result.reason
    assert [outcome for _, outcome in done.records].count("complete") == 20


def test_without_retries_a_short_gap_is_noted_and_a_long_one_fails_the_run(do: Do) -> None:
    lenient = STROKES.replace("rate: 100 Hz", "rate: 100 Hz, most_missing: 10 %")
    short = do(lenient, options={"faults": ["samples_stop@5 s..5.1 s"]})
    assert short.result.status == "finished"
    assert len(short.events("gap")) == 1
    assert do(lenient, options={"faults": ["samples_stop@5 s..8 s"]}).result.status == "failed"
