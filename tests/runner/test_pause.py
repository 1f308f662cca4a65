"""A paused run has safe outputs; its current step restarts when the run continues."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from rigctl.runner.operators.requests import Request
from run_workshop import ScriptedControl

Do = Callable[..., Any]


class Person(ScriptedControl):
    """Pauses at a bench time and continues the run as soon as it is paused."""

    def poll(self) -> list[Any]:
        if self.views and self.views[-1].state == "paused":
            self.orders.append((0.0, Request.CONTINUE))
        return super().poll()


def test_outputs_are_safe_while_paused_and_the_step_then_restarts(do: Do) -> None:
    person = Person([(2.0, Request.PAUSE)])
    done = do("steps:\n  - set: {heater: on}\n  - wait: 5 s\n", control=person)
    assert done.result.status == "finished"
    assert [value for _, value in done.commands("heater")] == [1.0, 0.0, 1.0, 0.0]
    assert person.answers[:2] == ["paused, outputs are safe", "the run goes on"]
    assert done.result.duration == pytest.approx(9.0, abs=0.2)  # 2 s of rest for the heater, and 5 s
    assert done.states == ["arming", "running", "paused", "running", "finishing", "finished"]


def test_a_pause_waits_for_the_end_of_the_record(do: Do) -> None:
    person = Person([(1.0, Request.PAUSE)])
    steps = "steps:\n  - record: {name: stroke}\n    do:\n      - wait: 3 s\n  - wait: 1 s\n"
    done = do(steps, control=person)
    assert [outcome for _, outcome in done.records] == ["complete"]
    assert person.answers[0] == "pausing at the end of the record"
    assert person.answers[0] in [seen.message for view in person.views for seen in view.happenings]
    assert person.answers[1] == "paused, outputs are safe"
    paused = next(e["time"] for e in done.events("state") if e["state"] == "paused")
    assert paused == pytest.approx(3.2, abs=0.02)


def test_a_timed_move_keeps_its_full_duration_when_a_pause_is_requested(do: Do) -> None:
    person = Person([(0.5, Request.PAUSE)])
    done = do("steps:\n  - extend: {for: 1 s}\n  - wait: 1 s\n", control=person)
    assert [value for _, value in done.commands("valve")] == [1.0, 0.0]
    on, off = (time for time, _ in done.commands("valve"))
    assert off - on == pytest.approx(1.0, abs=1e-9)
    assert "paused" in done.states


def test_a_run_pauses_again_after_it_was_continued(do: Do) -> None:
    person = Person([(1.0, Request.PAUSE), (1.5, Request.PAUSE)])
    done = do("steps:\n  - wait: 5 s\n", control=person)
    assert done.result.status == "finished"
    assert done.states.count("paused") == 2


def test_continuing_a_run_that_is_not_paused_is_answered_with_a_message(do: Do) -> None:
    control = ScriptedControl([(0.5, Request.CONTINUE)])
    do("steps:\n  - wait: 1 s\n", control=control)
    assert control.answers == ["the run is not paused"]


def test_a_paused_run_can_be_aborted(do: Do) -> None:
    class Impatient(ScriptedControl):
        def poll(self) -> list[Any]:
            if self.views and self.views[-1].state == "paused":
                self.orders.append((0.0, Request.ABORT))
            return super().poll()

    done = do("steps:\n  - wait: 5 s\n", control=Impatient([(1.0, Request.PAUSE)]))
    assert done.result.status == "aborted"
    assert done.states == ["arming", "running", "paused", "safe", "finishing", "aborted"]
