"""The work sheet for an operator: every setting and step of the design, in order."""

from __future__ import annotations

from rigctl.answers.design.work_sheet import work_sheet
from rigctl.design.result import DesignResult, DesignRival, PredictedPower, ProposedRecord


def record(**settings: str) -> ProposedRecord:
    return ProposedRecord(
        settings=settings,
        steps=("wait: 2 s", "extend: 1.8 s", "retract: 3 s"),
        separation=136.0,
        of_repeat=1.9,
        before=0.005,
        after=0.98,
        duration=3240.0,
        recorded=13.3,
        rate=100.0,
    )


def test_every_setting_and_step_has_a_check_box_in_order() -> None:
    made = DesignResult(
        runs=("20260101-000000-campaign",),
        model="own",
        aim="discrimination",
        rivals=tuple(DesignRival(name, (name,), 0.5, {}, 100.0, 1.0) for name in ("leak", "drift")),
        outlooks=(PredictedPower("leak", "drift", 0.0, 9.2, 137.0, 5.0, 0.005, 0.98),),
        separation=137.0,
        records=(
            record(oil_temperature="74 degC", supply_pressure="55 bar"),
            record(oil_temperature="20 degC"),
        ),
        before=0.005,
        after=0.98,
        duration=3300.0,
    )
    text = work_sheet(made)
    boxes = [line.strip() for line in text.splitlines() if line.lstrip().startswith("[ ]")]
    assert boxes[:2] == [
        "[ ] set oil temperature to 74 degC, wait until it is steady",
        "[ ] set supply pressure to 55 bar, wait until it is steady",
    ]
    assert boxes[3:6] == ["[ ] wait: 2 s", "[ ] extend: 1.8 s", "[ ] retract: 3 s"]
    assert len(boxes) == 7 + 6
    assert "RECORD 2" in text
    assert "2 records of 55 min of bench time tell leak and drift apart" in text
    assert "under 1 % now, 98 % after" in text
    assert "rigctl diagnose 20260101-000000-campaign NEW_RUN --model MODEL" in text
    assert max(map(len, text.splitlines())) <= 100
