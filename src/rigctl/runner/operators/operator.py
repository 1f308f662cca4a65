"""The operator, who answers the questions of a procedure, and how an answer is read."""

from __future__ import annotations

import math
from typing import Protocol

from rigctl.errors import RigctlError
from rigctl.plan.behaviour import Answer, Question
from rigctl.units import describe, parse_unit, read_si, show


class Operator(Protocol):
    """An operator who can be asked while the runner continues to monitor the bench."""

    name: str
    typed: str  #: the answer typed so far, shown behind the question

    @property
    def present(self) -> bool:
        """False while nobody can answer or command, because the terminal or the page is gone."""
        ...

    def ask(self, question: Question) -> Answer | None:
        """Ask, or continue asking; None as long as there is no answer."""
        ...

    def withdraw(self, question: Question) -> None:
        """Withdraw a question whose answer is no longer needed."""
        ...


def read_answer(question: Question, text: str) -> Answer:
    """The answer that was typed; a number without a unit is read in the unit of the question.

    Raises
    ------
    RigctlError
        not a finite quantity of the right dimension, or outside the bounds.
    """
    if not question.wants_value:
        return Answer(text)
    unit = question.unit or "1"
    written = text.strip()
    try:
        float(written)
    except ValueError:
        value = read_si(written, unit)
    else:
        value = parse_unit(unit).to_si(float(written))
    if not math.isfinite(value):  # NaN would lie within any bounds
        raise RigctlError("not a finite number", value=written, expected=describe(unit))
    if (question.low is not None and value < question.low) or (
        question.high is not None and value > question.high
    ):
        bounds = " to ".join(show(end, unit) for end in (question.low, question.high) if end is not None)
        raise RigctlError("out of range", value=written, expected=bounds or describe(unit))
    return Answer(written, value)
