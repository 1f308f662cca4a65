"""Search beyond the library: where a term is missing, over which variable, as a curve, and by which
formulas."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from rigctl.analysis.agreement.adequacy import Adequacy
from rigctl.analysis.comparison import compare
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import ALPHA, STAND_IN
from rigctl.analysis.diagnosis import diagnose_comparison
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.fitting import OnProgress, no_progress, require_free_parameters
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.refitted_sets import RefittedSets
from rigctl.dataset.run import Run
from rigctl.discovery.curve import curves_of
from rigctl.discovery.dimensions import tier_of
from rigctl.discovery.effect_file import scale_parameters, term_of
from rigctl.discovery.formula_fit import Fitted, left_out, refit_formulas, tests_after, within
from rigctl.discovery.formulas import score_formulas
from rigctl.discovery.gate import gate_of
from rigctl.discovery.grammar import DISTANCES
from rigctl.discovery.locate import Map, locate
from rigctl.discovery.open_slots import OpenSlots, open_slots
from rigctl.discovery.passivity import passivity
from rigctl.discovery.result import Discovery, FormulaParameter, FoundFormula, Where, parameter
from rigctl.effects.declaration import qualified
from rigctl.effects.drivers import Driver
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.measured.note import as_notes
from rigctl.model.model import Model
from rigctl.physics.family import ModelFamily
from rigctl.tasks import Workers
from rigctl.wording import chance_text, share_text, strength

#: number of other locations that are named
_RIVALS = 5
#: number of curves that are drawn
_CURVES = 3
#: extension of the data's range at either end, as a share of it
_ROOM = 0.01


def discover(
    runs: Sequence[Run],
    model: Model,
    *,
    hold_out: str | None = None,
    only: str | None = None,
    slot: str | None = None,
    workers: Workers | None = None,
    on_progress: OnProgress | None = None,
) -> Discovery:
    """Search for a formula for what a model lacks, on the usable records of `runs`; see `Discovery`.

    Parameters
    ----------
    hold_out: a condition that selects the records to be held out; nothing here sees them.
    only: a condition that selects the records to be used.
    slot: restricts the search to one slot.
    workers: processes that refit the formulas; this process by default.

    Raises
    ------
    RigctlError
        as `rigctl.analysis.comparison.compare`; the model has no free parameters, or no such slot.
    """
    require_free_parameters(model)
    require_slot(model.family, slot)
    compared = compare(runs, [model], hold_out=hold_out, only=only, on_progress=on_progress)
    (before,) = compared.models
    diagnosis = diagnose_comparison(
        before, compared.runs, compared.held_out, compared.notes, on_progress=on_progress
    )
    return discover_beside(diagnosis, slot=slot, workers=workers, on_progress=on_progress)


def require_slot(family: ModelFamily, slot: str | None) -> None:
    """Refuse a slot that the family does not have, and a family that has none.

    Raises
    ------
    RigctlError
        the message gives the nearest name.
    """
    names = [one.name for one in family.slots]
    if not names:
        raise RigctlError("this family has no slot where a term could be", value=family.name)
    if slot is not None and slot not in names:
        raise unknown_name(f"slot of {family.name}", slot, names)


@one_thread()
def discover_beside(
    diagnosis: Diagnosis,
    *,
    slot: str | None = None,
    workers: Workers | None = None,
    on_progress: OnProgress | None = None,
) -> Discovery:
    """Search for a formula where a diagnosis found nothing with certainty.

    Raises
    ------
    RigctlError
        the model cannot be simulated at its fit.
    """
    report = on_progress or no_progress
    before, gate = diagnosis.before, gate_of(diagnosis)
    result = Discovery(
        diagnosis.runs, diagnosis.model, gate, None, (), (), 0, gate.statement, diagnosis.notes, diagnosis
    )
    if not gate.open:
        return result
    samples = RefittedSets(before, before.whole).samples
    opened = open_slots(before, progress=report)
    searched = locate(opened, samples, slot, report)
    result = replace(result, searched=searched, notes=(*diagnosis.notes, *as_notes(_notes(before, searched))))
    if not searched.sure:
        return replace(result, statement=_too_weak(searched))
    report("Scoring formulas")
    scored = score_formulas(opened, searched.most_wanted, samples)
    fitted = refit_formulas(before.fit, scored.formulas, samples, scored.tried, report, workers)
    none = RefittedSets(before, before.whole).null
    paying = [one for one in fitted if one.cost < none.chi2]
    chosen = within(paying)
    formulas = tuple(_found(one, chosen[0], opened, none) for one in chosen)
    slots = {one.formula.slot.name for one in chosen}
    refuted = frozenset(one.formula.slot.name for one in fitted) - slots
    report("Drawing the curves")
    curves = curves_of(opened, [one.formula for one in chosen], searched.located, _CURVES)
    result = replace(result, curves=curves, formulas=formulas, tried=scored.tried, refuted=refuted)
    return replace(result, statement=_statement(result))


def _found(one: Fitted, best: Fitted, opened: OpenSlots, before: RefittedSet) -> FoundFormula:
    after = tests_after(one)
    formula, model = one.formula, opened.problem.model
    scales = scale_parameters(formula, model.family)
    records = len(one.trial.fit.fitted)
    return FoundFormula(
        fitted=one,
        term=term_of(formula, scales),
        tier=tier_of(formula, model),
        parameters=dict(_parameters(one, model)),
        delta=one.cost - best.cost,
        check=left_out(one) if records > 1 else None,
        passive=passivity(formula, opened),
        valid=tuple(visited(opened, factor.argument.driver) for factor in formula.factors),
        p_value_after=after.p_value,
        left=_left(after, before.chi2 - one.trial.chi2),
    )


def _left(after: Adequacy, explained: float) -> float:
    """The share of the squared misfit that a formula leaves; 0 if the tests find nothing any more."""
    excess = 0.0 if after.agrees else max(test.excess for test in after.tests.values())
    return excess / max(excess + explained, 1e-300)


def visited(opened: OpenSlots, driver: Driver) -> tuple[str, float, float, str]:
    """A variable, its range over the fitted records, SI, slightly extended, as a refit changes its time
    series; and the unit in which it is shown."""
    values = opened.values(driver)
    low, high = float(values.min()), float(values.max())
    room = _ROOM * (high - low)
    return driver.name, low - room, high + room, opened.unit_of(driver)


def _parameters(one: Fitted, model: Model) -> Iterator[tuple[str, FormulaParameter]]:
    formula = one.formula
    yield "size", parameter(formula.size, one.size_std, formula.slot.unit)
    for scale in scale_parameters(formula, model.family):
        argument = scale.factor.argument
        std = one.trial.value(qualified(formula.name, scale.name))[1]
        yield (
            scale.name,
            parameter(
                scale.value, std, argument.driver.unit, point=argument.point and scale.kind not in DISTANCES
            ),
        )


def _notes(before: ModelComparison, searched: Map) -> Iterator[str]:
    lin = before.linearisation
    if len(set(lin.regions.groups)) < 2:
        yield (
            "All records are at one condition: the result holds there, and has not been tested at any other. "
            "Record at a second one"
        )
    if searched.hidden:
        names = ", ".join(one.name for one in searched.hidden[:4])
        more = f" and {len(searched.hidden) - 4} more" if len(searched.hidden) > 4 else ""
        yield (
            f"Not testable with these data: {names}{more}: a term there is equivalent to "
            "record-level variation or to a change of the fitted parameters"
        )


def _too_weak(searched: Map) -> str:
    if not searched.located:
        return "Something is missing, but a term would not be visible in these data at any location"
    best = searched.located[0]
    if best.size > searched.needed:
        return (
            f"Not certain enough to discover: the best of {searched.tests} terms tested, {best.name}, is "
            f"{strength(best.size)}, but its residuals vary so much from record to record that "
            f"chance alone may explain it ({chance_text(best.p_value)}); record more conditions"
        )
    factor = max((searched.needed / best.size) ** 2 if best.size else math.inf, 1.1)
    more = f", or about {factor:.2g} times as many records like these" if factor < 100.0 else ""
    return (
        f"Too weak to discover: the best of {searched.tests} terms tested, {best.name}, is "
        f"{strength(best.size)} ({chance_text(best.p_value)}); {searched.needed:.1f} are needed{more}"
    )


def _statement(discovery: Discovery) -> str:
    where = f"A term is missing{_where(discovery.where)}"
    if not discovery.formulas:
        return (
            f"{where}; none of the {discovery.tried} formulas tried explains enough for its parameters, so "
            "the curve is all that these data show"
        )
    first, count = discovery.formulas[0], len(discovery.formulas)
    remain = "one remains" if count == 1 else f"{count} remain that these data do not distinguish, first"
    text = f"{where}; of {discovery.tried} formulas {remain}: {first.term}"
    if len({one.slot for one in discovery.where}) > 1:
        text += f" at {first.slot}"
    if first.alike:
        text += f" ({len(first.alike)} more are equivalent in these data)"
    if first.left > STAND_IN:
        over = " and ".join(row[0] for row in first.valid)
        return (
            f"Something is missing that no formula describes: the nearest of {discovery.tried} acts at "
            f"{first.slot} over {over} and leaves {share_text(first.left)} of the misfit. What is missing "
            "may depend on time or on something that is not recorded, or act at several locations"
        )
    if not first.accepted:
        text += f". {first.doubt[0].upper()}{first.doubt[1:]}, and it should not be relied on"
    if first.p_value_after < ALPHA:
        text += ". The model with it still does not agree with the data: something else is missing"
    return text


def _where(where: Sequence[Where]) -> str:
    """The slot and the variables if they are certain; else the alternatives that these data do not
    distinguish."""
    slots = list(dict.fromkeys(one.slot for one in where))
    drivers = list(dict.fromkeys(" and ".join(one.over) for one in where))
    if len(slots) > 1 and len(drivers) > 1:
        return f", its location and variable uncertain ({_or([str(one) for one in where])})"
    at = f" at {slots[0]}" if len(slots) == 1 else f", its location uncertain ({_or(slots)}),"
    over = f" over {drivers[0]}" if len(drivers) == 1 else f", its variable uncertain ({_or(drivers)})"
    return at + over


def _or(names: Sequence[str]) -> str:
    """Some of several names, and the number of the rest."""
    shown, more = names[: _RIVALS + 1], len(names) - _RIVALS - 1
    return f"{', '.join(shown)} or {more} more" if more > 0 else " or ".join(shown)
