"""Each step: its short form, long form, defaults, and the action that results on the rig."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rigctl.plan import Branch, GroupKind, Leaf, Loop, Plan, RecordNode, walk
from rigctl.plan.action import Action
from rigctl.plan.statistics import Stretch
from rigctl.steps.heat import Heat
from rigctl.steps.hold import Hold
from rigctl.steps.measure import Measure, Missed
from rigctl.steps.move import Move
from rigctl.steps.prompt import Prompt
from rigctl.steps.set_ import Set
from rigctl.steps.set_pressure import SetLevel
from rigctl.steps.wait import Wait

Only = Callable[[str], Action]


def test_the_long_form_of_heat_is_read(only: Only) -> None:
    written = "- heat: {to: 40 degC, within: 0.3 degC, settle: 10 s, timeout: 1 h}"
    assert only(written) == Heat("heater", "oil_temperature", 313.15, pytest.approx(0.3), 10.0, 3600.0)


def test_the_short_form_of_heat_has_the_documented_defaults(only: Only) -> None:
    assert only("- heat: 40 degC") == Heat("heater", "oil_temperature", 313.15, 0.5, 60.0, 7200.0)


def test_set_pressure_has_the_same_meaning_in_short_and_long_form(only: Only) -> None:
    expected = SetLevel("relief_valve", "supply_pressure", 30e5, 0.5e5, 2.0, 60.0)
    assert only("- set_pressure: 30 bar") == expected
    assert only("- set_pressure: {to: 3 MPa, within: 50 kPa, settle: 2 s, timeout: 1 min}") == expected


def test_moves_by_time_are_read(only: Only) -> None:
    assert only("- extend: 1.05 s") == Move(1, "valve", 1.0, "position", duration=1.05)
    assert only("- retract: {for: 1500 ms}") == Move(-1, "valve", -1.0, "position", duration=1.5)


def test_move_until_a_condition_has_a_timeout(only: Only) -> None:
    action = only("- retract: {until: position < 1 mm}")
    assert isinstance(action, Move)
    assert action.until is not None
    assert action.until.evaluate({"position": 0.0009}) is True
    assert action.until.evaluate({"position": 0.0011}) is False
    assert (action.timeout, action.duration, action.target) == (10.0, None, None)


def test_move_to_a_position_has_a_tolerance_and_a_timeout(only: Only) -> None:
    action = only("- extend: {to: 100 mm}")
    assert isinstance(action, Move)
    assert (action.target, action.within, action.timeout) == (pytest.approx(0.1), pytest.approx(1e-3), 10.0)


def test_hold_takes_its_dimension_from_the_channel(only: Only) -> None:
    written = "- hold: {for: 5 s, channel: oil_temperature, at: 40 degC, within: 1 degC}"
    assert only(written) == Hold(5.0, "oil_temperature", 313.15, 1.0)
    written = "- hold: {for: 5 s, channel: position, within: 2 mm}"
    assert only(written) == Hold(5.0, "position", None, pytest.approx(2e-3))


def test_wait_takes_a_duration_or_a_condition_with_a_timeout(only: Only) -> None:
    assert only("- wait: 0.2 s") == Wait(duration=0.2)
    action = only("- wait: {until: oil_temperature < 40 degC, timeout: 2 h}")
    assert isinstance(action, Wait)
    assert (action.duration, action.timeout) == (None, 7200.0)


@pytest.mark.parametrize(
    ("written", "values"),
    [
        ("{heater: on}", {"heater": 1.0}),
        ("{heater: true, valve: extend}", {"heater": 1.0, "valve": 1.0}),
        ("{heater: 0, valve: -1}", {"heater": 0.0, "valve": -1.0}),
        ("{relief_valve: 30 bar}", {"relief_valve": 30e5}),
    ],
)
def test_set_accepts_the_words_of_each_actuator(only: Only, written: str, values: dict[str, float]) -> None:
    action = only(f"- set: {written}")
    assert isinstance(action, Set)
    assert dict(action.values) == values
    assert action.duration is None


def test_set_takes_a_duration(only: Only) -> None:
    action = only("- set: {values: {valve: extend}, for: 1 s}")
    assert isinstance(action, Set)
    assert action.duration == 1.0


def test_a_prompt_can_ask_for_a_confirmation(only: Only) -> None:
    assert only("- prompt: Close the door.") == Prompt("Close the door.")


def test_a_prompt_can_ask_for_a_value_with_unit_and_bounds(only: Only) -> None:
    written = (
        "- prompt: {question: How long?, name: run_time, unit: s, low: 1 s, high: 1 h, simulated: 5 min}"
    )
    assert only(written) == Prompt("How long?", "run_time", "s", 1.0, 3600.0, 300.0)


def test_measure_over_a_window_has_limits_that_nan_fails(only: Only) -> None:
    written = "- measure: {name: zero, value: mean(position), unit: mm, last: 2 s, low: -1 mm, high: 1 mm}"
    action = only(written)
    assert isinstance(action, Measure)
    assert (action.stretch, action.window, action.missed) == (Stretch.WINDOW, 2.0, Missed.FAIL)
    assert (action.low, action.high) == (pytest.approx(-1e-3), pytest.approx(1e-3))
    assert [action.passes(value) for value in (0.0, 2e-3, float("nan"))] == [True, False, False]


def test_measure_in_a_record_is_over_the_record_by_default(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - record: {name: r}
          do:
            - measure: {name: a, value: max(position), unit: mm}
            - measure: {name: b, value: max(position), unit: mm, over: phase}
        """)
    found = [n.action.stretch for n in walk(plan.root) if isinstance(n, Leaf)]
    assert found == [Stretch.RECORD, Stretch.PHASE]


