"""Rates of the tier ``design``: what designed records told, and whether their promise held."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rigctl.validation.designed.work import DesignOutcome
from rigctl.validation.figures import Figures, Rate, rate_of
from rigctl.validation.outcome import Learnt

#: promised probabilities that are counted together
BINS = ((0.5, 0.6), (0.6, 0.7), (0.7, 0.8), (0.8, 0.9), (0.9, 1.0))


def design_figures(outcomes: Sequence[DesignOutcome]) -> Figures:
    """Everything that is printed of the tier."""
    return Figures(tuple(outcomes), design_rates(outcomes), _confusion(outcomes))


def design_rates(outcomes: Sequence[DesignOutcome]) -> tuple[Rate, ...]:
    """All rates of the tier, with their targets."""
    made = [outcome for outcome in outcomes if outcome.counts]
    open_before = [one for one in made if _of(one).left]
    designed = [one for one in open_before if _of(one).probability is not None]
    whole = [one for one in made if one.scenario.rounds > 2]
    found = [
        rate_of("the campaign leaves a class", "records are proposed", open_before, _proposed),
        rate_of("one designed set", "the truth alone is named", designed, _alone, at_least=0.80),
        rate_of("one designed set", "another one is named", designed, _wrong, at_most=0.01),
        *_promises(designed),
        rate_of("learning to its end", "adequate, the truth or its class", whole, _learnt, at_least=0.90),
        rate_of("learning to its end", "something wrong is added", whole, _wrong, at_most=0.01),
    ]
    return tuple(rate for rate in found if rate.trials)


def _promises(designed: Sequence[DesignOutcome]) -> Iterator[Rate]:
    """Of what was promised with a probability, how much came out."""
    for low, high in BINS:
        among = [one for one in designed if low <= (_of(one).probability or 0.0) < high + (high == 1.0)]
        yield rate_of(f"promised with {low:.0%} to {high:.0%}", "came out", among, _came_out)


def _of(outcome: DesignOutcome) -> Learnt:
    return outcome.learnt or Learnt()


def _proposed(outcome: DesignOutcome) -> bool:
    return _of(outcome).probability is not None


def _came_out(outcome: DesignOutcome) -> bool:
    return _of(outcome).told and _of(outcome).winner in outcome.scenario.truth


def _alone(outcome: DesignOutcome) -> bool:
    return set(_of(outcome).added) == set(outcome.scenario.truth)


def _wrong(outcome: DesignOutcome) -> bool:
    """Whether an effect was added that is not hidden."""
    return bool(set(_of(outcome).added) - set(outcome.scenario.truth))


def _learnt(outcome: DesignOutcome) -> bool:
    """Whether it ends with exactly what is hidden, or says that the rest cannot be told apart here."""
    found = _of(outcome)
    if _wrong(outcome):
        return False
    if found.ended == "adequate":
        return _alone(outcome)
    return found.ended == "not_separable" and outcome.right


def _confusion(outcomes: Sequence[DesignOutcome]) -> dict[str, dict[str, int]]:
    """By what was hidden, what was added."""
    table: dict[str, dict[str, int]] = {}
    for outcome in outcomes:
        if outcome.counts:
            row = table.setdefault(" + ".join(sorted(outcome.scenario.truth)), {})
            said = (
                "failed" if outcome.failure else " + ".join(sorted(_of(outcome).added)) or _of(outcome).ended
            )
            row[said] = row.get(said, 0) + 1
    return table
