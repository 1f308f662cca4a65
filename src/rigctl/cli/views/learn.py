"""How learning is printed: each proposal before it is carried out, each round, and the summary."""

from __future__ import annotations

from pathlib import Path

from rich.markup import escape

from rigctl.answers.design import design_answer, whole_design
from rigctl.answers.numbers import probability
from rigctl.cli.blocks import show, show_answer
from rigctl.cli.tables import console, table
from rigctl.design.result import DesignResult
from rigctl.learning.ending import LearningEnd
from rigctl.learning.result import Learned, Round, round_text
from rigctl.planning.outline import clock_time
from rigctl.units import significant


def show_proposal(one: Round, design: DesignResult, *, quiet: bool = False, verbose: bool = False) -> None:
    """Show the proposed records; with `quiet` on stderr, with `verbose` also the predictions for each
    pair."""
    out = console(stderr=True)
    out.print(f"\n[bold]Round {one.number}[/] would be {escape(one.procedure)}", soft_wrap=True)
    if quiet:
        out.print(escape(design.statement), soft_wrap=True)
    else:
        show(whole_design(design)) if verbose else show_answer(design_answer(design))


def show_round(one: Round) -> None:
    """Show a judged round."""
    out = console()
    out.print(f"[bold]Round {one.number}[/]: {escape(round_text(one))}", soft_wrap=True)
    out.print(f"  {escape(one.statement)}", soft_wrap=True)


def show_learned(learned: Learned, folder: Path, page: Path) -> None:
    """Show how it ended, the predicted beside the achieved separation, and where the page is."""
    out = console()
    good = learned.ended is LearningEnd.ADEQUATE
    out.print(
        f"\n[bold {'green' if good else 'yellow'}]{learned.ended.heading}[/]: {escape(learned.statement)}",
        soft_wrap=True,
    )
    compared = [one for one in learned.rounds if one.predicted and one.predicted.aim != "precision"]
    if any(one.achieved for one in compared):
        grid = table("round", "D predicted", "D achieved", "P predicted", "distinguished")
        for column in grid.columns[1:4]:
            column.justify = "right"
        for one in compared:
            if one.predicted is None or one.achieved is None:
                continue
            gained = min(one.achieved.gains.values(), default=None)
            grid.add_row(
                str(one.number),
                significant(min(one.achieved.expected.values(), default=one.predicted.separation), 3),
                "–" if gained is None else significant(gained, 3),
                probability(one.predicted.probability),
                "yes" if one.achieved.distinguished else "no",
            )
        out.print(grid)
    for one in learned.rounds:
        if one.achieved is not None and one not in compared:
            out.print(f"  round {one.number}: {escape(one.achieved.statement)}", soft_wrap=True)
    added = ", ".join(learned.added) or "nothing"
    out.print(
        f"  added {escape(added)}; {escape(learned.model)} is at version {learned.version}", soft_wrap=True
    )
    spent = clock_time(learned.spent)
    out.print(f"  {spent} of bench time; the page: {escape(page.as_posix())}", soft_wrap=True)
    if learned.sensor:
        names = " and ".join(learned.sensor)
        out.print(f"  with {escape(names)} measured too, they would be distinguished", soft_wrap=True)
    _suggest_next(learned, folder)


def _suggest_next(learned: Learned, folder: Path) -> None:
    from rigctl.cli.next_command import show_next
    from rigctl.command_line import command

    runs = [one.run for one in learned.rounds if one.run]
    if learned.ended is LearningEnd.OUTSIDE_LIBRARY and runs:
        discover = command(["discover", *runs, "--model", learned.model])
        show_next(discover, "looks for a formula where no effect of the library fits")
    elif learned.ended is LearningEnd.BUDGET:
        show_next("rigctl learn --resume --budget 1h", "continues with more bench time")
    elif learned.ended is LearningEnd.ROUNDS:
        show_next("rigctl learn --resume --max-rounds 10", "continues with more rounds")
    elif learned.ended is LearningEnd.DECLINED:
        show_next("rigctl learn --resume", f"asks again; the proposal is kept in {folder.as_posix()}")
    elif learned.ended is LearningEnd.STOPPED:
        show_next("rigctl learn --resume", "continues the run that did not finish")
