"""What a preview expects: durations, records, sweeps, limits, warnings."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from rigctl.planning import Basis, Preview, preview
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig, load_rig, parse_rig

ROOT = Path(__file__).parents[2]
See = Callable[..., Preview]


def shipped(name: str, **arguments: str) -> Preview:
    procedure = load_procedure(ROOT / "procedures" / f"{name}.yaml")
    return preview(expand(procedure, load_rig(procedure.rig_path), arguments))


def test_the_preview_of_the_campaign_has_its_records_duration_and_sweeps() -> None:
    seen = shipped("campaign")
    assert (seen.records, seen.samples) == (28, 28 * 375)
    assert seen.basis is Basis.ESTIMATED
    assert not seen.open_ended
    assert 40 * 60 < seen.seconds < 60 * 60
    assert seen.warnings == ()
    assert seen.sweeps[0].points == 7
    assert [sweep.points for sweep in seen.sweeps if sweep.variables == ("supply",)] == [4] * 7
    heats = [node for node in seen.walk() if node.path.endswith("/heat")]
    assert all(heat.seconds < later.seconds for heat, later in pairwise(heats))


def test_the_quick_check_takes_less_than_a_minute() -> None:
    assert shipped("quick-check").seconds < 60.0


def test_timed_steps_are_added_up(previewed: See) -> None:
    seen = previewed("""
        steps:
          - wait: 2 s
          - record: {name: r, rate: 50 Hz}
            do:
              - extend: 1 s
              - hold: {for: 3 s, channel: position, within: 5 mm}
          - set: {values: {heater: on}, for: 4 s}
        finally: [wait: 5 s]
        on_failure: [wait: 1000 s]
        """)
    assert (seen.seconds, seen.basis) == (15.0, Basis.TIMED)
    assert (seen.records, seen.samples) == (1, 200)
    assert seen.durations() == {
        "1/wait": 2.0, "2/record/1/extend": 1.0, "2/record/2/hold": 3.0, "3/set": 4.0, "finally/1/wait": 5.0
    }  # fmt: skip


def test_loops_count_every_round(previewed: See) -> None:
    seen = previewed("""
        steps:
          - repeat: 3
            do:
              - record: {name: r, rate: 10 Hz}
                do: [wait: 2 s]
          - repeat: 0
            do: [wait: 100 s]
        """)
    assert (seen.seconds, seen.records, seen.samples) == (6.0, 3, 60)
    assert seen.durations()["1/repeat/1/record/1/wait"] == 2.0


def test_a_later_round_starts_from_where_the_first_ended(previewed: See) -> None:
    seen = previewed("steps:\n  - repeat: 5\n    do: [heat: 30 degC]")
    first = seen.durations()["1/repeat/1/heat"]
    assert first > 400.0
    assert seen.seconds < first + 5 * 65.0


def test_deeply_nested_loops_are_previewed_with_their_total_duration(previewed: See) -> None:
    lines = ["steps:"]
    for depth in range(35):
        pad = "  " * (2 * depth + 1)
        lines += [f"{pad}- repeat: {2 if depth < 18 else 1}", f"{pad}  do:"]
    lines.append("  " * 71 + "- wait: 1 s")
    assert previewed("\n".join(lines)).seconds == 2.0**18


def test_steps_that_wait_for_conditions_leave_the_duration_open(previewed: See) -> None:
    seen = previewed("""
        steps:
          - while: oil_temperature < 40 degC
            do: [wait: 1 s]
          - wait: {until: oil_temperature > 30 degC, timeout: 7 s}
        """)
    assert seen.open_ended
    assert seen.basis is Basis.AT_MOST
    assert seen.seconds == 8.0


def test_a_branch_takes_the_duration_of_its_longer_side(previewed: See) -> None:
    seen = previewed("""
        steps:
          - if: oil_temperature < 40 degC
            do: [wait: 1 s]
            else:
              - record: {name: r, rate: 1 Hz}
                do: [wait: 9 s]
        """)
    assert (seen.seconds, seen.records) == (9.0, 1)


def test_operator_times_count_on_a_real_bench(previewed: See, serial_rig: Rig) -> None:
    text = "steps:\n  - set_pressure: {to: 30 bar, settle: 2 s}\n  - prompt: Close the door."
    assert previewed(text).seconds == 2.0
    seen = previewed(text, on=serial_rig)
    assert (seen.seconds, seen.basis) == (32.0, Basis.GUESSED)


def test_moves_are_predicted_from_the_flow_through_the_throttle(previewed: See) -> None:
    """At 30 bar the rod moves about 95 mm in 1.05 s; back at the same flow it takes 3/4 of the time."""
    seen = previewed("""
        steps:
          - set_pressure: 30 bar
          - extend: {for: 1.05 s}
          - retract: {until: position < 1 mm}
          - extend: {to: 100 mm}
        """)
    durations = seen.durations()
    assert durations["3/retract"] == pytest.approx(0.75 * 1.05 + 0.1, rel=0.02)
    assert 1.0 < durations["4/extend"] < 1.4
    (travel,) = [use for use in seen.limits if use.name == "over_travel"]
    assert travel.closest == pytest.approx(0.1, abs=0.01)
    assert travel.state == "clear"


def test_without_dimensions_the_preview_uses_the_timeouts_as_durations(previewed: See, rig: Rig) -> None:
    text = (ROOT / "rigs" / "hl32-bench.yaml").read_text(encoding="utf-8")
    bare = parse_rig(text.replace("  bore: 50 mm\n", "").replace("  tank_fill: 80 l", "  # tank_fill"))
    seen = previewed(
        """
        steps:
          - retract: {until: position < 1 mm, timeout: 7 s}
          - heat: {to: 30 degC, timeout: 1 h}
        """,
        on=bare,
    )
    assert (seen.seconds, seen.basis) == (3607.0, Basis.AT_MOST)


def test_limits_are_classified_as_touched_approached_clear_or_unknown(previewed: See) -> None:
    seen = previewed("steps:\n  - heat: {to: 84 degC, within: 2 K}\n  - set_pressure: 55 bar")
    states = {use.name: use.state for use in seen.limits}
    assert states["oil_hot"] == "touched"
    assert states["oil_too_hot"] == "approached"
    assert states["over_pressure"] == "approached"
    assert states["oil_cold"] == "clear"
    assert states["over_travel"] == "unknown"
    assert "moves_too_fast" not in states


@pytest.mark.parametrize(
    ("text", "piece"),
    [
        ("- heat: {to: 10 degC}", "the oil cools no further than"),
        ("- heat: {to: 40 degC, timeout: 5 min}", "but fails after 5 min"),
        (
            "- set_pressure: 50 bar\n  - heat: {to: 20 degC, settle: 10 min}",
            "the pump alone heats the oil past",
        ),
    ],
)
def test_probable_failures_are_predicted(previewed: See, text: str, piece: str) -> None:
    ((where, message),) = previewed(f"steps:\n  {text}\n").warnings
    assert piece in message
    assert where.line is not None


def test_a_heater_too_weak_for_the_set_point_is_warned_of(previewed: See) -> None:
    text = (ROOT / "rigs" / "hl32-bench.yaml").read_text(encoding="utf-8")
    weak = parse_rig(text.replace("power: 2000 W", "power: 20 W"))
    ((_, message),) = previewed("steps:\n  - heat: 80 degC\n", on=weak).warnings
    assert "with the heater on, the oil gets no hotter than" in message


def test_cleanup_blocks_are_shown_without_a_duration(previewed: See) -> None:
    seen = previewed("""
        steps:
          - do: [wait: 1 s]
            on_failure:
              - record: {name: r}
                do: [wait: 50 s]
            finally: [wait: 2 s]
        """)
    assert (seen.seconds, seen.records) == (3.0, 0)
    (failure,) = [node for node in seen.walk() if node.path == "1/do/on_failure"]
    assert (failure.counted, failure.seconds) == (False, 50.0)


LOOP = """\
steps:
  - control: {actuator: relief_valve, channel: supply_pressure, to: 30 bar, gain: 1, rate: 50 Hz, for: 1 s,
      where: board}
