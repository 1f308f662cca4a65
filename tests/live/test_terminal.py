"""A run on a terminal."""

from __future__ import annotations

import io
import threading
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from live.shipped import campaign
from rigctl.backends.protocol import Sample
from rigctl.live import MonitorDisplay, view
from rigctl.live.display import redrawable
from rigctl.live.plain import PlainDisplay
from rigctl.live.terminal import TerminalDisplay
from rigctl.plan import Plan
from rigctl.runner.interlocks import Alarm
from rigctl.runner.snapshot import ShownEvent, View

EXTEND = "2/for[oil=40 degC]/2/for[supply=30 bar]/1/call/3/record/2/extend"
VIEW = View(
    run="20261121-093000-stroke-campaign",
    state="running",
    time=3723.0,
    path=EXTEND,
    label="extend for 1.05 s",
    record=9,
    records_done=9,
    records_total=28,
    progress=0.34,
    time_left=4320.0,
    values={"oil_temperature": 313.15, "supply_pressure": 30e5, "position": 0.05},
    commands={"heater": 0.0, "valve": 1.0, "relief_valve": 30e5},
    happenings=(ShownEvent(3700.0, "state", "running"), ShownEvent(3720.0, "alarm", "The oil is hot")),
)


class Terminal(io.StringIO):
    """Something that claims to be a terminal."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


class StuckTerminal(Terminal):
    """A terminal whose reader has stopped: Ctrl-S, or a connection that hangs."""

    def __init__(self) -> None:
        super().__init__()
        self.flowing = threading.Event()
        self.flowing.set()
        self.stuck = threading.Event()

    def write(self, text: str) -> int:
        if not self.flowing.is_set():
            self.stuck.set()
            self.flowing.wait()
        return super().write(text)


@pytest.fixture(autouse=True)
def real_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")


def frame(display: TerminalDisplay | MonitorDisplay, width: int = 100) -> str:
    console = Console(file=io.StringIO(), width=width, height=40)
    console.print(display.render())
    return console.file.getvalue()  # type: ignore[attr-defined, no-any-return]


def test_a_frame_shows_state_progress_steps_values_and_events(plan: Plan) -> None:
    display = TerminalDisplay(plan, Terminal(), hint="p pause")
    assert frame(display).strip() == ""
    display(VIEW)
    shown = frame(display)
    for part in (
        "stroke campaign on HL32 bench  running  1:02:03",
        "34%",
        "record 10 of 28",
        "about 1 h 12 min left",
        "▶ extend for 1.05 s",
        "oil=40 degC  3 of 7",
        "50.0 mm",
        "extend",
        "alarm: The oil is hot",
        "p pause",
    ):
        assert part in shown


def test_the_progress_fits_a_narrow_terminal(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 60 columns the word `left` used to be wrapped onto its own line."""
    monkeypatch.setenv("COLUMNS", "60")
    display = TerminalDisplay(plan, Terminal())
    display(replace(VIEW, record=-1, records_done=0, records_total=10))
    assert "0 of 10 records  about 1 h 12 min left" in frame(display, 60)


def test_the_open_question_is_shown_near_the_top(plan: Plan) -> None:
    display = TerminalDisplay(plan, Terminal())
    display(View("r", "running", 0.0, question="Turn the relief valve until it reads 30 bar"))
    assert "Turn the relief valve" in "".join(frame(display).splitlines(keepends=True)[:5])


def test_texts_cannot_send_control_sequences_to_the_terminal(plan: Plan) -> None:
    display = TerminalDisplay(plan, Terminal())
    evil = "\x1b]0;title\x07[red]x"
    display(
        View("r", "running", 0.0, question=evil, message=evil, happenings=(ShownEvent(0.0, "note", evil),))
    )
    shown = frame(display)
    assert "\x1b" not in shown
    assert "\x07" not in shown
    assert "[red]x" in shown


