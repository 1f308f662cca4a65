"""Rates of the tier ``discovery``, with their targets."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.effects.drivers import driver_variables
from rigctl.effects.registry import find_effect
from rigctl_validation.figures import Figures, Rate, rate_of
from rigctl_validation.outcome import Searched
from rigctl_validation.planted.terms import find_planted
from rigctl_validation.planted.trial import SIZES
from rigctl_validation.planted.work import PlantedOutcome

#: a held-out error of up to this multiple of the noise counts as within it
_WITHIN = 1.1
_FAMILY = "hydraulic_cylinder"


def planted_figures(outcomes: Sequence[PlantedOutcome]) -> Figures:
    """All results of the tier that are printed."""
    return Figures(tuple(outcomes), planted_rates(outcomes), _confusion(outcomes))


def planted_rates(outcomes: Sequence[PlantedOutcome]) -> tuple[Rate, ...]:
    """All rates of the tier."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    nothing = [o for o in counted if not o.scenario.term]
    planted = [o for o in counted if o.scenario.term]
    open_gate = [o for o in planted if _of(o).gate == "outside_library"]
    every = "planted, the gate open"
    rates = [
        rate_of("nothing planted", "a formula is given", nothing, _gives, at_most=0.05),
        rate_of("planted", "the gate opens", planted, lambda o: _of(o).gate == "outside_library"),
        rate_of(
            "planted", "an effect of the library explains it", planted, lambda o: _of(o).gate == "library"
        ),
        rate_of("planted", "outside the library, undecided or a true level", planted, _honest, at_least=0.95),
        rate_of("planted", "a wrong location or variable is certain", planted, _wrong_cause, at_most=0.01),
        rate_of(every, "the place is among the first two", open_gate, _placed, at_least=0.95),
        rate_of(every, "the truth is in the set", open_gate, lambda o: _of(o).in_set, at_least=0.90),
        rate_of(every, "held out within 10 % of the noise", open_gate, _within, at_least=0.90),
        *(
            rate_of(
                f"planted, λ = {size:g}",
                "the truth is in the set",
                [o for o in open_gate if o.scenario.size == size],
                lambda o: _of(o).in_set,
            )
            for size in SIZES
        ),
    ]
    return tuple(rate for rate in rates if rate.trials)


def _of(outcome: PlantedOutcome) -> Searched:
    return outcome.searched or Searched()


def _wrong_cause(outcome: PlantedOutcome) -> bool:
    """Whether the diagnosis states a location or variables as certain that are not the term's."""
    term = find_planted(outcome.scenario.term)
    for claim in outcome.claims:
        effect = find_effect(claim.effect, _FAMILY)
        located = set(effect.slots) <= set(term.slots)
        if (claim.place and not located) or (
            claim.driver and not (located and driver_variables(effect) == term.variables)
        ):
            return True
    return False


def _honest(outcome: PlantedOutcome) -> bool:
    return outcome.verdict not in (None, "adequate") and not _wrong_cause(outcome)


def _gives(outcome: PlantedOutcome) -> bool:
    return bool(_of(outcome).formulas)


def _placed(outcome: PlantedOutcome) -> bool:
    return bool(set(find_planted(outcome.scenario.term).slots) & set(_of(outcome).places))


def _within(outcome: PlantedOutcome) -> bool:
    return _of(outcome).heldout_after <= _WITHIN


def _confusion(outcomes: Sequence[PlantedOutcome]) -> dict[str, dict[str, int]]:
    """Counts of the answers, by planted term."""
    table: dict[str, dict[str, int]] = {}
    for outcome in outcomes:
        if outcome.counts:
            row = table.setdefault(outcome.scenario.term or "nothing", {})
            answer = _answer(outcome)
            row[answer] = row.get(answer, 0) + 1
    return table


def _answer(outcome: PlantedOutcome) -> str:
    """The answer, or the planted term if the answer contains it."""
    searched = _of(outcome)
    truth = outcome.scenario.term
    if outcome.failure:
        return "failed"
    if searched.in_set or (not truth and searched.gate == "adequate"):
        return truth or "nothing"
    if searched.gate != "outside_library":
        return f"{searched.gate}: {' + '.join(outcome.effects)}" if outcome.effects else searched.gate
    return searched.formulas[0] if searched.formulas else "no formula"
