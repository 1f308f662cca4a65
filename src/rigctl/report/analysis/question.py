"""The section on a table that leaves several explanations open, beside the run that decides between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.report.analysis.table_section import table_plot
from rigctl.report.section import Section, plot_slot, render


def question_section(before: ModelComparison, diagnosis: Mapping[str, Any]) -> Section:
    """What a table of single values cannot tell, and which record would decide.

    Parameters
    ----------
    before: the model compared with the table.
    diagnosis: of the table: the document of an ambiguous `rigctl.analysis.diagnosis_result.Diagnosis`.
    """
    wrong = [one.text for one in before.trends if one.wrong_sign and one.matters]
    plot = table_plot([before], before.rows[0].quantity, "question-table")
    body = render(
        "question.html",
        direction=wrong[0] if wrong else before.statement,
        rivals=diagnosis["classes"][0] if diagnosis["classes"] else [],
        statement=diagnosis["statement"],
        count=len(before.rows),
        plot=plot_slot(plot),
        caption=plot.caption,
        steps=diagnosis["next_steps"],
    )
    return Section("question", "What single strokes leave open", body, (plot,))