@settings(max_examples=60)
@given(
    state=st.text(max_size=8),
    path=st.sampled_from([EXTEND, "", "nowhere"]),
    progress=st.floats(0.0, 1.0),
    left=st.none() | st.floats(0.0, 1e6),
    record=st.integers(-1, 30),
    total=st.integers(0, 30),
    value=st.floats(allow_nan=True, allow_infinity=True),
    width=st.integers(10, 200),
)
def test_any_view_can_be_drawn(
    state: str,
    path: str,
    progress: float,
    left: float | None,
    record: int,
    total: int,
    value: float,
    width: int,
) -> None:
    display = TerminalDisplay(campaign(), Terminal())
    values = {"position": value, "oil_temperature": value}
    alarm = Alarm(0.0, "over_travel", "position", "stop", "too far", value)
    display(
        View(
            "r",
            state,
            0.0,
            path,
            "",
            record,
            0,
            total,
            progress,
            left,
            values,
            {"valve": value},
            (alarm,),
            (),
        )
    )
    frame(display, width)


def test_a_stuck_terminal_does_not_hold_up_the_run(plan: Plan) -> None:
    terminal = StuckTerminal()
    with TerminalDisplay(plan, terminal) as display:
        display(VIEW)
        terminal.flowing.clear()
        assert terminal.stuck.wait(60.0)  # the drawing thread hangs in a write now
        for _ in range(1000):
            display(VIEW)
        terminal.flowing.set()
    assert "running" in terminal.getvalue()


def test_the_last_view_stays_on_the_screen(plan: Plan) -> None:
    terminal = Terminal()
    with TerminalDisplay(plan, terminal) as display:
        display(View("r", "failed", 1.0, message="heat timed out"))
    assert "heat timed out" in terminal.getvalue()
    assert terminal.getvalue().rstrip().endswith("\x1b[?25h")  # the cursor is back


def test_output_that_cannot_be_redrawn_is_printed_as_lines(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert isinstance(view(plan, Terminal()), TerminalDisplay)
    assert isinstance(view(plan, io.StringIO()), PlainDisplay)
    monkeypatch.setenv("TERM", "dumb")
    assert isinstance(view(plan, Terminal()), PlainDisplay)
    closed = io.StringIO()
    closed.close()
    assert not redrawable(closed)


def test_the_monitor_shows_readings_and_alarms_in_a_table(plan: Plan) -> None:
    terminal = Terminal()
    alarm = Alarm(0.0, "oil_hot", "oil_temperature", "warn", "The oil is hot", 360.0)
    sample = Sample(61.0, (360.0, 30e5, 0.05), (0.0, 0.0, 30e5))
    with MonitorDisplay(plan.rig, terminal) as display:
        display(sample, [alarm])
        raised = frame(display)
        display(sample, [])
        assert "The oil is hot" in frame(display)  # an alarm stays until its cause is gone
        display(sample, [replace(alarm, active=False)])
        cleared = frame(display)
    assert "HL32 bench  0:01:01" in raised
    assert "86.9 degC" in raised
    assert "The oil is hot" in raised
    assert "The oil is hot" not in cleared
    assert "86.9 degC" in terminal.getvalue()


def test_the_last_frame_of_a_finished_run_is_settled() -> None:
    """It used to show the keys, a step as the current one, and the time left of nothing."""
    screen = Terminal()
    display = TerminalDisplay(campaign(), screen, hint="p pause")
    with display:
        display(VIEW)
        display(replace(VIEW, state="finished", progress=1.0, time_left=0.0, record=-1, records_done=28))
    shown = Console(file=io.StringIO(), width=100)
    with shown.capture() as captured:
        shown.print(display.render())
    last = captured.get()
    assert "finished" in last
    assert "28 of 28 records" in last
    assert "40.0 degC" in last  # what was read last
    for unsettled in ("▶", ">", "p pause", "left"):
        assert unsettled not in last
