"""How learning is printed: each proposal before it is carried out, each round, and the summary."""

from __future__ import annotations

from pathlib import Path

from rich.markup import escape

from rigctl.answers.design import design_answer, whole_design
from rigctl.answers.learning import heading, learned_blocks, round_text
from rigctl.cli.blocks import show, show_answer
from rigctl.cli.tables import console
from rigctl.design.result import DesignResult
from rigctl.learning.ending import LearningEnd
from rigctl.learning.result import Learned, Round


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
        f"\n[bold {'green' if good else 'yellow'}]{heading(learned)}[/]: {escape(learned.statement)}",
        soft_wrap=True,
    )
    show(learned_blocks(learned, folder, page))
