"""The page's part on a comparison: how well the models agree, and where they fail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from rigctl.compare.localise import variable_units
from rigctl.compare.result import Comparison, ModelComparison
from rigctl.report.analysis.bars import Bar, bars
from rigctl.report.analysis.maps import channel_maps
from rigctl.report.analysis.overlay import overlay_plot, typical_records
from rigctl.report.analysis.table_section import table_body, table_parts
from rigctl.report.heat_map import heat_map_table
from rigctl.report.numbers import prose, symbol
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

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
    from rigctl.model.measured.read import condition_text

    record = model.fit.problem.records[k]
    return condition_text(record.condition, variable_units(model.fit.problem.measurements)) or record.label


def _model(model: ModelComparison) -> dict[str, object]:
    channels = [
        {
            "name": plain_name(name),
            "unit": symbol(str(one["unit"])),
            "held_out": one["heldout_rmse"],
            **{
                key: one[key]
                for key in ("rmse", "bias", "max", "noise", "nrmse", "r2", "chi2_reduced", "masked")
            },
        }
        for name, one in model.channels().items()
    ]
    tests = [
        (_TESTS.get(name, name), test.statistic, test.p_value) for name, test in model.adequacy.tests.items()
    ]
    return {
        "name": model.name,
        "adequate": model.adequate,
        "p_value": model.adequacy.p_value,
        "statement": model.statement,
        "channels": channels,
        "tests": tests,
        "trends": [
            one.text for one in model.trends[:4] if one.matters and one.text[1:] not in model.statement
        ],
        "held_out": bool(model.fit.held_out),
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
                "more than chance" if place.p_value < 0.01 else "could be chance",
                0 if place.p_value < 0.01 else 7,
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


def stroke_plot(models: Sequence[ModelComparison]) -> Plot | None:
    """Stroke against temperature by pressure, measured and of every model; None where nothing strokes."""
    first = models[0]
    problem = first.fit.problem
    outputs, variables = problem.measurements.outputs, problem.measurements.variables
    units = variable_units(problem.measurements)
    hot = [name for name in variables if parse_unit(units[name]).offset]
    if "position" not in outputs or not hot:
        return None
    x_name, rest = hot[0], [name for name in variables if name != hot[0]]
    column = outputs.index("position")
    unit = problem.measurements.units[column]
    factor = parse_unit(unit).factor
    groups: dict[tuple[float, ...], list[int]] = {}
    for k, record in enumerate(problem.records):
        key = tuple(float(f"{record.condition.get(name, np.nan):.5g}") for name in rest)
        groups.setdefault(key, []).append(k)
    traces: list[Trace] = []
    for number, (key, places) in enumerate(sorted(groups.items())):
        label = ", ".join(
            f"{parse_unit(units[name]).from_si(value):.4g} {symbol(units[name])}"
            for name, value in zip(rest, key, strict=True)
        )
        x = np.array(
            [parse_unit(units[x_name]).from_si(problem.records[k].condition[x_name]) for k in places]
        )
        order = np.argsort(x)
        measured = np.array([_stroke(first, k, column, measured=True) for k in places]) / factor
        traces.append(Trace(label, x[order], measured[order], Look.POINTS, number, symbol(unit)))
        for model in models:
            first_one = not number
            said = np.array([_stroke(model, k, column, measured=False) for k in places]) / factor
            name = model.name if len(models) > 1 else "model"
            faint = model is not models[-1]
            traces.append(
                Trace(name, x[order], said[order], Look.LINE, number, symbol(unit), faint, first_one)
            )
    title = f"stroke [{symbol(unit)}]"
    x_title = f"{plain_name(x_name)} [{symbol(units[x_name])}]"
    caption = "Stroke against temperature: marks measured, lines the model"
    return Plot("model-stroke", caption, x_title, (Panel(title, tuple(traces), height=2.4),))


def _stroke(model: ModelComparison, k: int, column: int, *, measured: bool) -> float:
    """Position while the valve is closed after the extension, less that at the start."""
    record, ok = model.fit.problem.records[k], model.fit.problem.ok[k][:, column]
    values = record.values[:, column] if measured else model.fit.expected_outputs[k][:, column]
    hold = record.phases.index("hold") if "hold" in record.phases else len(record.phases) - 1
    after, before = (record.phase == hold) & ok, (record.phase == 0) & ok
    if not after.any():
        return float("nan")
    base = float(values[before].mean()) if hold and before.any() else 0.0
    return float(values[after].mean()) - base