def test_record_takes_rate_channels_and_retries(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - record: {name: stroke, rate: 50 Hz, channels: [position, supply_pressure, position], retries: 2}
          do:
            - wait: 1 s
        """)
    (record,) = [n for n in walk(plan.root) if isinstance(n, RecordNode)]
    assert (record.rate, record.channels, record.retries) == (50.0, ("position", "supply_pressure"), 2)


def test_records_take_all_channels_by_default(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - record: {name: stroke}
          do: [wait: 1 s]
        """)
    (record,) = [n for n in walk(plan.root) if isinstance(n, RecordNode)]
    assert record.channels == ("oil_temperature", "supply_pressure", "position")
    assert (record.rate, record.retries) == (100.0, 0)


def test_if_and_else_become_a_branch_of_the_plan(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - if: oil_temperature > 40 degC and valve == 0
          do: [wait: 1 s]
          else: [wait: 2 s]
        """)
    (branch,) = plan.root.children
    assert isinstance(branch, Branch)
    assert branch.condition.evaluate({"oil_temperature": 320.0, "valve": 0.0}) is True
    assert branch.otherwise is not None
    assert [n.path for n in walk(branch)] == [
        "1/if", "1/if/do", "1/if/1/wait", "1/if/else", "1/if/else/1/wait"
    ]  # fmt: skip


def test_conditions_can_use_earlier_measures_and_answers(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - prompt: {question: How warm?, name: felt, unit: degC}
        - measure: {name: zero, value: mean(position), unit: mm, last: 1 s}
        - if: felt > 30 degC or zero > 1 mm
          do: [wait: 1 s]
        """)
    branch = plan.root.children[2]
    assert isinstance(branch, Branch)
    assert branch.condition.evaluate({"felt": 310.0, "zero": 0.0}) is True


def test_while_and_repeat_become_loops_of_the_plan(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - while: oil_temperature < 40 degC
          at_most: 5
          do: [wait: 1 s]
        - repeat: 3
          do: [wait: 1 s]
        """)
    first, second = plan.root.children
    assert isinstance(first, Loop)
    assert isinstance(second, Loop)
    assert (first.count, first.max_iterations, first.condition is None) == (None, 5, False)
    assert (second.count, second.max_iterations, second.condition) == (3, 3, None)


def test_cleanup_blocks_belong_to_their_step(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - record: {name: r}
          do: [wait: 1 s]
          finally: [retract: 1 s]
          on_failure: [wait: 2 s]
        - do: [wait: 1 s]
          on_abort: [wait: 3 s]
        """)
    around, block = plan.root.children
    assert (around.kind, around.path) == (GroupKind.DO, "1/block")
    assert isinstance(around.children[0], RecordNode)
    assert around.finally_.path == "1/block/finally"
    assert around.finally_.children[0].path == "1/block/finally/1/retract"
    assert around.on_failure is not None
    assert around.on_abort is None
    assert (block.path, block.on_abort.kind) == ("2/do", GroupKind.CLEANUP)


def test_cleanup_blocks_of_the_whole_procedure_are_at_its_root(planned: Callable[..., Plan]) -> None:
    plan = planned("""
        steps: [wait: 1 s]
        on_failure: [wait: 2 s]
        on_abort: [wait: 3 s]
        finally: [wait: 4 s]
        """)
    blocks = (plan.on_failure, plan.on_abort, plan.finally_)
    assert [block.path for block in blocks] == ["on_failure", "on_abort", "finally"]
    assert [block.children[0].action.duration for block in blocks] == [2.0, 3.0, 4.0]
    assert plan.root.finally_ is None
