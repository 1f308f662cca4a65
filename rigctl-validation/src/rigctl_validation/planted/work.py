"""One trial, from the separate bench to the formulas."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.discovery.discover import discover_beside
from rigctl.discovery.formulas import SAME
from rigctl.discovery.result import Discovery, FoundFormula
from rigctl.effects.declaration import qualified
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl_validation.amplitude import Amplitude
from rigctl_validation.bench.campaign import clean_outputs
from rigctl_validation.hidden_effect import hide
from rigctl_validation.outcome import Searched, TrialOutcome
from rigctl_validation.planted.terms import find_planted
from rigctl_validation.planted.trial import PlantedTrial
from rigctl_validation.work import claim_of, diagnose_campaign, plain_of, reference_of

Floats = NDArray[np.float64]
PlantedOutcome: TypeAlias = TrialOutcome[PlantedTrial]

#: the true location must be among this many first ones
_FIRST = 2


@one_thread()
@switched_off()
def carry_out_planted(trial: PlantedTrial) -> PlantedOutcome:
    """Plant a term, or none, diagnose the textbook model, search for a formula, and return the outcome.

    Raises
    ------
    RigctlError
        the tool cannot diagnose the campaign.
    BenchFailure
        the bench cannot be simulated with the planted term.
    """
    began = time.process_time()
    scenario = trial.scenario
    campaign, outcome = scenario.campaign(()), TrialOutcome(trial)
    amplitude = None
    if trial.term:
        term = find_planted(trial.term)
        amplitude = reference_of(plain_of(scenario)).amplitude(term.hidden, trial.size, scenario, trial.sign)
        outcome = TrialOutcome(trial, sizes=(amplitude.size,), amplitudes=(amplitude.value,))
        if not amplitude.reached:
            return replace(outcome, untested="no amplitude has the size wanted")
        campaign = hide(campaign, [(term.hidden, amplitude.value)], "other")
    diagnosis = diagnose_campaign(scenario, campaign)
    discovery = discover_beside(diagnosis)
    return replace(
        outcome,
        verdict=diagnosis.verdict.value,
        effects=diagnosis.effects,
        classes=diagnosis.classes,
        claims=tuple(claim_of(one) for one in diagnosis.levels),
        all_of_it=diagnosis.remainder is None,
        first=discovery.located[0].slot.name if discovery.located else None,
        searched=_searched(trial, amplitude, discovery),
        seconds=time.process_time() - began,
    )


def _searched(trial: PlantedTrial, amplitude: Amplitude | None, discovery: Discovery) -> Searched:
    best = discovery.formulas[0] if discovery.formulas else None
    check = None if best is None else best.check
    return Searched(
        gate=discovery.gate.reason,
        places=tuple(_locations(discovery)),
        over=tuple(driver.name for driver in discovery.located[0].over) if discovery.located else (),
        formulas=tuple(one.fitted.formula.key for one in discovery.formulas),
        in_set=amplitude is not None and _in_set(trial, amplitude, discovery.formulas),
        heldout_before=math.nan if check is None else check.before,
        heldout_after=math.nan if check is None else check.after,
        accepted=best is not None and best.accepted,
        sure=discovery.searched is not None and discovery.searched.sure,
    )


def _locations(discovery: Discovery) -> list[str]:
    """The first locations of the answer, each with those at which a term has the same effect."""
    alike = {one.slot.name: one.alike for one in discovery.located}
    names: list[str] = []
    slots: list[str] = []
    for slot in dict.fromkeys(one.slot for one in discovery.where):
        if slot not in slots and slot not in names:
            slots.append(slot)
            if len(slots) <= _FIRST:
                names += [slot, *alike.get(slot, ())]
    return names


def _in_set(trial: PlantedTrial, amplitude: Amplitude, formulas: Sequence[FoundFormula]) -> bool:
    """Whether the set has the planted form, or one with the same effect on the readings."""
    term = find_planted(trial.term)
    keys = {f"{slot}: {form}" for slot in term.slots for form in term.forms}
    tried = [one.fitted.formula for one in formulas]
    if any(one.key in keys for formula in tried for one in (formula, *formula.same)):
        return True
    scenario = trial.scenario
    steady = replace(scenario.plain, seed=0)
    unexplained = reference_of(plain_of(scenario)).unexplained
    with_it = clean_outputs(hide(steady, [(term.hidden, amplitude.value)], "other"))
    outputs = unexplained.problem.measurements.outputs
    truth = [
        np.column_stack([changed[name] - plain[name] for name in outputs])
        for (_, changed), (_, plain) in zip(with_it, clean_outputs(steady), strict=True)
    ]
    return any(abs(_cosine(unexplained.of(truth), unexplained.of(_does(one)))) > SAME for one in formulas)


def _does(one: FoundFormula) -> list[Floats]:
    """(n, outputs) for each record: the change of the outputs by the formula at its fit."""
    fit = one.fitted.trial.fit
    names = [unknown.name for unknown in fit.problem.shared]
    without = np.array(fit.values)
    without[names.index(qualified(one.name, "size"))] = 0.0
    simulated = [
        fit.problem.simulate(values, list(fit.local)).require().outputs for values in (fit.values, without)
    ]
    return [
        np.take(a, fit.problem.channels, axis=1) - np.take(b, fit.problem.channels, axis=1)
        for a, b in zip(*simulated, strict=True)
    ]


def _cosine(one: Floats, other: Floats) -> float:
    length = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / length if length else 0.0
