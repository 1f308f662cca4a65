"""The sections on a diagnosis: what is missing, how certain that is, and its signature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.search.refit import RefittedSet
from rigctl.answers.blocks import Sentence
from rigctl.answers.budgets import budget_bars
from rigctl.answers.diagnosis import diagnosis_answer, diagnosis_evidence
from rigctl.answers.findings.systematic_error import lefts_of_diagnosis
from rigctl.answers.model.title import model_title
from rigctl.report.analysis.laws import law_plots
from rigctl.report.analysis.overlay import typical_records
from rigctl.report.analysis.page_top import NamedModels, answer_section
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot
from rigctl.report.signals import plain_name

Floats = NDArray[np.float64]

_SIGNATURES = 3
#: a channel that no candidate changes by more, in sigmas, does not distinguish them
_SHOWS = 0.5


def diagnosis_sections(diagnosis: Diagnosis, *, added: bool = False) -> list[Section]:
    """The verdict with the decrease of the error; then the ranking, the signatures and the laws.

    With `added` the effects found are already in the model: that is the answer, and this the evidence for it.
    """
    signature = None if diagnosis.before.rows else signature_plot(diagnosis)
    drawn = (*(() if signature is None else (signature,)), *law_plots(diagnosis.laws))
    said = Sentence(diagnosis.statement, head=diagnosis.title)
    body = page_blocks(
        [said, *diagnosis_evidence(diagnosis), *budget_bars(diagnosis.budgets)],
        {plot.id: plot_slot(plot) for plot in drawn},
    )
    hint = "the ranking, the evidence for and against, what these data cannot decide"
    evidence = Section("diagnosis", "Why, and how certain", body, drawn, folded=True, hint=hint)
    return [evidence] if added else [_answer(diagnosis), evidence]


def _answer(diagnosis: Diagnosis) -> Section:
    model, best = diagnosis.before.fit, diagnosis.best
    names = ("as it is", f"with {' and '.join(map(plain_name, best.effects))}")
    fits = (model, best.fit) if best.candidates else (model,)
    named = NamedModels(names if len(fits) > 1 else ("model",), fits, tuple(lefts_of_diagnosis(diagnosis)))
    return answer_section(diagnosis_answer(diagnosis), named, about=model_title(model.problem.model))


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
    return Plot("signature", caption, "time in the record [s]", tuple(panels))


def _candidates(diagnosis: Diagnosis) -> list[RefittedSet]:
    """The best set, then the other refitted sets in the order of their misfit; each set once."""
    sets: dict[tuple[str, ...], RefittedSet] = {}
    if diagnosis.best.candidates:
        sets[tuple(sorted(diagnosis.best.effects))] = diagnosis.best
    for trial in sorted(diagnosis.trials, key=lambda one: one.chi2):
        if len(trial.candidates) == max(1, len(diagnosis.best.candidates)):
            sets.setdefault(tuple(sorted(trial.effects)), trial)
    return list(sets.values())[:_SIGNATURES]
