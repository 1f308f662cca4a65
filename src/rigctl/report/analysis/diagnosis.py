"""The page's part on a diagnosis: what is missing, how sure that is, and what it would look like."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from rigctl.analysis.diagnosis_result import Diagnosis, Ranked
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.text import parameters_text
from rigctl.effects.record_level import RECORD
from rigctl.report.analysis.bars import Bar, bars
from rigctl.report.analysis.laws import law_plots
from rigctl.report.analysis.overlay import typical_records
from rigctl.report.numbers import symbol
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

_SHOWN = 6
_SIGNATURES = 3
#: a channel that no candidate changes by more, in sigmas, says nothing of them
_SHOWS = 0.5


def diagnosis_sections(diagnosis: Diagnosis, *, added: bool = False) -> list[Section]:
    """The verdict, the ranking, the signatures over the residual, and how the error would fall.

    `added` says that what was found is in the model by now: then its versions tell of the error.
    """
    signature = None if diagnosis.before.rows else signature_plot(diagnosis)
    curves = law_plots(diagnosis.laws)
    ranked = not (diagnosis.before.rows and diagnosis.before.adequate)  # a table's few rows rank by chance
    body = render(
        "diagnosis.html",
        diagnosis=diagnosis,
        heading=diagnosis.title,
        ranking=_ranking(diagnosis) if ranked and not diagnosis.before.adequate else Markup(),
        table=[_row(one) for one in diagnosis.ranking[:_SHOWN]] if ranked else [],
        remarks=render(
            "table_remarks.html",
            findings=diagnosis.before.findings,
            excluded=diagnosis.excluded_because,
            steps=diagnosis.next_steps,
        ),
        classes=[names for names in diagnosis.classes if len(names) > 1],
        laws=[(one.statement, one.differs) for one in diagnosis.laws],
        curves=[(plot.caption, plot_slot(plot)) for plot in curves],
        signature=None if signature is None else plot_slot(signature),
        falls=[] if added else _falls(diagnosis),
        drift=[(one.parameter, one.before, one.after, symbol(one.unit)) for one in diagnosis.drift],
    )
    drawn = () if signature is None else (signature,)
    return [Section("diagnosis", "What is missing", body, (*drawn, *curves))]


def _ranking(diagnosis: Diagnosis) -> Markup:
    shown = [
        Bar(
            plain_name(one.effect),
            one.probability,
            f"{100 * one.probability:.1f} %",
            f"error falls {100 * one.error_drop:.0f} %" if one.error_drop > 0.005 else "",
            0 if one.effect in diagnosis.effects else 7,
        )
        for one in diagnosis.ranking[:_SHOWN]
    ]
    return bars("Probability that an effect is among what is missing", shown) if shown else Markup()


def _row(one: Ranked) -> dict[str, object]:
    return {
        "effect": plain_name(one.effect),
        "probability": one.probability,
        "p_value": one.score_p_value,
        "size": one.size,
        "delta_bic": one.delta_bic,
        "kappa": one.kappa,
        "hidden_in": "each record's own" if one.hidden_in == RECORD else plain_name(one.hidden_in),
        "before": one.heldout_before if np.isfinite(one.heldout_before) else None,
        "after": one.heldout_after if np.isfinite(one.heldout_after) else None,
        "parameters": parameters_text(one.parameters),
    }


def signature_plot(diagnosis: Diagnosis) -> Plot | None:
    """What each refitted candidate takes away from the residual of the worst record, over that residual."""
    trials = _candidates(diagnosis)
    if not trials:
        return None
    k = typical_records(diagnosis.before.fit)[0][1]
    before = diagnosis.before.fit
    record, measurements = before.problem.records[k], before.problem.measurements
    panels: list[Panel] = []
    residual = -before.normalised_error(k)
    changes = [(trial.fit.outputs[k] - before.outputs[k]) / before.problem.sigma[k] for trial in trials]
    shows = np.max([np.abs(change).max(axis=0) for change in changes], axis=0) > _SHOWS
    for c, name in enumerate(measurements.outputs):
        if not np.isfinite(residual[:, c]).any() or not (shows[c] or not shows.any()):
            continue
        traces = [
            Trace("measured − model", record.times, residual[:, c], Look.LINE, 7, "sigma", False, not panels)
        ]
        for number, (trial, change) in enumerate(zip(trials, changes, strict=True)):
            label, faint = " and ".join(map(plain_name, trial.effects)), number > 0
            traces.append(
                Trace(label, record.times, change[:, c], Look.LINE, number, "sigma", faint, not panels)
            )
        panels.append(Panel(f"{plain_name(name)} [sigma]", tuple(traces), height=1.3))
    caption = "What each candidate would explain, over the residual of the worst record"
    return Plot("signatures", caption, "time in the record [s]", tuple(panels))


def _candidates(diagnosis: Diagnosis) -> list[RefittedSet]:
    """The best set, then the other refitted sets in the order of their misfit; each set once."""
    found: dict[tuple[str, ...], RefittedSet] = {}
    if diagnosis.best.candidates:
        found[tuple(sorted(diagnosis.best.effects))] = diagnosis.best
    for trial in sorted(diagnosis.trials, key=lambda one: one.chi2):
        if len(trial.candidates) == max(1, len(diagnosis.best.candidates)):
            found.setdefault(tuple(sorted(trial.effects)), trial)
    return list(found.values())[:_SIGNATURES]


def _falls(diagnosis: Diagnosis) -> list[Markup]:
    """Error of each channel before and after, fitted and held out."""
    if not diagnosis.best.candidates:
        return []
    found = []
    before, after = diagnosis.before.fit, diagnosis.best.fit
    measurements = before.problem.measurements
    units = dict(zip(measurements.outputs, measurements.units, strict=True))
    for name, one in before.errors.items():
        pairs = [("before", one), ("after", after.errors[name])]
        if name in before.heldout_errors and name in after.heldout_errors:
            pairs += [
                ("before, held out", before.heldout_errors[name]),
                ("after, held out", after.heldout_errors[name]),
            ]
        largest = max(error.rmse for _, error in pairs)
        unit = parse_unit(units[name])
        shown_unit = "K" if unit.offset else symbol(units[name])
        shown = [
            Bar(label, error.rmse / largest, f"{error.rmse / unit.factor:.3g} {shown_unit}", "", place % 2)
            for place, (label, error) in enumerate(pairs)
        ]
        shown.append(
            Bar(
                "noise",
                one.noise / largest,
                f"{one.noise / unit.factor:.3g} {shown_unit}",
                "what noise alone makes",
                7,
            )
        )
        found.append(bars(f"Error of the {plain_name(measurements.titles.get(name, name))} (RMSE)", shown))
    return found
