"""The sections on a comparison: how well the models agree, where they fail, and their plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rigctl.analysis.agreement.uncertainty_budget import uncertainty_budgets
from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.answers.blocks import Block, Figure
from rigctl.answers.budgets import budget_bars
from rigctl.answers.comparison import all_held_out, comparison_answer, numbers, statements, where
from rigctl.answers.findings.systematic_error import left_of
from rigctl.answers.model.title import model_title
from rigctl.report.analysis.frequency_response import frequency_of_model
from rigctl.report.analysis.maps import channel_maps
from rigctl.report.analysis.overlay import condition_of, overlay_plot, typical_records
from rigctl.report.analysis.page_top import NamedModels, answer_section
from rigctl.report.analysis.residual_plot import residual_plots
from rigctl.report.analysis.stroke_over_temperature import stroke_plot
from rigctl.report.analysis.table_section import table_plots
from rigctl.report.blocks import page_blocks
from rigctl.report.heat_map import heat_map_table
from rigctl.report.section import Section, plot_slot, render

_CORRELATED = (
    "outside the band with the past of an input: a model error, whatever the noise is; outside it with their "
    "own past alone: a model error or slow noise"
)


def comparison_sections(comparison: Comparison, *, answered: bool = False) -> list[Section]:
    """The answer, with the change of the error from the first model to the last; then the evidence.

    Parameters
    ----------
    answered: the page already has an answer: show the evidence only.
    """
    first, last = comparison.models[0], comparison.models[-1]
    named = named_models(comparison.models)
    about = model_title(last.fit.problem.model)
    top = [] if answered else [answer_section(comparison_answer(comparison), named, about=about)]
    drawn_record = named.record if top and top[0].plots else None
    measured = _table(comparison) if first.rows else _measured(comparison, drawn_record)
    return [
        *top,
        *_where(first, several=len(comparison.models) > 1),
        measured,
        *frequency_of_model(last.fit, page_name(last)),
        _numbers(comparison, answered=answered),
    ]


def named_models(models: Sequence[ModelComparison]) -> NamedModels:
    """The models by their names on the page."""
    names = tuple(page_name(model) for model in models) if len(models) > 1 else ("model",)
    return NamedModels(names, tuple(model.fit for model in models), tuple(map(left_of, models)))


def page_name(model: ModelComparison) -> str:
    """The name of a model on the page: the given one, or its file and version."""
    definition = model.fit.problem.model
    return model_title(definition) if model.name == definition.name else model.name


def _where(model: ModelComparison, *, several: bool) -> list[Section]:
    """Where in the data the error is, maps, equations, and the direction of the error."""
    blocks = where(model)
    if not blocks:
        return []
    maps = () if model.rows else channel_maps(model, "error-map")
    pairs = render("maps.html", maps=[heat_map_table(one) for one in maps])
    title = f"Where {page_name(model)} fails" if several else "Where the model fails"
    hint = "by phase, channel and operating point; which equation lacks a term"
    return [Section("where", title, page_blocks(blocks) + pairs, maps, folded=True, hint=hint)]


def _measured(comparison: Comparison, drawn_record: int | None) -> Section:
    """Records with the models' predictions; `drawn_record` is already drawn."""
    first = comparison.models[0]
    plots = [
        overlay_plot(
            [(page_name(model), model.fit) for model in comparison.models],
            k,
            f"overlay-{number}",
            f"Measured and model: {name}, {condition_of(first.fit, k)}",
            first.curve_bands,
        )
        for number, (name, k) in enumerate(typical_records(first.fit))
        if k != drawn_record
    ]
    named = [replace(model, name=page_name(model)) for model in comparison.models]
    stroke = stroke_plot(named)
    drawn = (*([] if stroke is None else [stroke]), *plots)
    figures = [Figure(plot.id, "stroke" if plot is stroke else plot.caption) for plot in drawn]
    body = page_blocks(figures, {plot.id: plot_slot(plot) for plot in drawn})
    hint = "further records, every channel" + ("; stroke against temperature" if stroke is not None else "")
    return Section("comparison", "Model against measurement", body, drawn, folded=True, hint=hint)


def _table(comparison: Comparison) -> Section:
    """A table's values beside the models': the plot of the answer, not folded."""
    plots = table_plots(comparison)
    drawn = {plot.id: plot_slot(plot) for plot in plots}
    body = page_blocks([Figure(plot.id, plot.caption) for plot in plots], drawn)
    return Section("comparison", "Model against measurement", body, tuple(plots))


def _numbers(comparison: Comparison, *, answered: bool) -> Section:
    """Errors, tests, record-level parameters and notes on the data, in technical terms."""
    named = replace(
        comparison, models=tuple(replace(model, name=page_name(model)) for model in comparison.models)
    )
    last = named.models[-1]
    plots = residual_plots(last.fit)
    of = f", {last.name}" if len(named.models) > 1 else ""
    figures = [Figure(plot.id, plot.caption + of, "" if k else _CORRELATED) for k, plot in enumerate(plots)]
    blocks: list[Block] = [
        *(statements(named) if answered else []),
        *numbers(named),
        *all_held_out(named),
        *figures,
        *budget_bars(uncertainty_budgets(last.fit)),
    ]
    body = page_blocks(blocks, {plot.id: plot_slot(plot) for plot in plots})
    hint = "errors by channel, the tests, whether the errors are correlated, how the data were taken"
    return Section("numbers", "The statistics", body, tuple(plots), folded=True, hint=hint)
