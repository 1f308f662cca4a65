"""The page's part on a comparison: how well the models agree, and where they fail."""

from __future__ import annotations

from markupsafe import Markup

from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.analysis.levels import ALPHA
from rigctl.analysis.localisation import variable_units
from rigctl.analysis.record_level import RecordQuantity
from rigctl.report.analysis.bars import Bar, bars
from rigctl.report.analysis.maps import channel_maps
from rigctl.report.analysis.overlay import overlay_plot, typical_records
from rigctl.report.analysis.strokes import stroke_plot
from rigctl.report.analysis.table_section import table_body, table_parts
from rigctl.report.heat_map import heat_map_table
from rigctl.report.numbers import prose, symbol
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name

_MOST_PLACES = 8


def comparison_sections(comparison: Comparison) -> list[Section]:
    """The pictures first, then the numbers."""
    first = comparison.models[0]
    tables = table_parts(comparison)
    plots = [
        overlay_plot(
            [(model.name, model.fit) for model in comparison.models],
            k,
            f"overlay-{number}",
            f"Measured and model: {name}, {_condition(first, k)}",
            first.curve_bands,
        )
        for number, (name, k) in enumerate(typical_records(first.fit) if not tables else ())
    ]
    stroke = stroke_plot(comparison.models) if not tables else None
    maps = channel_maps(first, "error-map") if not tables else ()
    body = render(
        "comparison.html",
        comparison=comparison,
        models=[_model(model) for model in comparison.models],
        tables=table_body(tables, first.findings) if tables else None,
        overlays=[(plot.caption, plot_slot(plot)) for plot in plots],
        stroke=None if stroke is None else plot_slot(stroke),
        maps=[heat_map_table(one) for one in maps],
        places=_places(first),
        slots=_slots(first),
    )
    drawn = [*plots, *([] if stroke is None else [stroke]), *(part.plot for part in tables)]
    return [Section("comparison", "Model against measurement", body, (*drawn, *maps))]


def _condition(model: ModelComparison, k: int) -> str:
    from rigctl.model.measured.conditions import condition_text

    record = model.fit.problem.records[k]
    return condition_text(record.condition, variable_units(model.fit.problem.measurements)) or record.label


def _model(model: ModelComparison) -> dict[str, object]:
    titles = model.fit.problem.measurements.titles
    channels = [
        {**one, "name": plain_name(titles.get(name, name)), "unit": symbol(str(one["unit"]))}
        for name, one in model.channels().items()
    ]
    tests = [
        (_TESTS.get(name, name), test.statistic, test.p_value) for name, test in model.adequacy.tests.items()
    ]
    return {
        "name": model.name,
        "adequate": model.adequate,
        "below_noise": model.adequacy.below_noise,
        "p_value": model.adequacy.p_value,
        "statement": model.statement,
        "channels": channels,
        "tests": tests,
        "trends": [
            one.text for one in model.trends[:4] if one.matters and one.text[1:] not in model.statement
        ],
        "curve_bands": [one.statement for one in model.curve_bands],
        "outside": [one.statement for one in model.outside],
        "held_out": bool(model.fit.held_out),
        "own": [_own(one) for one in model.record_level],
        "suspicious": [
            one.statement
            for one in model.record_level
            if one.statement and one.statement not in model.statement
        ],
    }


def _own(one: RecordQuantity) -> dict[str, object]:
    values = one.values
    return {
        "meaning": one.meaning,
        "prior": one.prior,
        "cells": [one.shown(float(value)) for value in (values.min(), values.mean(), values.max())],
        "count": values.size,
    }


_TESTS = {
    "score": "the library's best effect (score)",
    "plane": "residuals over the operating point (plane)",
    "chi2": "the whole misfit (χ²)",
}


def _places(model: ModelComparison) -> list[Markup]:
    """Shares of the systematic error by channel, phase and condition."""
    found = []
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
            found.append(bars("Systematic error by condition" if model.rows else title, shown))
    return found


def _slots(model: ModelComparison) -> Markup | None:
    """Which equation wants a term."""
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
    return bars("Which equation wants a term: log-evidence for an unknown disturbance there", shown)


def _meaning(model: ModelComparison, name: str) -> str:
    return next((slot.meaning for slot in model.fit.problem.model.family.slots if slot.name == name), "")
