"""How a diagnosis and the resulting changes are printed."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from rigctl.analysis.adequacy import chance
from rigctl.analysis.bootstrap import Bootstrap
from rigctl.analysis.diagnosis_result import Diagnosis, Drift, Ranked, Verdict
from rigctl.analysis.held_out_group import HeldOutGroup
from rigctl.analysis.improve import Improvement, Step
from rigctl.analysis.laws.answer import LawAnswer
from rigctl.analysis.text import drift_text, parameters_text
from rigctl.cli.tables import console, table
from rigctl.cli.views.answer import counted, show_answer, show_first
from rigctl.cli.views.compare import routine, show_departures, show_notes, show_unusual
from rigctl.cli.views.model import show_errors
from rigctl.report.diagnosis_answer import diagnosis_answer, improvement_answer
from rigctl.report.terminal_bars import draw_bar
from rigctl.units import known_digits, parse_unit, significant

_COLOURS = {
    Verdict.ADEQUATE: "green",
    Verdict.MISSING_EFFECT: "yellow",
    Verdict.AMBIGUOUS: "yellow",
    Verdict.OUTSIDE_LIBRARY: "red",
    Verdict.UNDECIDED: "bright_black",
}
#: findings and next steps of a table that are shown without `-v`
_MOST_SAID = 2
#: effects of the ranking that are shown besides those of the verdict
_RANKED = 8


def show_diagnosis(diagnosis: Diagnosis, *, verbose: bool = False) -> None:
    """Show the verdict and the next command; with `verbose` also the ranking and the evidence for and
    against."""
    if verbose:
        _show_whole(diagnosis)
        return
    show_answer(diagnosis_answer(diagnosis), title=_title(diagnosis), more=_left_out(diagnosis))
    show_departures(diagnosis.outside)
    for finding in diagnosis.before.findings[:_MOST_SAID]:
        console().print(f"  {escape(finding)}.", soft_wrap=True)
    for step in diagnosis.next_steps[:_MOST_SAID]:
        console().print(f"  {'next':<11} {escape(step)}", soft_wrap=True)
    show_unusual(diagnosis.notes)
    _show_intervals(diagnosis.bootstrap)
    _show_files(diagnosis.laws)


def _left_out(diagnosis: Diagnosis) -> list[str]:
    """Lines shown only with ``-v``."""
    against = sum(one.startswith("against ") for one in diagnosis.further_evidence)
    return [
        *(["the ranking"] if diagnosis.ranking and diagnosis.verdict is not Verdict.ADEQUATE else []),
        *counted(against, "point of evidence against it", "points of evidence against it"),
        *counted(
            len(diagnosis.untestable),
            "effect that these data cannot test",
            "effects that these data cannot test",
        ),
        *counted(len(routine(diagnosis.notes)), "note on the data", "notes on the data"),
    ]


def _title(diagnosis: Diagnosis) -> str:
    return diagnosis.title + (f" ({', '.join(diagnosis.effects)})" if diagnosis.effects else "")


def _show_files(laws: Sequence[LawAnswer]) -> None:
    """Show where the files of better laws are."""
    for one in laws:
        if one.file is not None:
            console().print(f"  written: {escape(one.file.as_posix())}", soft_wrap=True)


def _show_whole(diagnosis: Diagnosis) -> None:
    """Show the verdict, the ranking, the evidence for and against, and what cannot be tested."""
    out = console()
    _show_verdict(diagnosis)
    show_departures(diagnosis.outside)
    if diagnosis.remainder_text:
        out.print(f"  {escape(diagnosis.remainder_text)}.", soft_wrap=True)
    show_notes(diagnosis.notes)
    for finding in diagnosis.before.findings:
        out.print(f"  {escape(finding)}.", soft_wrap=True)
    if diagnosis.verdict is Verdict.ADEQUATE:  # the power of these data
        for line in diagnosis.further_evidence:
            out.print(f"  {escape(line)}", soft_wrap=True)
    else:
        if diagnosis.ranking:
            out.print(_ranking(diagnosis))
        _show_evidence(diagnosis.further_evidence)
        _show_remarks(diagnosis)
        _show_classes(diagnosis.classes)
        for line in diagnosis.excluded_because:
            out.print(f"  {escape(line)}", soft_wrap=True)
        if diagnosis.slot and not diagnosis.before.rows:
            out.print(f"  the equation that most probably lacks a term: [bold]{escape(diagnosis.slot)}[/]")
        if any(one.before for one in diagnosis.drift):
            out.print(_drift(diagnosis.drift))
    _show_laws(diagnosis.laws)
    _show_intervals(diagnosis.bootstrap)
    _show_untestable(diagnosis.untestable)
    if diagnosis.next_steps:
        out.print("  [bold]what to measure next[/]")
    for step in diagnosis.next_steps:
        out.print(f"  {escape(step)}", soft_wrap=True)


def _show_intervals(bootstrap: Bootstrap | None) -> None:
    """Show the interval of each parameter over the repetitions, beside the standard deviation of the fit."""
    if bootstrap is None:
        return
    out = console()
    shown = table("parameter", "unit", "value", "interval", "± repeated", "± of the fit")
    for one in bootstrap.parameters:
        value, spread = known_digits(one.value, one.std)
        low, high = (known_digits(end, one.std)[0] for end in (one.low, one.high))
        fit = known_digits(one.value, one.fit_std)[1] if math.isfinite(one.fit_std) else ""
        shown.add_row(escape(one.name), escape(one.unit), value, f"{low} … {high}", spread, fit)
    out.print(shown)
    out.print(f"  {escape(bootstrap.statement)}", soft_wrap=True)


def _show_laws(laws: Sequence[LawAnswer]) -> None:
    """Show what the data show about the laws of the effects, and where the file of a better one is."""
    out = console()
    if laws:
        out.print("  [bold]laws of the effects[/]")
    for one in laws:
        mark = "[yellow]![/] " if one.differs else "  "
        out.print(f"  {mark}{escape(one.statement)}", soft_wrap=True)
        if one.file is not None:
            out.print(f"    written: {escape(one.file.as_posix())}", soft_wrap=True)


def _show_verdict(diagnosis: Diagnosis) -> None:
    colour = "bright_black" if diagnosis.doubt else _COLOURS[diagnosis.verdict]
    title = f"[bold {colour}]{escape(_title(diagnosis))}[/]"
    show_first(diagnosis.first)
    said = escape(diagnosis.statement)
    console().print(said + "." if said.startswith(diagnosis.title) else f"{title}: {said}.", soft_wrap=True)
    for line in () if diagnosis.before.rows else diagnosis.before.in_brief:
        console().print(f"  {escape(line)}", soft_wrap=True)
    for line in diagnosis.decided_by:
        console().print(f"  decided by: {escape(line)}", soft_wrap=True)


def _ranking(diagnosis: Diagnosis) -> Table:
    """Effects by their probability."""
    grid = table(
        "effect", "probability", "", "p of score", "ΔmBIC", "unabsorbed", "error", "held out", "parameters"
    )
    grid.columns[2].justify = grid.columns[4].justify = "right"
    shown = [one for k, one in enumerate(diagnosis.ranking) if k < _RANKED or one.effect in diagnosis.effects]
    for one in shown:
        grid.add_row(
            f"[bold]{one.effect}[/]" if one.effect in diagnosis.effects else one.effect,
            f"[cyan]{draw_bar(one.probability, 1.0, width=16)}[/]",
            f"{100 * one.probability:.1f} %",
            chance(one.score_p_value),
            f"{one.delta_bic:+.1f}",
            f"{100 * one.kappa:.0f} %",
            f"{-100 * one.error_drop:+.1f} %" if one.error_drop else "",
            _held_out(one),
            escape(parameters_text(one.parameters)),
        )
    return grid


def _held_out(one: Ranked) -> str:
    if not math.isfinite(one.heldout_before):
        return ""
    return f"{significant(one.heldout_before)} to {significant(one.heldout_after)}"


def _show_evidence(evidence: Sequence[str]) -> None:
    """Show a line for each piece of evidence for or against an effect."""
    out = console()
    for line in evidence:
        mark = _mark(line)
        if mark is not None:
            out.print(f"  {mark} {escape(line)}", soft_wrap=True)


def _show_remarks(diagnosis: Diagnosis) -> None:
    """Show the evidence that is neither for nor against an effect, but for drifts, which are in a table."""
    moved = drift_text(diagnosis.drift)
    for line in diagnosis.further_evidence:
        if _mark(line) is None and line not in moved:
            console().print(f"  {escape(line)}", soft_wrap=True)


def _mark(line: str) -> str | None:
    """The mark of a piece of evidence for or against an effect; None for any other."""
    return {"for": "[green]+[/]", "against": "[red]-[/]"}.get(line.partition(" ")[0])


def _show_classes(classes: Sequence[Sequence[str]]) -> None:
    for names in classes:
        if len(names) > 1:
            console().print(f"  these data cannot tell apart: [bold]{escape(', '.join(names))}[/]")


def _drift(drift: Sequence[Drift]) -> Table:
    """The fitted parameters, without and with the effects found."""
    made = table("fitted parameter", "without", "with it", "unit", "change")
    for one in drift:
        before, after = known_digits(one.before, one.before_std)[0], known_digits(one.after, one.after_std)[0]
        made.add_row(one.parameter, before, after, escape(one.unit), _change(one))
    return made


def _change(one: Drift) -> str:
    """In per cent; for a temperature in kelvin, since a share of degrees Celsius is meaningless."""
    if parse_unit(one.unit).absolute_temperature:
        return f"{significant((one.after - one.before) * parse_unit(one.unit).factor, 2, sign=True)} K"
    return f"{100 * (one.after / one.before - 1):+.1f} %" if one.before else ""


def _show_untestable(effects: Sequence[tuple[str, str]]) -> None:
    """Show effects that are not testable with these data, by what would make them testable."""
    out = console()
    by_need: dict[str, list[str]] = {}
    for name, needs in effects:
        by_need.setdefault(needs, []).append(name)
    if by_need:
        out.print("  [bold]not testable with these data[/]")
    for needs, names in by_need.items():
        out.print(f"  {escape(', '.join(names))}: needs {escape(needs)}", soft_wrap=True)


def _show_step(step: Step) -> None:
    """Show one addition: the effect, the evidence for and against it, and the change of the error."""
    out = console()
    head = step.version.head
    added = ", ".join(step.effects)
    out.print(f"[bold]Version {step.version.number}[/] of {escape(str(head))}: added [bold]{added}[/]")
    out.print(f"  {escape(step.reason)}.", soft_wrap=True)
    _show_evidence([one for one in step.diagnosis.evidence if _subject(one) in step.effects])
    show_errors([("before", step.before), (f"with {' and '.join(step.effects)}", step.after)])
    out.print()


def _subject(evidence: str) -> str:
    """The effect that ``for valve_leakage: …`` is about."""
    return evidence.partition(":")[0].partition(" ")[2]


def show_improvement(improvement: Improvement, *, verbose: bool = False) -> None:
    """Show how it ended, the additions and the change of the error; with `verbose` every step and its
    reason."""
    if verbose:
        _show_steps(improvement)
        return
    if not improvement.steps:
        show_diagnosis(improvement.last)
        return
    show_answer(
        improvement_answer(improvement),
        title="-",
        more=["every step and its reasons", *_left_out(improvement.last)],
    )
    show_departures(improvement.last.outside)
    _show_files(improvement.last.laws)


def _show_steps(improvement: Improvement) -> None:
    """Show every step, how it ended, the whole decrease of the error, and what is left."""
    out = console()
    for step in improvement.steps:
        _show_step(step)
    out.print(
        f"[bold]{escape(improvement.statement[0].upper() + improvement.statement[1:])}.[/]", soft_wrap=True
    )
    if len(improvement.steps) > 1:
        steps = [("before", improvement.steps[0].before)]
        show_errors(
            [*steps, *((f"with {' and '.join(one.effects)}", one.after) for one in improvement.steps)]
        )
    _show_unseen(improvement.unseen)
    out.print("[bold]The model as it is now[/]")
    _show_whole(improvement.last)
    if improvement.steps:
        head = improvement.steps[-1].version.head
        out.print(f"  rigctl model history {escape(str(head))} shows every version")


def _show_unseen(groups: Sequence[HeldOutGroup]) -> None:
    """Show how good the model is on the records that were left out, and what it misses there."""
    out = console()
    if groups:
        out.print("[bold]Records that no fit or search has seen[/]")
    for one in groups:
        mark = "[green]+[/]" if one.as_good else "[yellow]-[/]"
        first, *rest = one.sentences
        out.print(f"  {mark} {escape(first)}.", soft_wrap=True)
        for sentence in rest:
            out.print(f"    {escape(sentence)}.", soft_wrap=True)
