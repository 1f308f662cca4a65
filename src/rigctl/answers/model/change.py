"""A change of a model's file: its new version, how the error changed, and the values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis.search.model_change import Changed
from rigctl.answers.blocks import Answer, Block, Column, Next, Points, Table, counted, nonempty
from rigctl.answers.comparison import departures
from rigctl.answers.model.declared import value_texts
from rigctl.answers.model.errors import error_bars
from rigctl.answers.model.history import error_change, held_out_change
from rigctl.command_line import DataOptions, analysis
from rigctl.model import StatedValue, stated_values
from rigctl.model.fit.assumptions import Conditional
from rigctl.model.history.change import ModelError
from rigctl.units import significant

#: number of fitted parameters in the answer
_NAMED = 4


def change_answer(
    changed: Changed, family: str | None, *, evidence: bool = False
) -> tuple[Answer, list[Block]]:
    """The new version, and what follows its facts: with `evidence` bars and a table, then the next command.

    `family` is as given, for the next command.
    """
    done, version = changed.version.done, changed.version
    facts, more, shown = [("note", done.note)], [], list[Block]()
    if done.before is not None and done.after is not None:
        fitted = [stated for stated in stated_values(changed.model) if stated.fit]
        facts += [
            ("error", error_change(done.before, done.after)),
            ("held out", held_out_change(done.before, done.after)),
            ("fitted", fitted_values(fitted, changed.conditional)),
        ]
        more = ["every channel's error as bars", *counted(len(fitted), "fitted parameter")]
        shown = _evidence(changed, done.before, done.after, fitted) if evidence else []
    answer = Answer(
        "good",
        "",
        f"{version.head.as_posix()} is now version {version.number}, {_before_and_after(changed)[1]}",
        nonempty(facts),
        changed.first,
        more=() if evidence else tuple(more),
        headed=False,
    )
    return answer, [*shown, *departures(changed.outside), *_next(changed, family)]


def _before_and_after(changed: Changed) -> tuple[str, str]:
    done = changed.version.done
    return {
        "fit": ("as it was", "fitted"),
        "add": (f"without {done.effect}", f"with {done.effect}"),
        "remove": (f"with {done.effect}", f"without {done.effect}"),
        "set": ("as it was", "set by hand"),
    }[done.kind]


def _evidence(
    changed: Changed, before: ModelError, after: ModelError, fitted: Sequence[StatedValue]
) -> list[Block]:
    """The errors before and after as bars, and the fitted values."""
    old, new = _before_and_after(changed)
    blocks = error_bars([(old, before), (new, after)])
    if before.chi2_reduced is not None and after.chi2_reduced is not None:
        chi2 = [significant(error) for error in (before.chi2_reduced, after.chi2_reduced)]
        blocks.append(Points.of("", [f"reduced χ²: {chi2[0]} {old}, {chi2[1]} {new}"]))
    columns = (
        Column("name", "fitted parameter"),
        Column("value", "value"),
        Column("spread", "", words=True),
        Column("unit", "unit", words=True, unit=True),
    )
    return [*blocks, Table(columns, tuple(_row(one, changed.conditional.get(one.name)) for one in fitted))]


def _row(stated: StatedValue, conditional: Conditional | None) -> dict[str, Any]:
    value, spread = value_texts(stated)
    if conditional is not None:
        value, spread = significant(stated.value, 2), conditional.clause(stated.unit)
    return {"name": stated.name, "value": value, "spread": spread, "unit": stated.unit}


def _next(changed: Changed, family: str | None) -> list[Block]:
    version, done = changed.version, changed.version.done
    head = version.head.as_posix()
    kept = f"Version {version.parent} is kept: rigctl model diff {head}@{version.parent} {head}"
    if not done.runs:
        return [Points.of("", [kept])]
    choice = DataOptions(done.only, done.hold_out, done.assume, family)
    command = f"{analysis('compare', done.runs, head, choice)} --no-fit"
    return [Points.of("", [kept]), Next(command, "shows whether it agrees with them now")]


def fitted_values(fitted: Sequence[StatedValue], conditional: Mapping[str, Conditional]) -> str:
    """The first of the fitted parameters with their uncertainty; those of effects before the others."""
    first = sorted(fitted, key=lambda stated: "." not in stated.name)[:_NAMED]
    parts = [" ".join(filter(None, (one.name, *_texts(one, conditional.get(one.name))))) for one in first]
    remaining = len(fitted) - len(first)
    return ", ".join([*parts, *([f"and {remaining} more"] if remaining else [])])


def _texts(one: StatedValue, conditional: Conditional | None) -> tuple[str, ...]:
    """A value, its standard deviation and its unit; or what it is over the ranges of assumed numbers."""
    unit = "" if one.unit == "1" else one.unit
    if conditional is None:
        return (*value_texts(one), unit)
    return (significant(one.value, 2), unit, conditional.clause(one.unit))
