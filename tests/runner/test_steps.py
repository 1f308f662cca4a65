"""What each action does on the bench, in virtual time on the plain plant."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from rigctl.errors import ExitCode

Do = Callable[..., Any]


def test_wait_lasts_exactly_as_long_as_specified(do: Do) -> None:
    done = do("steps:\n  - wait: 12.3 s\n")
    begin, end = (event["time"] for event in done.events("step"))
    assert done.result.status == "finished"
    assert end - begin == pytest.approx(12.3, abs=1e-9)


def test_wait_until_ends_at_the_first_sample_that_satisfies_it(do: Do) -> None:
    steps = "steps:\n  - set: {valve: extend}\n  - wait: {until: position > 100 mm, timeout: 10 s}\n"
    done = do(steps)
    assert done.outcome("wait") == "complete"
    # the plain plant crosses 290 mm in 2.5 s
    assert done.result.duration == pytest.approx(0.2 + 100.0 / 116.0, abs=0.11)


def test_wait_until_fails_at_its_timeout_with_the_last_reading(do: Do) -> None:
    done = do("steps:\n  - wait: {until: position > 100 mm, timeout: 3 s}\n")
    assert done.result.status == "failed"
    assert done.result.exit_code is ExitCode.FAILED
    assert "'position > 100 mm' did not come true within 3 s; position was 0 mm" in done.result.reason
    assert done.outcome("wait") == "timed_out"


def test_a_timed_move_has_its_exact_duration_between_samples(do: Do) -> None:
    done = do("steps:\n  - extend: {for: 1.0537 s}\n")
    (on, extend), (off, neutral) = done.commands("valve")
    assert (extend, neutral) == (1.0, 0.0)
    assert off - on == pytest.approx(1.0537, abs=1e-9)
    assert done.result.duration == pytest.approx(off, abs=1e-9)


def test_outputs_set_for_a_time_begin_together_when_all_have_rested(do: Do) -> None:
    """The heater, just switched off, may be switched on again only after 2 s."""
    done = do(
        "steps:\n  - set: {heater: on}\n  - set: {heater: off}\n"
        "  - set: {values: {valve: extend, heater: on}, for: 0.5 s}\n"
    )
    assert done.result.status == "finished", done.result.reason
    (opened, _), (closed, _) = done.commands("valve")
    assert closed - opened == pytest.approx(0.5, abs=1e-9)
    (on, _), (off, _) = done.commands("heater")[2:]
    assert off - on == pytest.approx(0.5, abs=1e-9)
    assert on == pytest.approx(opened, abs=0.05)


def test_a_move_until_a_condition_stops_there(do: Do) -> None:
    done = do("steps:\n  - extend: {until: position > 50 mm, timeout: 5 s}\n")
    assert [value for _, value in done.commands("valve")] == [1.0, 0.0]
    assert done.outcome("extend") == "complete"


def test_a_move_whose_condition_already_holds_commands_nothing(do: Do) -> None:
    done = do("steps:\n  - retract: {until: position < 1 mm, timeout: 5 s}\n")
    assert done.commands("valve") == []
    assert done.outcome("retract") == "complete"


def test_a_move_that_does_not_arrive_fails_with_the_valve_closed(do: Do) -> None:
    done = do(
        "steps:\n  - extend: {until: position > 200 mm, timeout: 5 s}\n",
        options={"faults": ["valve_stuck@0 s"]},
    )
    assert done.outcome("extend") == "timed_out"
    assert "position was 0 mm" in done.result.reason
    assert done.commands("valve")[-1][1] == 0.0


@pytest.mark.parametrize("noise", ["off", "on"])
@pytest.mark.parametrize("target", [5.0, 100.0, 230.0])
def test_a_move_to_a_position_rests_within_tolerance(do: Do, target: float, noise: str) -> None:
    done = do(
        f"steps:\n  - extend: {{to: {target} mm, within: 1 mm, timeout: 20 s}}\n"
        "  - measure: {name: end, value: mean(position), last: 0.2 s, unit: mm}\n",
        options={"noise": noise, "quantised": noise},
    )
    assert done.outcome("extend") == "complete"
    (measure,) = done.events("measure")
    assert measure["value"] * 1e3 == pytest.approx(target, abs=1.1)
    assert done.result.duration < 10.0


def test_a_move_to_a_position_reverses_when_it_is_beyond(do: Do) -> None:
    done = do(
        "steps:\n  - extend: {for: 2 s}\n  - extend: {to: 50 mm, within: 1 mm, timeout: 20 s}\n"
        "  - measure: {name: end, value: last(position), last: 0.2 s, unit: mm}\n"
    )
    assert done.events("measure")[0]["value"] * 1e3 == pytest.approx(50.0, abs=1.1)


def test_a_position_that_cannot_be_reached_fails_at_the_timeout(do: Do) -> None:
    done = do(
        "steps:\n  - extend: {to: 100 mm, within: 1 mm, timeout: 6 s}\n",
        options={"faults": ["valve_stuck@0 s"]},
    )
    assert done.outcome("extend") == "timed_out"
    assert "did not come to rest at 100 mm ± 1 mm within 6 s; it was 0 mm" in done.result.reason
    assert done.result.duration < 7.0


@pytest.mark.parametrize("noise", ["off", "on"])
def test_heat_settles_within_tolerance_and_leaves_the_heater_off(do: Do, noise: str) -> None:
    done = do(
        "steps:\n  - heat: {to: 25 degC, within: 0.5 K, settle: 60 s, timeout: 1 h}\n"
        "  - measure: {name: oil, value: mean(oil_temperature), last: 10 s, unit: degC}\n",
        options={"noise": noise, "quantised": noise},
    )
    assert done.outcome("heat") == "complete"
    assert done.events("measure")[0]["value"] == pytest.approx(298.15, abs=0.5)
    switches = done.commands("heater")
    assert switches[-1][1] == 0.0
    times = [time for time, _ in switches]
    assert all(after - before >= 2.0 - 1e-9 for before, after in pairwise(times))


def test_heat_completes_when_the_oil_is_too_hot_at_first(do: Do, workshop: Any) -> None:
    rig = workshop.rig("oil_temperature: 20 degC", "oil_temperature: 40 degC")
    done = do("steps:\n  - heat: {to: 38 degC, within: 0.5 K, settle: 10 s, timeout: 2 h}\n", rig=rig)
    assert done.outcome("heat") == "complete"
    assert 1.0 not in [value for _, value in done.commands("heater")]
    assert done.result.duration > 10.0  # until it has cooled, and settled


def test_heat_fails_at_its_timeout_with_the_last_reading(do: Do) -> None:
    done = do(
        "steps:\n  - heat: {to: 40 degC, within: 0.5 K, settle: 60 s, timeout: 10 min}\n",
        options={"faults": ["setpoint_never_reached:oil_temperature@0 s"]},
    )
    assert done.outcome("heat") == "timed_out"
    assert "oil_temperature did not settle at 40 degC ± 0.5 K within 600 s: it was 20." in done.result.reason
    assert done.commands("heater")[-1][1] == 0.0


def test_set_pressure_asks_the_operator_and_watches_the_channel(do: Do) -> None:
    done = do("steps:\n  - set_pressure: {to: 30 bar, within: 0.5 bar, settle: 2 s, timeout: 60 s}\n")
    assert done.outcome("set pressure") == "complete"
    assert done.commands("relief_valve")[0][1] == pytest.approx(30e5)
    assert "Turn the relief valve until the supply pressure reads 30 bar" in done.messages("operator")
    assert 2.0 < done.result.duration < 6.0


def test_set_pressure_fails_at_its_timeout_with_the_last_reading(do: Do) -> None:
    done = do(
        "steps:\n  - set_pressure: {to: 30 bar, within: 0.5 bar, settle: 2 s, timeout: 20 s}\n",
        options={"faults": ["setpoint_never_reached:supply_pressure@0 s"]},
    )
    assert (
        "supply_pressure did not settle at 30 bar ± 0.5 bar within 20 s: it was 20 bar" in done.result.reason
    )


def test_hold_reports_a_broken_sensor_by_its_interlock_message(do: Do) -> None:
    steps = "steps:\n  - hold: {for: 5 s, channel: position, at: 0 mm, within: 2 mm}\n"
    done = do(steps, options={"faults": ["sensor_open:position@1 s"]})
    assert done.result.status == "failed"
    assert "the transducer has come loose: position is -10 mm" in str(done.result.reason)


def test_hold_fails_at_the_sample_that_leaves_the_tolerance(do: Do) -> None:
    steps = "steps:\n  - set: {valve: extend}\n  - hold: {for: 5 s, channel: position, within: 30 mm}\n"
    done = do(steps)
    assert done.outcome("hold") == "failed"
    assert "position left" in done.result.reason
    assert done.result.duration < 1.0
    calm = do("steps:\n  - hold: {for: 5 s, channel: position, at: 0 mm, within: 1 mm}\n")
    assert calm.result.status == "finished"
    assert calm.result.duration == pytest.approx(5.2, abs=1e-6)


def test_set_for_a_time_returns_to_the_safe_value(do: Do) -> None:
    done = do("steps:\n  - set: {values: {heater: on}, for: 7.5 s}\n")
    (on, one), (off, zero) = done.commands("heater")
    assert (one, zero, off - on) == (1.0, 0.0, pytest.approx(7.5))


def test_a_prompt_keeps_the_answer_as_data(do: Do) -> None:
    done = do(
        "steps:\n  - prompt: {question: Flow time?, name: flow_time, unit: s, low: 1 s, high: 600 s, "
        "simulated: 42 s}\n"
        "  - if: flow_time > 40 s\n    do:\n      - wait: 3 s\n    else:\n      - wait: 1 s\n"
    )
    (measure,) = done.events("measure")
    assert (measure["name"], measure["value"], measure["unit"]) == ("flow_time", 42.0, "s")
    assert done.result.duration == pytest.approx(3.2, abs=0.01)


def test_a_measure_outside_its_limits_fails_the_run_or_is_noted(do: Do) -> None:
    steps = (
        "steps:\n  - wait: 1 s\n"
        "  - measure: {{name: zero, value: mean(position), last: 1 s, unit: mm, low: 1 mm, "
        "high: 2 mm{more}}}\n"
        "  - wait: 1 s\n"
    )
    failed = do(steps.format(more=""))
    assert failed.result.status == "failed"
    assert "zero is 0 mm, expected 1 mm to 2 mm" in failed.result.reason
    assert failed.events("measure")[0]["passed"] is False
    went_on = do(steps.format(more=", missed: continue"))
    assert went_on.result.status == "finished"
    assert went_on.result.exit_code is ExitCode.FAILED
    assert went_on.result.duration > 2.0


def test_a_while_loop_ends_when_its_condition_no_longer_holds(do: Do) -> None:
    done = do(
        "steps:\n  - while: position < 100 mm\n    do:\n      - extend: {for: 0.3 s}\n      - wait: 0.2 s\n"
        "  - repeat: 3\n    do:\n      - wait: 1 s\n"
    )
    assert done.result.status == "finished"
    pulses = [value for _, value in done.commands("valve") if value == 1.0]
    assert len(pulses) == 3  # 116 mm/s: 35, 70, 104 mm
    paths = [event["path"] for event in done.events("step") if event.get("message") == "wait 1 s"]
    assert len(set(paths)) == 3


def test_a_loop_that_does_not_end_fails(do: Do) -> None:
    done = do("steps:\n  - while: position < 100 mm\n    at_most: 5\n    do:\n      - wait: 0.1 s\n")
    assert done.result.status == "failed"
    assert "5 rounds" in done.result.reason


def test_an_actuator_rests_before_it_is_switched_on_but_goes_safe_at_once(do: Do) -> None:
    done = do("steps:\n  - set: {heater: on}\n  - set: {heater: off}\n  - set: {heater: on}\n  - wait: 5 s\n")
    (on, _), (off, zero), (again, one) = done.commands("heater")[:3]
    assert (zero, one) == (0.0, 1.0)
    assert off == on
    assert again - off == pytest.approx(2.0)
