"""A remote operator: answers come through the same file as requests.

A run that was started from the web page has no terminal. Its questions are in its heartbeat, visible to all;
an answer is a line appended to `rigctl.runner.operators.remote_control.CONTROL_NAME`, which names its
question, so that an answer that arrives late is never taken for one to the next question.

`RemoteOperator` belongs to the loop's thread; `_Answers` is a control and reads the file in a thread of
its own. Between them is a deque. While a run waits, an open page adds a sign of its presence every
`PRESENCE_EVERY` s; their absence is what bounds the wait, see
docs/decisions/0145-unattended-waits-are-bounded.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import monotonic
from typing import Any, Final
from uuid import uuid4

from rigctl.dataset.recording.writer_lock import read_state
from rigctl.errors import ExitCode, RigctlError
from rigctl.json_values import parse_json
from rigctl.plan.behaviour import Answer, Question
from rigctl.runner.operators.appended_lines import AppendedLines
from rigctl.runner.operators.operator import read_answer
from rigctl.runner.operators.remote_control import CONTROL_NAME, sender, write_line
from rigctl.runner.operators.requests import Order
from rigctl.runner.snapshot import View

_ANSWER: Final = "answer"
_PRESENT: Final = "present"
#: s between two signs that a page shows a run which waits for a person
PRESENCE_EVERY: Final = 2.0
#: s of wall time after which, without one, no page is considered to be there
_GONE: Final = 3.0 * PRESENCE_EVERY


class RemoteOperator:
    """Passes on the answers that others write. `answers`, a `Control` for a thread, reads the file.

    Parameters
    ----------
    name: of the person in charge, for the run's events.
    runs: the folder of the runs.
    now: wall time, s.
    """

    def __init__(self, name: str, runs: Path, now: Callable[[], float] = monotonic) -> None:
        self.name = name
        self.typed = ""  #: why the last answer was refused
        self._queue: deque[tuple[str, str]] = deque(maxlen=20)
        self._question: Question | None = None
        self._now = now
        self.answers = _Answers(runs, self._queue, now)

    @property
    def present(self) -> bool:
        """Whether a page has lately shown that it is open, or somebody has answered."""
        return self._now() - self.answers.seen < _GONE

    def ask(self, question: Question) -> Answer | None:
        """The first answer to this question that fits it; None before there is one."""
        if question is not self._question:
            self._question, self.typed = question, ""
        if question.notice:
            return None
        while self._queue:
            about, text = self._queue.popleft()
            if about != str(question):
                continue  # it was meant for an earlier question
            try:
                answer = read_answer(question, text)
            except RigctlError as error:
                self.typed = f"({error})"
            else:
                self._question, self.typed = None, ""
                return answer
        return None

    def withdraw(self, question: Question) -> None:
        """Forget a question that is no longer open."""
        if question is self._question:
            self._question, self.typed = None, ""


class _Answers:
    """Reads answers and signs of a page from the run's file of requests; makes no requests itself."""

    def __init__(self, runs: Path, answers: deque[tuple[str, str]], now: Callable[[], float]) -> None:
        self._runs = runs
        self._queue = answers
        self._lines: AppendedLines | None = None
        self._now = now
        self.seen = now()  #: wall time of the newest sign of a person, s

    def poll(self) -> Sequence[Order]:
        """Take the answers since the last call."""
        for line in self._lines.read() if self._lines is not None else ():
            fields = _read_line(line)
            kind = fields.get("request")
            # Any other line may come from a script: it shows no person.
            if kind in (_ANSWER, _PRESENT):
                self.seen = self._now()
            if kind == _ANSWER:
                self._queue.append((str(fields.get("question")), str(fields.get("text"))))
        return ()

    def acknowledge(self, order: Order, message: str) -> None:
        """Nothing to acknowledge."""

    def publish(self, view: View) -> None:
        """Note the run's folder."""
        # Only now is the run's folder known; lines that were there before are those of an earlier session.
        if self._lines is None and view.run:
            from rigctl.dataset import find_run

            self._lines = AppendedLines(find_run(view.run, self._runs) / CONTROL_NAME)

    def close(self) -> None:
        """Nothing to close."""


def send_answer(folder: Path, question: str, text: str) -> None:
    """Answer the operator's question of a run whose heartbeat says that it accepts remote answers.

    Parameters
    ----------
    question: as the heartbeat has it.

    Raises
    ------
    RigctlError
        there is no question, the question has changed, or it is answered at a terminal.
    """
    state = read_state(folder)
    fields: dict[str, Any] = dict(state.fields) if state is not None and state.fresh else {}
    if not fields.get("question") or not fields.get("remote"):
        what = (
            "the question is answered where the run was begun"
            if fields.get("question")
            else "nothing is asked"
        )
        raise RigctlError(what, value=folder.name, exit_code=ExitCode.FAILED)
    current = str(fields["asked"])
    # The page may show a question that was answered at another window, or has timed out.
    if question != current:
        raise RigctlError(
            "something else is asked by now", value=question, expected=current, exit_code=ExitCode.FAILED
        )
    line = {
        "id": uuid4().hex,
        "request": _ANSWER,
        "question": current,
        "text": text[:1000],
        "source": sender("a browser"),
    }
    write_line(folder, line, "answer")


def send_presence(folder: Path) -> None:
    """Tell the run in `folder` that a page shows it; see `PRESENCE_EVERY`.

    Raises
    ------
    RigctlError
        the run's file of requests cannot be written.
    """
    write_line(folder, {"request": _PRESENT}, "sign of a page")


def awaits_person(state: Mapping[str, Any]) -> bool:
    """Whether a run's heartbeat says that it waits for somebody at a page."""
    return bool(state.get("remote")) and (bool(state.get("asked")) or state.get("state") == "paused")


def _read_line(line: bytes) -> Mapping[str, Any]:
    """The fields of a line; none of one that cannot be read: everybody with write access can add lines."""
    try:
        fields = parse_json(line)
    except (ValueError, RecursionError):
        return {}
    return fields if isinstance(fields, dict) else {}
