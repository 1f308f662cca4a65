"""Search beyond the library: where a term is missing, over which variable, as a curve, and by which
formulas.

In: a diagnosis that found something missing and no effect certain to be it (`gate`). Out: a `Discovery`: the
locations with their significance, curves of the term, and a set of formulas that these data do not
distinguish. The order is one of falling certainty: a location needs no formula, a curve no choice of a form,
and each step is made only where the one before found something.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from rigctl.analysis.agreement.adequacy import Adequacy
from rigctl.analysis.comparison import compare
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
from rigctl.discovery.locate import locate
from rigctl.discovery.open_slots import OpenSlots, open_slots
from rigctl.discovery.passivity import passivity
from rigctl.discovery.result import Discovery, FormulaParameter, FoundFormula, parameter
from rigctl.effects.declaration import qualified
from rigctl.effects.drivers import Driver
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.model import Model
from rigctl.physics.family import ModelFamily
from rigctl.tasks import Workers

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
    result = Discovery(diagnosis.runs, diagnosis.model, gate, None, (), (), 0, diagnosis)
    if not gate.open:
        return result
    # 1. Where: a term of any smooth form at every slot, over every variable.
    samples = RefittedSets(before, before.whole).samples
    opened = open_slots(before, progress=report)
    searched = locate(opened, samples, slot, report)
    result = replace(result, searched=searched)
    # 2. Without a significant location no formula is tried: some formula always fits something.
    if not searched.sure:
        return result
    report("Scoring formulas")
    # 3. Formulas at all locations that the data allow, scored by the linear problem, and the best refitted.
    scored = score_formulas(opened, searched.most_wanted, samples)
    fitted = refit_formulas(before.fit, scored.formulas, samples, scored.tried, report, workers)
    # 4. What pays at all, and of that all that is not significantly worse than the best: a set, not one
    #    formula.
    none = RefittedSets(before, before.whole).null
    paying = [one for one in fitted if one.cost < none.chi2]
    chosen = within(paying)
    formulas = tuple(_found(one, chosen[0], opened, none) for one in chosen)
    slots = {one.formula.slot.name for one in chosen}
    # A slot whose best formula was refitted and is not in the set: its location is excluded by a refit,
    # although the linear problem may not have excluded it.
    refuted = frozenset(one.formula.slot.name for one in fitted) - slots
    report("Drawing the curves")
    curves = curves_of(opened, [one.formula for one in chosen], searched.located, _CURVES)
    return replace(result, curves=curves, formulas=formulas, tried=scored.tried, refuted=refuted)


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
