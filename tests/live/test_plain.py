"""A run as lines."""

from __future__ import annotations

import io

from rigctl.live import view
from rigctl.live.plain import PlainDisplay, stamp
from rigctl.plan import Plan
from rigctl.runner.snapshot import ShownEvent, View

EXTEND = "2/for[oil=40 degC]/2/for[supply=30 bar]/1/call/3/record/2/extend"


def told(plan: Plan, *views: View) -> list[str]:
    stream = io.StringIO()
    with view(plan, stream) as display:
        assert isinstance(display, PlainDisplay)
        for seen in views:
            display(seen)
    return stream.getvalue().splitlines()


def test_each_state_change_and_alarm_is_printed_once(plan: Plan) -> None:
    arming = ShownEvent(0.0, "state", "arming")
    running = ShownEvent(0.5, "state", "running")
    alarm = ShownEvent(61.0, "alarm", "The oil is hot")
    lines = told(
        plan,
        View("r", "arming", 0.1, happenings=(arming,)),
        View("r", "running", 1.0, happenings=(arming, running)),
        View("r", "running", 62.0, happenings=(running, alarm)),
        View("r", "running", 63.0, happenings=(running, alarm)),
    )
    assert lines == ["0:00:00  arming", "0:00:00  running", "0:01:01  alarm: The oil is hot"]


def test_two_equal_alarms_are_both_printed(plan: Plan) -> None:
    first, second = ShownEvent(1.0, "alarm", "hot"), ShownEvent(1.0, "alarm", "hot")
    lines = told(
        plan,
        View("r", "running", 1.0, happenings=(first,)),
        View("r", "running", 2.0, happenings=(first, second)),
    )
    assert len(lines) == 2


def test_each_record_is_named_with_its_conditions(plan: Plan) -> None:
    seen = View("r", "running", 100.0, path=EXTEND, record=9, records_done=9, records_total=28)
    lines = told(plan, seen, seen)
    assert lines == ["0:01:40  record 10 of 28: stroke at oil=40 degC, supply=30 bar"]


def test_progress_is_printed_in_tenths(plan: Plan) -> None:
    views = [
        View("r", "running", 10.0 * i, progress=i / 100, time_left=1000.0 - 10.0 * i) for i in range(100)
    ]
    lines = told(plan, *views)
    assert len(lines) == 9
    assert lines[0] == "0:01:40  10% done, about 15 min left"


def test_a_failure_is_printed_with_its_reason(plan: Plan) -> None:
    failed = ShownEvent(9.0, "state", "failed")
    lines = told(plan, View("r", "failed", 9.0, happenings=(failed,), message="heat timed out"))
    assert lines == ["0:00:09  failed: heat timed out"]


def test_no_control_sequence_is_printed(plan: Plan) -> None:
    lines = told(plan, View("r", "running", 0.0, happenings=(ShownEvent(0.0, "note", "\x1b[2J\x07bell"),)))
    assert lines == ["0:00:00  note: \ufffd[2J\ufffdbell"]


def test_a_closed_pipe_does_not_end_the_run(plan: Plan) -> None:
    stream = io.StringIO()
    display = PlainDisplay(plan, stream)
    stream.close()
    display(View("r", "running", 0.0, happenings=(ShownEvent(0.0, "state", "running"),)))


def test_times_are_hours_minutes_seconds() -> None:
    assert stamp(3723.9) == "1:02:03"
