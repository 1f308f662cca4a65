"""The section on a table that leaves several explanations open, beside the run that decides between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.answers.blocks import Block, Figure, Points, Sentence
from rigctl.answers.numbers import plural
from rigctl.answers.trends import trend_text
from rigctl.report.analysis.table_section import table_plot
from rigctl.report.blocks import page_blocks
from rigctl.report.section import Section, plot_slot


def question_section(before: ModelComparison, diagnosis: Mapping[str, Any]) -> Section:
    """What a table of single values cannot tell, and which record would decide.

    Parameters
    ----------
    before: the model compared with the table.
    diagnosis: of the table: the document of an ambiguous `rigctl.analysis.diagnosis_result.Diagnosis`.
    """
    wrong = [trend_text(one) for one in before.trends if one.wrong_sign and one.matters]
    plot = table_plot([before], before.rows[0].quantity, "question-table")
    direction = wrong[0] if wrong else before.statement
    rivals = diagnosis["classes"][0] if diagnosis["classes"] else []
    said = f"the published strokes say the same: {direction}"
    open_ = (
        f"{plural(len(rivals), 'effect')} would explain it, and {len(before.rows)} numbers cannot tell "
        f"which: {', '.join(rivals)}"
        if rivals
        else diagnosis["statement"]
    )
    blocks: list[Block] = [Sentence(f"{said}. {open_}"), Figure(plot.id, plot.caption)]
    if diagnosis["next_steps"]:
        blocks.append(Points.of("what decides", diagnosis["next_steps"]))
    body = page_blocks(blocks, {plot.id: plot_slot(plot)})
    return Section("question", "What single strokes leave open", body, (plot,))
