"""The person at the terminal: answers questions, and pauses or ends the run with a key."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from rigctl.errors import ExitCode, RigctlError
from rigctl.plan.behaviour import Answer, Question
from rigctl.runner.operators.keys import KEYS, Keys, open_keys
from rigctl.runner.operators.operator import read_answer
from rigctl.runner.operators.requests import Order
from rigctl.runner.snapshot import View

_BACKSPACE = ("\x7f", "\x08")
_LONGEST = 200


def _to_stderr(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()


class Console:
    """Operator and control of a run at one terminal.

    While a question is open, what is typed belongs to the answer; at other times single keys are requests.

    Parameters
    ----------
    name: of the person, for the run's events.
    write: shows text; None when a display shows questions and answers by itself.
    keys: where typed characters come from.
    """

    def __init__(
        self, name: str, write: Callable[[str], None] | None = _to_stderr, keys: Keys | None = None
    ) -> None:
        self.name = name
        self.typed = ""  #: the answer typed so far, or why the last one was refused
        self._write = write or (lambda _: None)
        self._keys = keys or open_keys()
        self._question: Question | None = None
        self._lines: list[str] = []
        self._orders: list[Order] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._keys.close()

    @property
    def present(self) -> bool:
        """Whether anything more can be typed."""
        return not self._keys.ended

    def poll(self) -> Sequence[Order]:
        """Keys since the last call."""
        self._read()
        orders, self._orders = self._orders, []
        return orders

    def acknowledge(self, order: Order, message: str) -> None:
        """Show the result of a key."""
        self._write(f"{message}\n")

    def publish(self, view: View) -> None:
        """Nothing to do: the display shows the state."""

    def close(self) -> None:
        """Restore the terminal."""
        self._keys.close()

    def ask(self, question: Question) -> Answer | None:
        """Show the question once, then hand over the first answer that fits it.

        Raises
        ------
        RigctlError
            nobody is there to answer: there is no terminal, and no further line will come.
        """
        if question is not self._question:
            self._question, self.typed = question, ""
            self._write(f"{question}{chr(10) if question.notice else ' '}")
        if question.notice:
            return None
        ended = self._keys.ended  # before what was typed is read, so that no last line is lost
        self._read()
        while self._lines:
            line = self._lines.pop(0)
            try:
                answer = read_answer(question, line)
            except RigctlError as error:
                self.typed = f"({error})"
                self._write(f"{error}\n{question} ")
            else:
                self._question, self.typed = None, ""
                return answer
        if ended:
            raise RigctlError(
                f"nobody can answer '{question.text}'",
                hint="Call it in a terminal, or give what it asks for beforehand",
                exit_code=ExitCode.FAILED,
            )
        return None

    def withdraw(self, question: Question) -> None:
        """Forget a question that is no longer open."""
        if question is self._question:
            self._question = None
            if self._keys.interactive:
                self.typed = ""
                self._lines.clear()

    def _read(self) -> None:
        for key in self._keys.read():
            if self._question is not None and not self._question.notice:
                self._edit(key)
            elif not self._keys.interactive:
                self._answer_early(key)
            elif key.lower() in KEYS:
                self._orders.append(Order(KEYS[key.lower()], f"key {key}"))

    def _edit(self, key: str) -> None:
        if self.typed.startswith("("):
            self.typed = ""
        if key in "\r\n":
            self._lines.append(self.typed)
            self.typed = ""
            self._write("\n" if self._keys.interactive else "")
        elif key in _BACKSPACE:
            self.typed = self.typed[:-1]
            self._write("\b \b")
        elif key.isprintable() and len(self.typed) < _LONGEST:
            self.typed += key
            self._write(key if self._keys.interactive else "")

    def _answer_early(self, key: str) -> None:
        """A file of answers is read ahead of the questions."""
        if key == "\n":
            self._lines.append(self.typed)
            self.typed = ""
        else:
            self.typed += key
