"""What a run tells at its end and meanwhile: its result, its messages, and what a display shows."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rigctl.backends.errors import OutputsNotSafe
from rigctl.backends.protocol import Sample
from rigctl.clock import ScaledClock, VirtualClock
from rigctl.dataset import RunWriter, open_run
from rigctl.errors import ExitCode, RigctlError
from rigctl.runner.operators.requests import Request
from rigctl.runner.recorder import Unrecorded
from rigctl.runner.session import RunResult
from run_workshop import ScriptedControl, Workshop

Do = Callable[..., Any]
FAILS = "wait: {until: position > 100 mm, timeout: 1 s}"


class Around:
    """A part of a run, of which some methods are replaced."""

    def __init__(self, inner: Any, **replaced: Any) -> None:
        self._inner = inner
        self.__dict__ |= replaced

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


def raising(error: Exception) -> Callable[..., Any]:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    return fail


# --- the result ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reason", "folder", "records", "line"),
    [
        (None, None, 0, "finished"),
        ("no bench", None, 0, "finished: no bench"),
        (None, Path("runs/heat"), 1, "heat finished, 1 record"),
        ("too hot", Path("runs/heat"), 2, "heat finished, 2 records: too hot"),
    ],
)
def test_a_result_is_one_line(reason: str | None, folder: Path | None, records: int, line: str) -> None:
    result = RunResult("finished", reason, ExitCode.DONE, folder, records, 1.0)
    assert result.summary() == line
    assert line in repr(result)


def test_a_run_that_is_not_recorded_has_no_folder_and_no_verdict(workshop: Workshop) -> None:
    done = workshop.run("steps:\n  - wait: 1 s\n", writer=Unrecorded(lambda *_, **__: None))
    assert (done.result.status, done.result.reason, done.result.exit_code) == (
        "finished",
        None,
        ExitCode.DONE,
    )
    assert (done.result.folder, done.result.test, done.result.records) == (None, None, 0)


def test_a_failed_step_is_named_with_its_line(do: Do) -> None:
    done = do(f"steps:\n  - wait: 1 s\n  - {FAILS}\n")
    where, _, reason = str(done.result.reason).partition(": ")
    assert "4" in where
    assert "did not come true" in reason
    assert open_run(done.result.folder).info["reason"] == done.result.reason


@pytest.mark.parametrize(("many", "more"), [(1, ""), (2, ", and 1 more"), (3, ", and 2 more")])
def test_missed_limits_are_told_and_counted(do: Do, many: int, more: str) -> None:
    measure = (
        "  - measure: {{name: m{0}, value: mean(position), last: 1 s, unit: mm, low: 1 mm, high: 2 mm, "
        "missed: continue}}\n"
    )
    done = do("steps:\n  - wait: 2 s\n" + "".join(measure.format(number) for number in range(many)))
    assert (done.result.status, done.result.exit_code) == ("finished", ExitCode.FAILED)
    assert str(done.result.reason).startswith("a measure lay outside its limits: m0")
    assert str(done.result.reason).endswith(more or "2 mm")
    assert (" more" in str(done.result.reason)) is (many > 1)
    assert done.result.test.result != "pass"


# --- closing -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "told"), [(OSError("the port is gone"), "the port is gone"), (OSError(), "OSError()")]
)
def test_why_a_bench_could_not_be_let_go_is_logged(workshop: Workshop, error: Exception, told: str) -> None:
    bench = Around(workshop.backend(workshop.rig()), close=raising(error))
    done = workshop.run("steps:\n  - wait: 1 s\n", backend=bench)
    assert done.result.status == "finished"
    assert done.messages("fault") == [f"the bench could not be let go: {told}"]


@pytest.mark.parametrize(
    ("steps", "error", "reason"),
    [
        ("wait: 1 s", RigctlError("the disk is full"), "the disk is full"),
        (FAILS, RigctlError("the disk is full"), "{why}; the disk is full"),
        (FAILS, RigctlError("did not come true"), "{why}"),
        (
            "wait: 1 s",
            ValueError("no such column"),
            "the data could not be closed: ValueError('no such column')",
        ),
    ],
)
def test_data_that_cannot_be_closed_fail_the_run_and_are_told_once(
    workshop: Workshop, steps: str, error: Exception, reason: str
) -> None:
    text = f"steps:\n  - {steps}\n"
    plan = workshop.plan(text)
    backend = workshop.backend(plan.rig)
    writer = RunWriter.create(workshop.folder / "runs", workshop.header(plan, backend))
    plain = Workshop(workshop.folder / "other").run(text).result
    done = workshop.run(text, backend=backend, writer=Around(writer, close=raising(error)))
    assert (done.result.status, done.result.exit_code) == ("failed", ExitCode.FAILED)
    assert done.result.reason == reason.format(why=plain.reason)
    writer.close("failed")


def test_an_aborted_run_whose_data_cannot_be_closed_stays_aborted(workshop: Workshop) -> None:
    plan = workshop.plan("steps:\n  - wait: 5 s\n")
    backend = workshop.backend(plan.rig)
    writer = RunWriter.create(workshop.folder / "runs", workshop.header(plan, backend))
    unwritable = Around(writer, close=raising(RigctlError("the disk is full")))
    control = ScriptedControl([(0.5, Request.ABORT)])
    result = workshop.run(
        "steps:\n  - wait: 5 s\n", backend=backend, writer=unwritable, control=control
    ).result
    assert (result.status, result.exit_code) == ("aborted", ExitCode.INTERRUPTED)
    assert result.reason == "ended by a test; the disk is full"
    writer.close("aborted")


def test_controls_are_closed_whatever_one_of_them_does(do: Do) -> None:
    closed: list[str] = []
    broken = Around(ScriptedControl(), close=raising(OSError("no terminal")))
    sound = Around(ScriptedControl(), close=lambda: closed.append("closed"))
    assert do("steps:\n  - wait: 1 s\n", controls=[broken, sound]).result.status == "finished"
    assert closed == ["closed"]


@pytest.mark.parametrize(("back", "unconfirmed"), [(3.0, None), (60.0, "heater on")])
def test_a_bench_that_is_lost_at_the_end_is_tried_for_three_seconds(
    workshop: Workshop, back: float, unconfirmed: str | None
) -> None:
    """It is back in time, or the run ends and says what may still be on."""
    inner = workshop.backend(workshop.rig(), VirtualClock())

    def safe() -> None:
        if 1.0 < inner.clock.now() < back:
            raise OutputsNotSafe("no contact", {"heater": 1.0})
        inner.safe()

    bench = Around(inner, safe=safe)
    done = workshop.run("steps:\n  - set: {heater: on}\n  - wait: 2 s\n", backend=bench)
    assert done.result.unconfirmed == unconfirmed
    assert done.result.status == ("finished" if unconfirmed is None else "failed")
    assert done.result.duration == pytest.approx(3.0 if unconfirmed is None else 5.2, abs=0.4)
    assert (done.result.by_hand is None) is (unconfirmed is None)
    if unconfirmed is not None:
        assert "by hand" in str(done.result.by_hand)
        assert done.messages("fault")[-1].startswith("OUTPUTS NOT CONFIRMED SAFE: heater on")
        assert open_run(done.result.folder).info["unconfirmed"] == "heater on"


def test_a_bench_whose_line_breaks_while_it_is_tried_is_given_up(workshop: Workshop) -> None:
    inner = workshop.backend(workshop.rig(), VirtualClock())
    ended: list[float] = []

    def safe() -> None:
        if inner.clock.now() > 1.0:
            ended.append(inner.clock.now())
            raise OutputsNotSafe("no contact", {"heater": 1.0})
        inner.safe()

    def next_sample(timeout: float) -> Sample | None:
        if ended:
            raise OSError("the line is broken")
        sample: Sample | None = inner.next_sample(timeout)
        return sample

    bench = Around(inner, safe=safe, next_sample=next_sample)
    done = workshop.run("steps:\n  - set: {heater: on}\n  - wait: 2 s\n", backend=bench)
    assert (done.result.status, done.result.unconfirmed) == ("failed", "heater on")
    assert "the bench is not looked for any longer: the line is broken" in done.messages("fault")
    assert done.result.duration < 3.0


def test_a_further_signal_ends_the_tries_to_reach_a_lost_bench(workshop: Workshop) -> None:
    inner = workshop.backend(workshop.rig(), VirtualClock())
    tries: list[float] = []

    def safe() -> None:
        if inner.clock.now() > 1.0:
            tries.append(inner.clock.now())
            if len(tries) == 4:
                signal.raise_signal(signal.SIGINT)
            raise OutputsNotSafe("no contact", {"heater": 1.0})
        inner.safe()

    bench = Around(inner, safe=safe)
    done = workshop.run("steps:\n  - set: {heater: on}\n  - wait: 2 s\n", backend=bench)
    assert (done.result.status, done.result.unconfirmed) == ("failed", "heater on")
    assert len(tries) == 4
    assert done.result.duration < 3.0


@pytest.mark.parametrize(("slept", "status"), [(0.3, "finished"), (0.7, "failed")])
def test_half_a_second_of_suspension_ends_a_run(workshop: Workshop, slept: float, status: str) -> None:
    """What is shorter is how exactly the suspension of a computer is known."""
    wall = [0.0]

    def sleep(seconds: float) -> None:
        wall[0] += seconds

    clock = ScaledClock(
        monotonic=lambda: wall[0], sleep=sleep, suspension=lambda: slept if wall[0] > 2.0 else 0.0
    )
    backend = workshop.backend(workshop.rig(), clock=clock)
    done = workshop.run("steps:\n  - wait: 4 s\n", backend=backend)
    assert done.result.status == status


# --- what a display shows ------------------------------------------------------------------------------


def test_a_display_shows_step_values_commands_and_records(do: Do) -> None:
    control = ScriptedControl()
    steps = (
        "steps:\n  - set: {heater: on}\n  - record: {name: r, rate: 10 Hz}\n    do: [wait: 2 s]\n"
        "  - wait: 1 s\n"
    )
    done = do(steps, control=control)
    views = control.views
    assert [view.state for view in views][-1] == "finished"
    recording = [view for view in views if view.record == 0]
    assert recording
    assert {view.records_done for view in recording} == {0}
    assert {view.records_total for view in views} == {1}
    assert all(view.label == "wait 2 s" for view in recording[2:])
    assert all(view.commands["heater"] == 1.0 for view in recording)
    assert views[-1].records_done == 1
    assert views[-1].commands["heater"] == 0.0
    assert views[-1].run == done.result.folder.name
    newest = recording[-1]
    assert set(newest.values) == set(done.rig.layout.channels)
    assert newest.values["position"] == pytest.approx(0.0, abs=1e-3)
    assert newest.values["oil_temperature"] > 250.0
    assert views[0].values == {} or set(views[0].values) == set(newest.values)
    assert all(view.question is None and view.asked is None for view in views)
    assert not any(view.remote for view in views)
    assert {view.unconfirmed for view in views[-1:]} == {None}
    assert views[-1].message == ""


def test_a_display_shows_why_a_run_ends_while_its_cleanup_goes_on(do: Do) -> None:
    control = ScriptedControl([(0.5, Request.ABORT)])
    do("steps:\n  - set: {heater: on}\n  - wait: 5 s\nfinally:\n  - wait: 1 s\n", control=control)
    ending = [view for view in control.views if view.state == "finishing"]
    assert {view.message for view in ending} == {"ended by a test"}
    assert {view.unconfirmed for view in ending} == {None}
    assert all(view.commands["heater"] == 0.0 for view in ending)


def test_a_display_shows_the_question_and_what_is_typed(workshop: Workshop) -> None:
    class Typing:
        name, typed, present = "Ada", "ye", True

        def ask(self, _: object) -> None: ...

        def withdraw(self, _: object) -> None: ...

    control = ScriptedControl([(3.0, Request.ABORT)])
    workshop.run("steps:\n  - prompt: Is the door closed?\n", operator=Typing(), control=control)
    asked = [view for view in control.views if view.asked]
    assert asked
    assert asked[-1].asked.startswith("Is the door closed?")
    assert asked[-1].question == f"{asked[-1].asked} ye"
    assert control.views[-1].question is None


def test_an_observer_is_called_until_it_fails_and_the_run_goes_on(do: Do) -> None:
    seen: list[float] = []

    def broken(view: Any) -> None:
        seen.append(view.time)
        if len(seen) == 3:
            raise RuntimeError("no terminal")

    done = do("steps:\n  - wait: 1 s\n", observer=broken)
    assert (done.result.status, len(seen)) == ("finished", 3)


def test_a_display_that_fails_after_the_end_is_not_logged(do: Do) -> None:
    def broken(view: Any) -> None:
        if view.state == "finished":
            raise RuntimeError("no terminal")

    done = do("steps:\n  - wait: 1 s\n", observer=broken)
    assert done.result.status == "finished"
    assert not [text for text in done.messages("note") if "display failed" in text]


def test_warnings_of_the_disk_are_logged_and_shown(workshop: Workshop) -> None:
    plan = workshop.plan("steps:\n  - wait: 1 s\n")
    backend = workshop.backend(plan.rig)
    writer = RunWriter.create(workshop.folder / "runs", workshop.header(plan, backend))
    waiting = [["the disk is slow"], []]
    slow = Around(writer, warnings=lambda: waiting.pop(0) if waiting else [])
    control = ScriptedControl()
    done = workshop.run("steps:\n  - wait: 1 s\n", backend=backend, writer=slow, control=control)
    assert done.messages("note").count("the disk is slow") == 1
    assert "the disk is slow" in [one.message for view in control.views for one in view.happenings]


# --- requests and signals ------------------------------------------------------------------------------


def test_requests_are_logged_and_each_is_answered(do: Do) -> None:
    class Twice(ScriptedControl):
        """Asks for a pause again while the run is paused, and then to go on."""

        def poll(self) -> list[Any]:
            if self.views and self.views[-1].state == "paused":
                self.orders += [(0.0, Request.PAUSE), (0.0, Request.CONTINUE)]
            return super().poll()

    control = Twice([(1.0, Request.PAUSE)])
    done = do("steps:\n  - wait: 3 s\n", control=control)
    assert control.answers[:3] == ["paused, outputs are safe", "the run is paused already", "the run goes on"]
    said = [event["message"] for event in done.events("operator")]
    assert said[:3] == [
        "pause asked for by a test",
        "pause asked for by a test",
        "continue asked for by a test",
    ]


def test_a_signal_during_the_last_cleanup_lets_it_go_on_and_a_second_skips_it(do: Do) -> None:
    def when(*times: float) -> Callable[[Any], None]:
        left = list(times)

        def observer(view: Any) -> None:
            if left and view.time > left[0]:
                left.pop(0)
                signal.raise_signal(signal.SIGINT)

        return observer

    steps = (
        "steps:\n  - wait: 1 s\nfinally:\n  - set: {heater: on}\n  - wait: 20 s\n  - prompt: end of cleanup\n"
    )
    once = do(steps, observer=when(3.0))
    assert once.result.status == "finished"
    assert any("cleanup goes on; a second one skips it" in text for text in once.messages("note"))
    assert "end of cleanup" in [event.get("message") for event in once.log]
    twice = do(steps, observer=when(3.0, 5.0))
    assert (twice.result.status, twice.result.exit_code) == ("aborted", ExitCode.INTERRUPTED)
    assert twice.result.duration < 6.0
    assert "end of cleanup" not in [event.get("message") for event in twice.log]
    assert [value for _, value in twice.commands("heater")] == [1.0, 0.0]


@pytest.mark.parametrize(("lasts", "kept"), [(59.0, True), (61.0, False)])
def test_a_cleanup_step_has_a_minute(do: Do, lasts: float, kept: bool) -> None:
    done = do(f"steps:\n  - {FAILS}\nfinally:\n  - wait: {lasts} s\n  - prompt: end\n")
    told = [text for text in done.messages("note") if "cleanup step failed" in text]
    assert bool(told) is not kept
    if not kept:
        assert "a cleanup step took longer than 60 s" in told[0]
    assert "end" in [event.get("message") for event in done.log]
