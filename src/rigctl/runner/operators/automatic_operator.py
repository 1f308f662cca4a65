"""Answers where no person is asked: those of a simulated bench, and those given beforehand (`--answer`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rigctl.errors import Location, RigctlError, require_known
from rigctl.plan import Plan
from rigctl.plan.behaviour import Answer, Question
from rigctl.plan.tree import Leaf, all_nodes
from rigctl.runner.operators.operator import read_answer
from rigctl.units import show


class AutomaticOperator:
    """The operator of a simulated bench: answers at once.

    A value is the one given in the procedure for simulations, or else the middle of the allowed range.
    """

    name = "simulated"
    typed = ""
    present = True

    def ask(self, question: Question) -> Answer | None:
        """Confirm, or answer with a value."""
        if question.notice or not question.wants_value:
            return Answer("done")
        value = question.simulated
        if value is None:
            bounds = [end for end in (question.low, question.high) if end is not None]
            if not bounds:
                raise RigctlError(
                    "the simulated operator does not know what to answer",
                    value=question.text,
                    expected="'simulated: VALUE' in the prompt, or bounds",
                )
            value = sum(bounds) / len(bounds)
        return Answer(show(value, question.unit or "1", digits=6), value)

    def withdraw(self, question: Question) -> None:
        """Nothing to withdraw."""


class ScriptedOperator:
    """Answers by name from a table, for unattended runs (`--answer`) and tests.

    Confirmations are given at once; a value that the table does not have is an error.
    """

    name = "script"
    typed = ""
    present = True

    def __init__(self, answers: Mapping[str, str]) -> None:
        self._answers = dict(answers)

    def ask(self, question: Question) -> Answer | None:
        """The table's answer.

        Raises
        ------
        RigctlError
            the table has none, or it does not fit the question.
        """
        if question.notice or not question.wants_value:
            return Answer("done")
        name = str(question.name)
        if name not in self._answers:
            raise _missing(name)
        return read_answer(question, self._answers[name])

    def withdraw(self, question: Question) -> None:
        """Nothing to withdraw."""


def scripted(plan: Plan, answers: Mapping[str, str]) -> ScriptedOperator:
    """The operator who answers from a table, checked against every prompt of the plan.

    A prompt in a branch or a cleanup block needs its answer as well: it may be reached at night.

    Raises
    ------
    RigctlError
        a prompt has no answer, an answer does not fit a prompt with its name, or no prompt has its name.
    """
    operator = ScriptedOperator(answers)
    answered: set[str] = set()
    for question, where in _questions(plan):
        if question.name is not None:
            try:
                operator.ask(question)
            except RigctlError as error:
                if question.name in answers:
                    error.what = f"the answer to '{question.name}' does not fit: {error.what}"
                raise error.at(where) from None
            answered.add(question.name)
    require_known("question of the procedure", answers, answered)
    return operator


def refuse_questions(plan: Plan) -> None:
    """Refuse a plan with a question that nobody can answer, also in a branch or a cleanup block.

    Raises
    ------
    RigctlError
        it has a question; with the location of the first one.
    """
    for question, where in _questions(plan):
        raise RigctlError(
            f"nobody can answer '{question.text}': the input is empty",
            hint="Call it in a terminal, or answer with --answer or --answer-in-browser",
            where=where,
        )


def _questions(plan: Plan) -> Iterator[tuple[Question, Location]]:
    """Every question that a plan may wait for an answer to, and the location of its step."""
    for node in all_nodes(plan):
        if isinstance(node, Leaf):
            for question in node.action.questions(plan.rig):
                yield question, node.where


def _missing(name: str) -> RigctlError:
    """The error of a prompt without an answer."""
    return RigctlError("no answer was given beforehand", value=name, expected=f"--answer {name}=VALUE")
