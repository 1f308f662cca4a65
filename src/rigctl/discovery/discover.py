"""Look for what no library has: where, over which variable, as a curve, and by which formulas."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from rigctl.analysis.adequacy import Adequacy
from rigctl.analysis.comparison import compare
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.diagnosis import diagnose_comparison
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.fitting import require_free_parameters
from rigctl.analysis.levels import ALPHA, STAND_IN
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.remainder import share_text
from rigctl.analysis.search import Search
from rigctl.dataset.run import Run
from rigctl.discovery.curve import curves_of
from rigctl.discovery.dimensions import tier_of
from rigctl.discovery.effect_file import scale_parameters, term_of
from rigctl.discovery.formula_fit import Fitted, left_out, refit_formulas, tests_after, within
from rigctl.discovery.formulas import score_formulas
from rigctl.discovery.gate import gate_of
from rigctl.discovery.grammar import DISTANCES
from rigctl.discovery.locate import Located, Map, locate
from rigctl.discovery.open_slots import OnProgress, OpenSlots, open_slots
from rigctl.discovery.passivity import passivity
from rigctl.discovery.result import Discovery, FormulaParameter, FoundFormula, Where, parameter
from rigctl.effects.declaration import qualified
from rigctl.effects.drivers import Driver
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.model import Model
from rigctl.physics.family import ModelFamily
from rigctl.tasks import Workers

#: places over one variable whose formulas are looked at, and of the first places pairs of variables
_SINGLES, _PAIRS = 4, (4, 2, 1)
#: other places that are named
_RIVALS = 5
#: curves that are drawn
_CURVES = 3
#: of a range that the data visit, what is added at either end
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
    """Look for a formula of what a model lacks on the usable records of `runs`; see `Discovery`.

    Parameters
    ----------
    hold_out: a condition that chooses records which nothing here sees.
    only: a condition that chooses the records to look at.
    slot: the one place to look at.
    workers: who refits the formulas; this process when left out.

    Raises
    ------
    RigctlError
        as `rigctl.analysis.comparison.compare`; the model has nothing to fit, or no such slot.
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
        it names the nearest.
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
    """Look for a formula where a diagnosis found nothing that is sure.

    Raises
    ------
    RigctlError
        the model cannot be simulated at its fit.
    """
    said = on_progress or (lambda _: None)
    before, gate = diagnosis.before, gate_of(diagnosis)
    result = Discovery(
        diagnosis.runs, diagnosis.model, gate, None, (), (), 0, gate.statement, diagnosis.notes, diagnosis
    )
    if not gate.open:
        return result
    samples = Search(before, before.whole).samples
    opened = open_slots(before, progress=said)
    searched = locate(opened, samples, slot, said)
    result = replace(result, searched=searched, notes=(*diagnosis.notes, *_notes(before, searched)))
    if not searched.sure:
        return replace(result, statement=_too_weak(searched))
    said("Scoring formulas")
    scored = score_formulas(opened, _most_wanted(searched), samples)
    fitted = refit_formulas(before.fit, scored.formulas, samples, scored.tried, said, workers)
    none = Search(before, before.whole).none
    paying = [one for one in fitted if one.cost < none.chi2]
    chosen = within(paying)
    formulas = tuple(_found(one, chosen[0], opened, none) for one in chosen)
    places = {one.formula.slot.name for one in chosen}
    refuted = frozenset(one.formula.slot.name for one in fitted) - places
    said("Drawing the curves")
    curves = curves_of(opened, [one.formula for one in chosen], searched.located, _CURVES)
    result = replace(result, curves=curves, formulas=formulas, tried=scored.tried, refuted=refuted)
    return replace(result, statement=_statement(result))


