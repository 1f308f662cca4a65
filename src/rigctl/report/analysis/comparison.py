"""The section on a comparison: how well the models agree, and where they fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from markupsafe import Markup

from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.record_level import RecordQuantity
from rigctl.analysis.uncertainty_budget import uncertainty_budgets
from rigctl.report.analysis.bars import Bar, bars
from rigctl.report.analysis.budget_bars import budget_bars
from rigctl.report.analysis.maps import channel_maps
from rigctl.report.analysis.overlay import condition_of, overlay_plot, typical_records
from rigctl.report.analysis.page_top import NamedModels, answer_section
from rigctl.report.analysis.residual_plot import residual_plots
from rigctl.report.analysis.stroke_over_temperature import stroke_plot
from rigctl.report.analysis.table_section import TablePart, table_body, table_parts
from rigctl.report.answer import models_answer, noise_known_from, plain_statement
from rigctl.report.heat_map import heat_map_table
from rigctl.report.model_title import model_title
from rigctl.report.numbers import prose, symbol
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name
from rigctl.report.systematic import left_of

_MOST_PLACES = 8


def comparison_sections(comparison: Comparison, *, answered: bool = False) -> list[Section]:
    """The answer, with the change of the error from the first model to the last; then the evidence.

    Parameters
    ----------
    answered: the page already has an answer: show the evidence only.
    """
    first = comparison.models[0]
    tables = table_parts(comparison)
    named = named_models(comparison.models)
    top = [] if answered else [_answer(comparison.models, named)]
    drawn_record = named.record if top and top[0].plots else None
    where = _where(first, several=len(comparison.models) > 1) if not first.adequate else None
    measured = (
        _table(tables, () if answered else first.findings) if tables else _measured(comparison, drawn_record)
    )
    numbers = _numbers(comparison)
    return [*top, *([] if where is None else [where]), measured, numbers]


def named_models(models: Sequence[ModelComparison]) -> NamedModels:
    """The models by their names on the page."""
    names = tuple(page_name(model) for model in models) if len(models) > 1 else ("model",)
    return NamedModels(names, tuple(model.fit for model in models), tuple(map(left_of, models)))


def page_name(model: ModelComparison) -> str:
    """The name of a model on the page: the given one, or its file and version."""
    definition = model.fit.problem.model
    return model_title(definition) if model.name == definition.name else model.name


def _answer(models: Sequence[ModelComparison], named: NamedModels) -> Section:
    answer, last = models_answer(models), models[-1]
    definition = last.fit.problem.model
    sentence = plain_statement(last)
    if sentence.startswith(f"{definition.name} "):
        sentence = model_title(definition) + sentence.removeprefix(definition.name)
    top = answer_section(answer, named, about=model_title(last.fit.problem.model), sentence=sentence)
    outside = [one.statement for model in models for one in model.outside]
    remarks = render("table_remarks.html", findings=(), steps=(), outside=outside)
    return replace(top, body=top.body + remarks)


def _where(model: ModelComparison, *, several: bool) -> Section | None:
    """Where in the data the error is, maps, equations, and the direction of the error."""
    maps = channel_maps(model, "error-map") if not model.rows else ()
    places, slots = _places(model), _slots(model)
    trends = [one.text for one in model.trends[:4] if one.matters and one.text[1:] not in model.statement]
    if not (maps or places or slots or trends):
        return None
    body = render(
        "where.html", maps=[heat_map_table(one) for one in maps], places=places, slots=slots, trends=trends
    )
    title = "Where the model fails" if not several else f"Where {page_name(model)} fails"
    hint = "by phase, channel and operating point; which equation lacks a term"
    return Section("where", title, body, maps, folded=True, hint=hint)


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
    body = render(
        "measured.html",
        overlays=[(plot.caption, plot_slot(plot)) for plot in plots],
        stroke=None if stroke is None else plot_slot(stroke),
    )
    drawn = (*plots, *([] if stroke is None else [stroke]))
    hint = "further records, every channel" + ("; stroke against temperature" if stroke is not None else "")
    return Section("comparison", "Model against measurement", body, drawn, folded=True, hint=hint)


def _table(tables: Sequence[TablePart], findings: Sequence[str]) -> Section:
    """A table's values beside the models': the plot of the answer, not folded."""
    body = Markup(table_body(tables, findings))  # noqa: S704 - rendered, autoescaped
    plots = tuple(part.plot for part in tables)
    return Section("comparison", "Model against measurement", body, plots)


def _numbers(comparison: Comparison) -> Section:
    """Errors, tests, record-level parameters and notes on the data, in technical terms."""
    plots = residual_plots(comparison.models[-1].fit)
    body = render(
        "numbers.html",
        comparison=comparison,
        models=[_model(model) for model in comparison.models],
        budgets=budget_bars(uncertainty_budgets(comparison.models[-1].fit)),
        residuals=[(plot.caption, plot_slot(plot)) for plot in plots],
    )
    hint = "errors by channel, the tests, whether the errors are correlated, how the data were taken"
    return Section("numbers", "The statistics", body, tuple(plots), folded=True, hint=hint)


def _model(model: ModelComparison) -> dict[str, object]:
    titles = model.fit.problem.measurements.titles
    channels = [
        {
            **one,
            "name": plain_name(titles.get(name, name)),
            "unit": symbol(str(one["unit"])),
            "known": noise_known_from(one),
        }
        for name, one in model.channels().items()
    ]
    tests = [
        (_TESTS.get(name, name), test.statistic, test.p_value) for name, test in model.adequacy.tests.items()
    ]
    return {
        "name": page_name(model),
        "adequate": model.adequate,
        "below_noise": model.adequacy.below_noise,
        "p_value": model.adequacy.p_value,
        "statement": model.statement,
        "channels": channels,
        "tests": tests,
        "curve_bands": [one.statement for one in model.curve_bands],
        "held_out": bool(model.fit.held_out),
        "own": [_record_quantity(one) for one in model.record_level],
        "suspicious": [
            one.statement
            for one in model.record_level
            if one.statement and one.statement not in model.statement
        ],
    }


def _record_quantity(one: RecordQuantity) -> dict[str, object]:
    values = one.values
    return {
        "meaning": one.meaning,
        "prior": one.prior,
        "cells": [one.shown(float(value)) for value in (values.min(), values.mean(), values.max())],
        "count": values.size,
    }


_TESTS = {
    "score": "the library's best effect (score)",
    "inputs": "correlation of the errors with past inputs",
    "plane": "residuals over the operating point (plane)",
    "chi2": "the whole misfit (χ²)",
}


def _places(model: ModelComparison) -> list[Markup]:
    """Shares of the systematic error by channel, phase and condition."""
    blocks = []
    for by, title in (
        ("phase", "Systematic error by phase of a record"),
        ("channel", "… by channel"),
        ("condition", "… by condition"),
    ):
        if model.rows and (model.adequate or by != "condition"):
            continue
        places = [place for place in model.where if place.by == by][:_MOST_PLACES]
        largest = max((place.share_of_error for place in places), default=0.0) or 1.0
        shown = [
            Bar(
                prose(plain_name(place.label)),
                place.share_of_error / largest,
                f"{100 * place.share_of_error:.0f} %",
                "more than chance" if place.p_value < ALPHA else "could be chance",
                0 if place.p_value < ALPHA else 7,
            )
            for place in places
        ]
        if shown:
            blocks.append(bars("Systematic error by condition" if model.rows else title, shown))
    return blocks


def _slots(model: ModelComparison) -> Markup | None:
    """Bars of the log-evidence that each equation lacks a term."""
    if model.adequate or not model.slots or (model.rows and len(model.slots[0].alike) > 1):
        return None
    best = max(slot.log_evidence for slot in model.slots)
    if best <= 0.0:
        return None
    shown = [
        Bar(
            plain_name(slot.slot),
            slot.log_evidence / best,
            f"{slot.log_evidence:.0f}",
            _meaning(model, slot.slot),
        )
        for slot in model.slots[:_MOST_PLACES]
        if slot.log_evidence > 0.0
    ]
    return bars("Which equation lacks a term: log-evidence for an unknown disturbance there", shown)


def _meaning(model: ModelComparison, name: str) -> str:
    return next((slot.meaning for slot in model.fit.problem.model.family.slots if slot.name == name), "")
