"""The operator at the terminal: answers and keys, from a pseudo-terminal where available."""

from __future__ import annotations

import io
import os
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.cli.attended_run import attended
from rigctl.errors import RigctlError
from rigctl.plan.behaviour import Question
from rigctl.runner.launch import Launch
from rigctl.runner.operators.automatic_operator import AutomaticOperator, ScriptedOperator
from rigctl.runner.operators.console import Console
from rigctl.runner.operators.keys import _PosixKeys, input_is_empty, is_terminal, open_keys
from rigctl.runner.operators.operator import read_answer
from rigctl.runner.operators.requests import Request
from run_workshop import Workshop
from systems import needs_posix

TIME = Question("Flow time?", name="flow_time", unit="s", low=1.0, high=600.0)


class Typed:
    """Keys from a list."""

    interactive = True
    ended = False

    def __init__(self, *typed: str) -> None:
        self.waiting = list(typed)
        self.closed = False

    def read(self) -> str:
        return self.waiting.pop(0) if self.waiting else ""

    def close(self) -> None:
        self.closed = True


def test_keys_are_requests_while_no_question_is_open() -> None:
    console = Console("me", write=None, keys=Typed("px", "C", "a"))
    assert [[order.request for order in console.poll()] for _ in range(4)] == [
        [Request.PAUSE],
        [Request.CONTINUE],
        [Request.ABORT],
        [],
    ]


def test_text_typed_while_a_question_is_open_is_its_answer() -> None:
    shown: list[str] = []
    console = Console("me", write=shown.append, keys=Typed("", "4", "2x\x7f.", "5 s", "\n", "p"))
    assert [console.ask(TIME) for _ in range(3)] == [None] * 3
    assert console.typed == "42."
    assert console.ask(TIME) is None
    answer = console.ask(TIME)
    assert answer is not None
    assert (answer.value, answer.text) == (42.5, "42.5 s")
    assert shown[0] == "Flow time? [s, 1 s to 600 s] "
    assert [order.request for order in console.poll()] == [Request.PAUSE]


def test_an_invalid_answer_is_asked_for_again() -> None:
    shown: list[str] = []
    console = Console("me", write=shown.append, keys=Typed("5 bar\n", "9999\n", "50\n"))
    assert console.ask(TIME) is None
    assert "wrong dimension" in console.typed
    assert console.ask(TIME) is None
    answer = console.ask(TIME)
    assert answer is not None
    assert answer.value == 50.0
    assert sum("out of range" in text for text in shown) == 1


def test_a_notice_is_shown_once_and_keys_stay_requests() -> None:
    shown: list[str] = []
    console = Console("me", write=shown.append, keys=Typed("a"))
    notice = Question("Turn the relief valve", notice=True)
    assert console.ask(notice) is None
    assert console.ask(notice) is None
    assert shown == ["Turn the relief valve\n"]
    assert [order.request for order in console.poll()] == [Request.ABORT]
    console.withdraw(notice)


def test_answers_from_a_file_keep_their_order() -> None:
    keys = open_keys(io.StringIO("12\n13 s\n"))
    console = Console("me", write=None, keys=keys)
    give_up = time.monotonic() + 60.0
    while not keys.ended:  # they are read by a thread
        assert time.monotonic() < give_up
        time.sleep(0.005)
    assert console.poll() == []
    other = Question("Again?", name="again", unit="s")
    values = []
    for question in (TIME, other):
        answer = console.ask(question)
        assert answer is not None
        values.append(answer.value)
    assert values == [12.0, 13.0]


def test_a_question_without_a_possible_answer_is_an_error() -> None:
    with Console("me", write=None, keys=open_keys(io.StringIO(""))) as console:
        give_up = time.monotonic() + 60.0
        with pytest.raises(RigctlError, match=r"nobody can answer 'Flow time\?'"):
            while time.monotonic() < give_up:
                assert console.ask(TIME) is None


def test_an_input_from_which_nothing_comes_is_recognised(tmp_path: Path) -> None:
    file = tmp_path / "answers"
    file.write_text("12 s\n", encoding="utf-8")
    with file.open(encoding="utf-8") as answers, Path(os.devnull).open(encoding="utf-8") as null:
        assert not input_is_empty(answers)
        assert input_is_empty(null)
    assert input_is_empty(answers)  # closed
    file.write_text("", encoding="utf-8")
    with file.open(encoding="utf-8") as answers:
        assert input_is_empty(answers)
    there, here = os.pipe()  # somebody may still write to it
    with os.fdopen(there, encoding="utf-8") as pipe:
        with os.fdopen(here, "w") as writer:
            assert not input_is_empty(pipe)
            writer.write("12 s\n")
        assert not input_is_empty(pipe)  # nobody writes any more, but there is a line
        assert pipe.readline() == "12 s\n"
        assert input_is_empty(pipe)


