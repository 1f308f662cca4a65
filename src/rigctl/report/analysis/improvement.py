"""The section on an improved model: the additions, the decrease of the error, and the original model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from markupsafe import Markup

from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.analysis.improve import Improvement
from rigctl.answers.blocks import Details, Figure, Sentence
from rigctl.answers.diagnosis import whole_diagnosis
from rigctl.answers.findings.systematic_error import left_of
from rigctl.answers.improvement import improvement_answer
from rigctl.answers.trends import trend_text
from rigctl.report.analysis.comparison import comparison_sections
from rigctl.report.analysis.diagnosis import diagnosis_sections
from rigctl.report.analysis.held_out import unseen_sections
from rigctl.report.analysis.history import history_sections
from rigctl.report.analysis.page_top import NamedModels, answer_section
from rigctl.report.analysis.stroke_over_temperature import held_out_strokes, stroke_plot
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Plot
from rigctl.report.section import Section, plot_slot


def improvement_sections(compared: Comparison, improved: Improvement, path: Path) -> list[Section]:
    """What was added, the versions in `path`, records unseen, the first diagnosis, both models compared."""
    if not improved.steps:
        return [*diagnosis_sections(improved.first), *comparison_sections(compared, answered=True)]
    versions = _versions(compared, improved)
    shown = replace(compared, models=(versions[0], versions[-1]))
    return [
        _answer(versions, improved, path),
        *unseen_sections(improved.unseen),
        *left_sections(improved),
        *diagnosis_sections(improved.first, added=True),
        *comparison_sections(shown, answered=True),
        *history_sections(path, versions),
    ]


def left_sections(improved: Improvement) -> list[Section]:
    """The verdict on the current model, and what it leaves; nothing if nothing was added."""
    last = improved.last
    if not improved.steps:
        return []
    hint = f"{last.title}; what these data still cannot decide"
    body = page_blocks(whole_diagnosis(last))
    return [Section("model-now", "The model as it is now", body, folded=True, hint=hint)]


def _versions(compared: Comparison, improved: Improvement) -> list[ModelComparison]:
    """The original model, then with each addition."""
    if not improved.steps:
        return []
    before = improved.steps[0].version.parent
    numbered = [
        (before, compared.models[0]),
        *((one.version.number, one.comparison) for one in improved.steps),
    ]
    return [replace(comparison, name=f"version {number}") for number, comparison in numbered]


def _answer(versions: Sequence[ModelComparison], improved: Improvement, path: Path) -> Section:
    """The additions, each with its reason, and the change of the error."""
    first, last = versions[0], versions[-1]
    named = NamedModels(
        (first.name, last.name), (first.fit, last.fit), (left_of(first), left_of(improved.last.before))
    )
    about = f"{path.name}, {versions[-1].name}"
    top = answer_section(improvement_answer(improved), named, about=about)
    reasons = page_blocks(
        [
            Details(
                "why each was added",
                tuple(
                    Sentence(
                        step.addition.reason,
                        head=f"version {step.version.number}, {' and '.join(step.effects)}",
                    )
                    for step in improved.steps
                ),
            )
        ]
    )
    picture, drawn = _wrong_direction(first, last)
    return replace(top, id="improvement", body=picture + top.body + reasons, plots=(*drawn, *top.plots))


def _wrong_direction(first: ModelComparison, last: ModelComparison) -> tuple[Markup, tuple[Plot, ...]]:
    """Where the original model changes the other way than what was measured: that first, with its picture."""
    wrong = [one for one in first.trends if one.wrong_sign and one.matters]
    plot = stroke_plot((first, last), "answer-stroke") if wrong else None
    if plot is None:
        return Markup(), ()
    unseen = held_out_strokes(first, last)
    caption = f"Stroke against temperature: measured (markers), {first.name} (dotted), {last.name} (lines)"
    body = page_blocks(
        [
            Sentence(f"wrong direction: {trend_text(wrong[0])}", "bad"),
            *([Sentence(unseen)] if unseen else []),
            Figure(plot.id, caption),
        ],
        {plot.id: plot_slot(plot)},
    )
    return body, (plot,)
