"""The section on a diagnosis: what is missing, how certain that is, and its signature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from rigctl.analysis.diagnosis_result import Diagnosis, Drift, Ranked, Verdict
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.text import parameters_text
from rigctl.effects.record_level import RECORD
from rigctl.json_values import finite_or_none
from rigctl.report.analysis.bars import Bar, bars
from rigctl.report.analysis.budget_bars import budget_bars
from rigctl.report.analysis.laws import law_plots
from rigctl.report.analysis.overlay import typical_records
from rigctl.report.analysis.page_top import NamedModels, answer_section
from rigctl.report.answer import Answer, plain_statement
from rigctl.report.diagnosis_answer import diagnosis_answer
from rigctl.report.model_title import model_title
from rigctl.report.numbers import symbol
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name
from rigctl.report.systematic import lefts_of_diagnosis
from rigctl.units import known_digits

Floats = NDArray[np.float64]

_SHOWN = 6
_SIGNATURES = 3
#: a channel that no candidate changes by more, in sigmas, does not distinguish them
_SHOWS = 0.5


def diagnosis_sections(diagnosis: Diagnosis, *, added: bool = False) -> list[Section]:
    """The verdict with the decrease of the error; then the ranking, the signatures and the laws.

    With `added` the effects found are already in the model: that is the answer, and this the evidence for it.
    """
    signature = None if diagnosis.before.rows else signature_plot(diagnosis)
    curves = law_plots(diagnosis.laws)
    ranked = not (diagnosis.before.rows and diagnosis.before.adequate)  # a ranking of few rows is random
    body = render(
        "diagnosis.html",
        diagnosis=diagnosis,
        heading=diagnosis.title,
        ranking=_ranking(diagnosis) if ranked and not diagnosis.before.adequate else Markup(),
        table=[_row(one) for one in diagnosis.ranking[:_SHOWN]] if ranked else [],
        excluded=diagnosis.excluded_because,
        classes=[names for names in diagnosis.classes if len(names) > 1],
        laws=[(one.statement, one.differs) for one in diagnosis.laws],
        curves=[(plot.caption, plot_slot(plot)) for plot in curves],
        signature=None if signature is None else plot_slot(signature),
        drift=[_drift(one) for one in diagnosis.drift],
        budgets=budget_bars(diagnosis.budgets),
    )
    drawn = () if signature is None else (signature,)
    hint = "the ranking, the evidence for and against, what these data cannot decide"
    evidence = Section("diagnosis", "Why, and how certain", body, (*drawn, *curves), folded=True, hint=hint)
    return [evidence] if added else [*_answer(diagnosis), evidence]


def _answer(diagnosis: Diagnosis) -> list[Section]:
    model, best = diagnosis.before.fit, diagnosis.best
    names = ("as it is", f"with {' and '.join(map(plain_name, best.effects))}")
    fits = (model, best.fit) if best.candidates else (model,)
    named = NamedModels(names if len(fits) > 1 else ("model",), fits, tuple(lefts_of_diagnosis(diagnosis)))
    about = model_title(model.problem.model)
    answer = diagnosis_answer(diagnosis)
    top = answer_section(answer, named, about=about, sentence=_sentence(diagnosis, answer, about))
    remarks = render(
        "table_remarks.html",
        findings=diagnosis.before.findings,
        steps=diagnosis.next_steps,
        outside=[one.statement for one in diagnosis.outside],
    )
    return [replace(top, body=top.body + remarks)]


def _sentence(diagnosis: Diagnosis, answer: Answer, about: str) -> str:
    """The verdict with its subject: the title alone does not name the missing effect."""
    if diagnosis.doubt:
        return answer.sentence
    if diagnosis.verdict is Verdict.ADEQUATE:
        name = diagnosis.before.fit.problem.model.name
        statement = plain_statement(diagnosis.before)
        return about + statement.removeprefix(name) if statement.startswith(f"{name} ") else statement
    if diagnosis.verdict is Verdict.MISSING_EFFECT:
        names = " and ".join(diagnosis.effects)
        is_missing = "is" if len(diagnosis.effects) == 1 else "are"
        return f"{names} {is_missing} missing from {about}: {answer.sentence[0].lower()}{answer.sentence[1:]}"
    return answer.sentence


def _drift(one: Drift) -> tuple[str, str, str, str]:
    """A fitted parameter without and with the effects found, to its significant digits."""
    before, after = known_digits(one.before, one.before_std)[0], known_digits(one.after, one.after_std)[0]
    return one.parameter, before, after, symbol(one.unit)


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
        "hidden_in": "record-level parameters" if one.hidden_in == RECORD else plain_name(one.hidden_in),
        "before": finite_or_none(one.heldout_before),
        "after": finite_or_none(one.heldout_after),
        "parameters": parameters_text(one.parameters),
    }


def signature_plot(diagnosis: Diagnosis) -> Plot | None:
    """The change by each refitted candidate, over the residual of the worst record."""
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
            Trace(
                "measured − model",
                record.times,
                residual[:, c],
                Look.LINE,
                7,
                "times the noise",
                False,
                not panels,
            )
        ]
        for number, (trial, change) in enumerate(zip(trials, changes, strict=True)):
            label, faint = " and ".join(map(plain_name, trial.effects)), number > 0
            traces.append(
                Trace(
                    label, record.times, change[:, c], Look.LINE, number, "times the noise", faint, not panels
                )
            )
        panels.append(Panel(f"{plain_name(name)} [times the noise]", tuple(traces), height=1.3))
    caption = "What each candidate would explain, over the residual of the worst record"
    return Plot("signatures", caption, "time in the record [s]", tuple(panels))


def _candidates(diagnosis: Diagnosis) -> list[RefittedSet]:
    """The best set, then the other refitted sets in the order of their misfit; each set once."""
    sets: dict[tuple[str, ...], RefittedSet] = {}
    if diagnosis.best.candidates:
        sets[tuple(sorted(diagnosis.best.effects))] = diagnosis.best
    for trial in sorted(diagnosis.trials, key=lambda one: one.chi2):
        if len(trial.candidates) == max(1, len(diagnosis.best.candidates)):
            sets.setdefault(tuple(sorted(trial.effects)), trial)
    return list(sets.values())[:_SIGNATURES]