def _most_wanted(searched: Map) -> list[Located]:
    """Of the places over one variable the first, and over two the first of several places: what a place wants
    may be hidden in several pairs that change together.
    """
    seen = [one for one in searched.located if one.p_value < ALPHA]
    single = [one for one in seen if len(one.over) == 1]
    double = [one for one in seen if len(one.over) == 2]
    places = list(dict.fromkeys(one.slot.name for one in double))[: len(_PAIRS)]
    chosen = [
        one
        for name, most in zip(places, _PAIRS, strict=False)
        for one in [pair for pair in double if pair.slot.name == name][:most]
    ]
    return [*single[:_SINGLES], *chosen]


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
    """The share of the squared misfit that stays with a formula; 0 where the tests find nothing any more."""
    excess = 0.0 if after.agrees else max(test.excess for test in after.tests.values())
    return excess / max(excess + explained, 1e-300)


def visited(opened: OpenSlots, driver: Driver) -> tuple[str, float, float, str]:
    """A variable, its range over the fitted records, SI, and a little more, as a refit moves its course, and
    the unit that it is shown in."""
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
            "All records are at one condition: what is found holds there, and no other condition has "
            "tested it. Record at a second one"
        )
    if searched.hidden:
        names = ", ".join(one.name for one in searched.hidden[:4])
        more = f" and {len(searched.hidden) - 4} more" if len(searched.hidden) > 4 else ""
        yield (
            f"Not testable with these data: {names}{more}: there a term is what each record has of its own, "
            "or what the fit takes up"
        )


def _too_weak(searched: Map) -> str:
    if not searched.located:
        return "Something is missing, but at no place would a term show in these data"
    best = searched.located[0]
    factor = max((searched.needed / best.size) ** 2 if best.size else math.inf, 1.1)
    more = f", or about {factor:.2g} times as many records like these" if factor < 100.0 else ""
    return (
        f"Too weak to discover: the best of {searched.tests} places, {best.name}, stands out by "
        f"{best.size:.1f} sigma (p = {best.p_value:.2g}); it would take {searched.needed:.1f}{more}"
    )


def _statement(made: Discovery) -> str:
    where = f"A term is missing{_where(made.where)}"
    if not made.formulas:
        return (
            f"{where}; none of {made.tried} formulas pays for itself there: its curve is what these data say"
        )
    first, count = made.formulas[0], len(made.formulas)
    same = "one formula" if count == 1 else f"{count} formulas that these data do not tell apart"
    text = f"{where}: {same} of {made.tried}, first {first.term}"
    if len({one.slot for one in made.where}) > 1:
        text += f" at {first.slot}"
    if first.alike:
        text += f" ({len(first.alike)} more do the same here)"
    if first.left > STAND_IN:
        over = " and ".join(row[0] for row in first.valid)
        return (
            f"Something is missing, and no formula is it: the nearest of {made.tried} acts at {first.slot} "
            f"over {over} and leaves {share_text(first.left)} of the misfit. What is missing may go with the "
            "time or with what is not recorded, or act at several places"
        )
    if not first.accepted:
        text += ". It does not predict the conditions left out, and is not to be relied on"
    if first.p_value_after < ALPHA:
        text += ". The model with it still does not agree with the data: something is left beside it"
    return text


def _where(where: Sequence[Where]) -> str:
    """At which slot and over what, where these are sure; else between which these data do not tell."""
    slots = list(dict.fromkeys(one.slot for one in where))
    drivers = list(dict.fromkeys(" and ".join(one.over) for one in where))
    if len(slots) > 1 and len(drivers) > 1:
        return f", its place and what it depends on not sure ({_or([str(one) for one in where])})"
    at = f" at {slots[0]}" if len(slots) == 1 else f", its place not sure ({_or(slots)}),"
    over = f" over {drivers[0]}" if len(drivers) == 1 else f", not sure over what ({_or(drivers)})"
    return at + over


def _or(names: Sequence[str]) -> str:
    """Some of several, and how many more."""
    shown, more = names[: _RIVALS + 1], len(names) - _RIVALS - 1
    return f"{', '.join(shown)} or {more} more" if more > 0 else " or ".join(shown)
