"""Where a schedule ends, and what limits its use, in words; the commands are in `tests/compensation`."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from rigctl.answers.schedule.schedule import check_text, end_text, notes, statement
from rigctl.compensation.check import Check
from rigctl.compensation.paired_test import Verdict
from rigctl.compensation.result import CompensationRow, RangeEnd, Schedule

SCHEDULE = Schedule(
    runs=("run",),
    model="own",
    quantity="stroke",
    target=0.1,
    unit="mm",
    vary="supply",
    vary_unit="bar",
    over="oil",
    over_unit="degC",
    rows=(
        CompensationRow(303.15, 20e5, 1e4, 0.1, 1e-4, 0.102),
        CompensationRow(313.15, 22e5, 1e4, 0.1, 1e-4, 0.100),
        CompensationRow(323.15, math.nan, math.nan, math.nan, math.nan, 0.098),
    ),
    fixed=22e5,
    off=0.0,
    valid=(("oil", 303.15, 323.15, "degC"), ("supply", 20e5, 25e5, "bar")),
    ends=(RangeEnd((318.15,), 323.15, 323.15, 25e5, "highest", (0.0985, 0.0985)),),
    disagreement=None,
    check=Check("stroke.yaml", "supply", "", heated=True, seed=0, records=()),
)


def test_the_first_end_belongs_to_the_statement() -> None:
    end = end_text(SCHEDULE, SCHEDULE.ends[0])
    assert end == (
        "it ends at oil 45 degC; at 50 degC the rig does not go far enough: at supply 25 bar, its highest, "
        "stroke is 98.5 mm"
    )
    said = statement(SCHEDULE)
    assert said.endswith(f"it would be off by up to 2 mm. I{end[1:]}")
    assert said.startswith(
        "To keep stroke at 100 mm, set supply from 20 bar at oil 30 degC to 22 bar at 40 degC;"
    )


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"disagreement": 0.003}, "own does not agree with these data (p = 0.003)"),
        (
            {"valid": (SCHEDULE.valid[0], ("supply", 20e5, 21e5, "bar"))},
            "1 of 3 set-points lie outside of what was measured, supply 20 bar to 21 bar",
        ),
        (
            {"rows": tuple(replace(row, scatter=2e-3) for row in SCHEDULE.rows[:2])},
            "with supply left where it is, stroke would be off by no more than 2 mm, and records scatter by ",
        ),
    ],
)
def test_what_limits_a_schedule_is_a_note(changed: dict[str, object], said: str) -> None:
    assert notes(SCHEDULE) == []
    (note,) = notes(replace(SCHEDULE, **changed))  # type: ignore[arg-type]
    assert note.startswith(said)


def test_too_few_pairs_give_no_bound() -> None:
    judged = Verdict(("run",), "stroke", 0.1, "mm", 2, 1e-4, 2e-4, 0.5, math.inf)
    assert check_text(judged).endswith("so few pairs give no bound; 5 are the fewest")
    assert check_text(replace(judged, pairs=9)).endswith("a ratio of 0.50, no bound")