"""


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("hl32-bench", "needs rigctl's board, and the rig file's backend is simulated"),
        ("oil-circuit-modbus", "needs rigctl's board, and the rig file's backend is modbus"),
        ("oil-circuit-visa", "the rig file's backend is visa, with a device of lines"),
        ("hl32-bench-uno", ""),
    ],
)
def test_a_loop_for_a_board_is_warned_of_on_a_bench_without_one(previewed: See, name: str, said: str) -> None:
    """It used to be refused only at arming, with everyone already at the bench."""
    path = ROOT / "rigs" / f"{name}.yaml"
    driven = path.read_text(encoding="utf-8").replace("    by: operator\n", "")
    driven = driven.replace("    prompt: Turn the relief valve until the supply pressure reads\n", "")
    driven = driven.replace("  valve: neutral\n", "  valve: neutral\n  relief_valve: 10 bar\n")
    rig = parse_rig(driven, path)
    seen = previewed(LOOP, on=rig)
    assert [str(where) for where, _ in seen.warnings] == ["test.yaml:3:5"] * bool(said)
    assert all(said in message and "'where: auto'" in message for _, message in seen.warnings)
    assert previewed(LOOP.replace("where: board", "where: auto"), on=rig).warnings == ()


def test_the_reading_at_the_start_counts_for_a_limit(previewed: See) -> None:
    """The rod begins at 0 mm, 3 mm from the limit below which it has slipped."""
    uses = {
        use.name: use
        for use in previewed("steps:\n  - set_pressure: 30 bar\n  - extend: {to: 100 mm}\n").limits
    }
    assert uses["position_slips"].closest == pytest.approx(0.0)
    assert uses["position_slips"].state == "clear"


@pytest.mark.parametrize(("within", "warned"), [("0.05 K", True), ("0.5 K", False)])
def test_a_tolerance_below_the_noise_is_a_warning(previewed: See, within: str, warned: bool) -> None:
    found = previewed(f"steps:\n  - heat: {{to: 21 degC, within: {within}, settle: 10 s}}\n").warnings
    text = "the tolerance is smaller than its noise of 0.1 K and its converter step of 0.25 K"
    assert any(text in message for _, message in found) == warned


@pytest.mark.parametrize(("within", "warned"), [("0.04 bar", True), ("0.5 bar", False)])
@pytest.mark.parametrize(
    "step",
    [
        "set_pressure: {to: 30 bar, within: WITHIN}",
        "hold: {for: 1 min, channel: supply_pressure, at: 30 bar, within: WITHIN}",
    ],
)
def test_every_step_with_a_tolerance_is_compared_with_the_noise(
    previewed: See, step: str, within: str, warned: bool
) -> None:
    found = previewed(f"steps:\n  - {step.replace('WITHIN', within)}\n").warnings
    assert (
        any("supply_pressure: the tolerance is smaller than its" in message for _, message in found) == warned
    )