def test_only_a_terminal_is_typed_into(tmp_path: Path) -> None:
    """Windows calls the null device a terminal: a run under a scheduler waited for keys there."""
    file = tmp_path / "answers"
    file.write_text("", encoding="utf-8")
    with Path(os.devnull).open(encoding="utf-8") as null, file.open(encoding="utf-8") as closed:
        assert not is_terminal(null)
        assert not is_terminal(closed)
    assert not is_terminal(closed)
    assert not is_terminal(None)
    assert not is_terminal(io.StringIO(""))


@needs_posix("a pseudo-terminal")
def test_a_terminal_is_typed_into() -> None:
    ours, theirs = os.openpty()
    with os.fdopen(ours, "rb"), os.fdopen(theirs, encoding="utf-8") as terminal:
        assert is_terminal(terminal)


@pytest.mark.parametrize(
    ("steps", "place"),
    [
        ("steps:\n  - wait: 1 s\n  - prompt: Is the guard closed?\n", "4:5"),
        ("steps:\n  - wait: 1 s\nfinally:\n  - prompt: Is it cold?\n", "5:5"),
        ("steps:\n  - set: {relief_valve: 20 bar}\n", "3:5"),
        ("steps:\n  - set_pressure: 20 bar\n  - set: {heater: on}\n", None),
    ],
)
def test_questions_that_nobody_can_answer_are_refused_before_the_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, workshop: Workshop, steps: str, place: str | None
) -> None:
    """At the first of them the run had begun, at night."""
    plan = workshop.plan(steps)
    how = Launch(runs=tmp_path, operator=AutomaticOperator(), backend="serial")
    with Path(os.devnull).open(encoding="utf-8") as null:
        monkeypatch.setattr(sys, "stdin", null)
        refused = nullcontext() if place is None else pytest.raises(RigctlError, match="nobody can answer")
        with refused as error, attended(how, plan, {}):
            pass
        if error is not None:
            assert f":{place}: " in f":{error.value}"
        with attended(replace(how, backend="simulated"), plan, {}):  # its operator is simulated too
            pass
        with attended(replace(how, dry=True), plan, {}):  # asks nothing
            pass


def test_bare_numbers_are_read_in_the_unit_of_the_question() -> None:
    question = Question("Oil?", name="oil", unit="degC", low=273.15, high=373.15)
    assert read_answer(question, "40").value == pytest.approx(313.15)
    assert read_answer(question, "313.15 K").value == pytest.approx(313.15)
    with pytest.raises(RigctlError, match="not a quantity"):
        read_answer(question, "warm")


@pytest.mark.parametrize("typed", ["nan", "NaN", "inf", "-inf", "1e400", "1e400 s"])
def test_an_answer_must_be_a_finite_number(typed: str) -> None:
    """NaN is neither below nor above any bound."""
    for low, high in ((1.0, 600.0), (None, None)):
        with pytest.raises(RigctlError):
            read_answer(Question("Time?", name="time", unit="s", low=low, high=high), typed)


def test_a_simulated_operator_answers_only_questions_with_a_default() -> None:
    operator = AutomaticOperator()
    answer = operator.ask(TIME)
    assert answer is not None
    assert answer.value == pytest.approx(300.5)
    with pytest.raises(RigctlError, match="does not know"):
        operator.ask(Question("Name?", name="n", unit="s"))


def test_a_scripted_operator_gives_its_prepared_answers_only() -> None:
    operator = ScriptedOperator({"flow_time": "40 s"})
    answer = operator.ask(TIME)
    assert answer is not None
    assert answer.value == 40.0
    with pytest.raises(RigctlError, match="no answer was given beforehand"):
        operator.ask(Question("Again?", name="again", unit="s"))


if sys.platform != "win32":

    def test_the_settings_of_a_terminal_are_restored() -> None:
        import pty
        import termios

        leader, follower = pty.openpty()
        with os.fdopen(follower, "r") as terminal:
            before = termios.tcgetattr(terminal.fileno())
            assert not open_keys(
                terminal
            ).interactive  # not the controlling terminal: reading it would stop the program
            keys = _PosixKeys(terminal.fileno())
            assert termios.tcgetattr(terminal.fileno()) != before
            os.write(leader, "pä".encode())
            typed = ""
            deadline = time.monotonic() + 60.0
            while len(typed) < 2 and time.monotonic() < deadline:
                typed += keys.read()
            assert typed == "pä"
            keys.close()
            keys.close()
            assert termios.tcgetattr(terminal.fileno()) == before
        os.close(leader)
