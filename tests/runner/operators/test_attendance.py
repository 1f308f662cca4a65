"""A run that waits for a person with outputs on, and nobody is there: the wait has a bound."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rigctl.backends.errors import OutputsNotSafe
from rigctl.clock import ScaledClock
from rigctl.plan.behaviour import Answer, Question
from rigctl.rig import Rig
from rigctl.runner.operators.remote_control import CONTROL_NAME
from rigctl.runner.operators.remote_operator import PRESENCE_EVERY, RemoteOperator, send_presence
from rigctl.runner.operators.requests import Request
from rigctl.runner.snapshot import View
from run_workshop import Done, ScriptedControl, Workshop

HEATER_ON = "steps:\n  - set: {heater: on}\n  - prompt: Is the door closed?\n"


class Person:
    """Is there at some times of the bench, and answers at one."""

    name = "Ada"
    typed = ""

    def __init__(self, *gone: tuple[float, float], answers_at: float = float("inf")) -> None:
        self.bench: Any = None
        self._gone = gone
        self._answers_at = answers_at

    @property
    def present(self) -> bool:
        return not any(begin <= self.bench.clock.now() < end for begin, end in self._gone)

    def ask(self, question: Question) -> Answer | None:
        return Answer("done") if self.bench.clock.now() >= self._answers_at else None

    def withdraw(self, question: Question) -> None: ...


def carried_out(workshop: Workshop, steps: str, person: Person, **more: Any) -> Done:
    rig = more.pop("rig", None) or workshop.rig()
    person.bench = more.pop("backend", None) or workshop.backend(rig)
    return workshop.run(steps, rig=rig, backend=person.bench, operator=person, **more)


def bound_of(workshop: Workshop, bound: str = "30 s") -> Rig:
    return workshop.rig("monitor_rate:", f"unattended_for: {bound}\nmonitor_rate:")


def said(done: Done) -> list[tuple[float, str]]:
    return [
        (event["time"], event["message"]) for event in done.events("operator") if "body" in event["message"]
    ]


def test_a_question_that_nobody_can_answer_ends_the_run_with_outputs_off(workshop: Workshop) -> None:
    cleanup = "finally:\n  - wait: 1 s\n"
    done = carried_out(workshop, HEATER_ON + cleanup, Person((100.0, float("inf"))))
    reason = "'Is the door closed?' was not answered, and nobody was there for 10 min, with heater on"
    assert done.result.status == "failed"
    assert done.result.exit_code == 1
    assert done.result.reason is not None
    assert done.result.reason.endswith(reason)
    assert done.states == ["arming", "running", "safe", "finishing", "failed"]
    (_, on), (switched_off, off) = done.commands("heater")
    assert (on, off) == (1.0, 0.0)
    assert switched_off == pytest.approx(700.0, abs=0.3)
    ((noticed, text),) = said(done)
    assert noticed == pytest.approx(105.0, abs=0.3)
    assert text == "nobody is there, with heater on: the run ends in 9 min 55 s unless somebody returns"


def test_the_bound_is_that_of_the_rig_file(workshop: Workshop) -> None:
    done = carried_out(workshop, HEATER_ON, Person((0.0, float("inf"))), rig=bound_of(workshop))
    (began, _), (switched_off, _) = done.commands("heater")
    assert switched_off - began == pytest.approx(30.0, abs=0.3)
    assert "nobody was there for 30 s" in (done.result.reason or "")


def test_a_short_bound_is_told_at_its_half(workshop: Workshop) -> None:
    done = carried_out(workshop, HEATER_ON, Person((0.0, float("inf"))), rig=bound_of(workshop, "6 s"))
    (began, _), (switched_off, _) = done.commands("heater")
    assert switched_off - began == pytest.approx(6.0, abs=0.3)
    ((noticed, text),) = said(done)
    assert noticed - began == pytest.approx(3.0, abs=0.3)
    assert "the run ends in 3 s unless somebody returns" in text


def test_somebody_who_returns_in_time_has_the_whole_time_again(workshop: Workshop) -> None:
    person = Person((10.0, 39.0), (45.0, 74.0), answers_at=200.0)
    done = carried_out(workshop, HEATER_ON, person, rig=bound_of(workshop))
    assert done.result.status == "finished"
    assert [text.partition(",")[0] for _, text in said(done)] == [
        "nobody is there",
        "somebody is there again",
    ] * 2
    assert [value for _, value in done.commands("heater")] == [1.0, 0.0]  # at the end of the run


def test_with_all_outputs_safe_a_question_waits_for_as_long_as_it_takes(workshop: Workshop) -> None:
    person = Person((0.0, float("inf")), answers_at=300.0)
    steps = "steps:\n  - prompt: Is the door closed?\n"
    done = carried_out(workshop, steps, person, rig=bound_of(workshop))
    assert done.result.status == "finished"
    assert said(done) == []


def test_a_record_in_which_nobody_answered_is_not_complete(workshop: Workshop) -> None:
    steps = (
        "steps:\n  - set: {heater: on}\n  - record: {name: r, rate: 1 Hz}\n    do:\n"
        "      - prompt: {question: How much?, name: x, unit: s}\n"
    )
    done = carried_out(workshop, steps, Person((0.0, float("inf"))))
    assert [outcome for _, outcome in done.records] == ["timed_out"]


def test_a_page_is_there_for_three_of_its_signs(tmp_path: Path) -> None:
    folder = tmp_path / "20260101-000000-a"
    folder.mkdir()
    (folder / "run.json").write_text("{}", encoding="utf-8")
    now = [100.0]
    operator = RemoteOperator("Ada", tmp_path, lambda: now[0])
    operator.answers.publish(View(folder.name, "running", 1.0))
    seen = []
    for sign in (None, "present", None, "answer", "pause", "[]"):
        if sign == "present":
            send_presence(folder)
        elif sign is not None:
            with (folder / CONTROL_NAME).open("a", encoding="utf-8") as file:
                file.write(
                    sign if sign == "[]" else json.dumps({"request": sign, "question": "?", "text": ""})
                )
                file.write("\n")
        operator.answers.poll()
        seen.append(operator.present)
        now[0] += 3.0 * PRESENCE_EVERY
        seen.append(operator.present)
    assert seen == [True, False, True, False, False, False, True, False, False, False, False, False]


@pytest.mark.parametrize("gone", [True, False])
def test_a_pause_that_could_not_make_the_outputs_safe_has_the_bound(workshop: Workshop, gone: bool) -> None:
    """The bench stays on and continues to send samples; in real time, since virtual time stands still."""
    rig = bound_of(workshop).model_copy(update={"stale_after": 1e4})  # on a busy machine
    backend = workshop.backend(rig, ScaledClock(50.0))
    safe, refused = backend.safe, [0]

    class Impatient(ScriptedControl):
        """Pauses when the heater is on, and continues when the bound would have ended the run."""

        def poll(self) -> list[Any]:
            if not self.answers and self.views and self.views[-1].commands.get("heater"):
                self.orders.append((0.0, Request.PAUSE))
            if not gone and backend.clock.now() > 60.0:
                self.orders.append((0.0, Request.CONTINUE))
            return super().poll()

    def refuse() -> None:
        refused[0] += 1
        if refused[0] == 1:  # the pause
            raise OutputsNotSafe("the device ignores it", {"heater": 1.0})
        safe()

    backend.safe = refuse  # type: ignore[method-assign]
    person = Person(*([(0.0, float("inf"))] if gone else []))
    control = Impatient([])
    steps = "steps:\n  - set: {heater: on}\n  - wait: 100 s\n"
    done = carried_out(workshop, steps, person, rig=rig, backend=backend, control=control)
    assert done.result.status == ("failed" if gone else "finished")
    if gone:
        assert "nobody was there for 30 s, with heater on" in (done.result.reason or "")
    assert done.result.unconfirmed is None  # it was made safe at the end
    assert done.commands("heater")[-1][1] == 0.0
