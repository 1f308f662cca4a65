"""Rates of the tier ``design``: the pairs distinguished by designed records, against the predictions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rigctl.learning.ending import LearningEnd
from rigctl_validation.designed.work import DesignOutcome
from rigctl_validation.figures import Figures, Rate, rate_of
from rigctl_validation.outcome import LearningOutcome

#: bins of the predicted probability
BINS = ((0.0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0))
#: number of pairs from which a bin's share is judged; tolerated difference from the mean prediction
_ENOUGH, _APART = 20, 0.10
#: D of a designed record over the median of any that the bench can make
_BETTER = 4.0


def design_figures(outcomes: Sequence[DesignOutcome]) -> Figures:
    """All results of the tier that are printed."""
    return Figures(tuple(outcomes), design_rates(outcomes), _confusion(outcomes))


def design_rates(outcomes: Sequence[DesignOutcome]) -> tuple[Rate, ...]:
    """All rates of the tier, with their targets."""
    every = [outcome for outcome in outcomes if outcome.counts]
    designed_trials = [one for one in every if not one.scenario.taken]
    open_before = [one for one in designed_trials if _of(one).left]
    designed = [one for one in open_before if _of(one).probability is not None]
    inseparable = [one for one in open_before if _of(one).probability is None]
    complete = [one for one in designed_trials if one.scenario.rounds > 2]
    at_random = [one for one in every if one.scenario.taken and _of(one).probability is not None]
    compared = [one for one in designed if _of(one).of_random]
    rates = [
        rate_of("the campaign leaves a class", "records are proposed", open_before, _proposed),
        rate_of("one designed set", "the truth alone is named", designed, _alone, at_least=0.80),
        rate_of("one designed set", "another one is named", designed, _wrong, at_most=0.01),
        rate_of("a class that no record separates", "reported as such", inseparable, _reported, at_least=1.0),
        rate_of("one to four records at random", "the truth alone is named", at_random, _alone),
        rate_of("one to four records at random", "another one is named", at_random, _wrong, at_most=0.01),
        rate_of("D of the first designed record", "4 times a random one's", compared, _telling, at_least=0.5),
        *(one.rate for one in calibration_bins(every)),
        rate_of(
            "learning to its end", "adequate, the truth or its class", complete, _ends_right, at_least=0.90
        ),
        rate_of("learning to its end", "something wrong is added", complete, _wrong, at_most=0.01),
    ]
    return tuple(rate for rate in rates if rate.trials)


@dataclass(frozen=True)
class CalibrationBin:
    """Pairs with about the same predicted probability of being distinguished.

    Attributes
    ----------
    low, high: of the probabilities.
    mean: of the predictions.
    achieved, pairs: number of pairs distinguished, and of all.
    """

    low: float
    high: float
    mean: float
    achieved: int
    pairs: int

    @property
    def rate(self) -> Rate:
        """With the tolerated difference between share and mean, if there are enough pairs."""
        enough = self.pairs >= _ENOUGH
        return Rate(
            f"a pair predicted with {self.low:.0%} to {self.high:.0%}, {self.mean:.0%} on average",
            "distinguished",
            self.achieved,
            self.pairs,
            at_least=max(self.mean - _APART, 0.0) if enough else None,
            at_most=min(self.mean + _APART, 1.0) if enough else None,
        )


def calibration_bins(outcomes: Sequence[DesignOutcome]) -> Iterator[CalibrationBin]:
    """For each pair of a hidden effect and a rival, the prediction and the outcome; in bins.

    Designed and random records together, as few designs predict a low probability.
    """
    pairs = [pair for one in outcomes if one.counts for pair in _pairs(one)]
    for low, high in BINS:
        among = [(chance, correct) for chance, correct in pairs if low <= chance < high + (high == 1.0)]
        if among:
            mean = sum(chance for chance, _ in among) / len(among)
            yield CalibrationBin(low, high, mean, sum(correct for _, correct in among), len(among))


def _of(outcome: DesignOutcome) -> LearningOutcome:
    return outcome.learnt or LearningOutcome()


def _proposed(outcome: DesignOutcome) -> bool:
    return _of(outcome).probability is not None


def _reported(outcome: DesignOutcome) -> bool:
    """Whether the loop ended because no record would distinguish the class."""
    return _of(outcome).ended == LearningEnd.NOT_SEPARABLE


def _pairs(outcome: DesignOutcome) -> list[tuple[float, bool]]:
    """(predicted, actual) for each pair; for older results, for all rivals together."""
    learning = _of(outcome)
    if learning.chances or learning.probability is None:
        return [(chance, rival in learning.apart) for rival, chance in learning.chances.items()]
    return [(learning.probability, learning.told and learning.winner in outcome.scenario.truth)]


def _telling(outcome: DesignOutcome) -> bool:
    return (_of(outcome).of_first or 0.0) >= _BETTER * (_of(outcome).of_random or 0.0)


def _alone(outcome: DesignOutcome) -> bool:
    return set(_of(outcome).added) == set(outcome.scenario.truth)


def _wrong(outcome: DesignOutcome) -> bool:
    """Whether an effect was added that is not hidden."""
    return bool(set(_of(outcome).added) - set(outcome.scenario.truth))


def _ends_right(outcome: DesignOutcome) -> bool:
    """Whether it ends with exactly the hidden effects, or states that the rest cannot be distinguished."""
    learning = _of(outcome)
    if _wrong(outcome):
        return False
    if learning.ended == "adequate":
        return _alone(outcome)
    return learning.ended == "not_separable" and outcome.right


def _confusion(outcomes: Sequence[DesignOutcome]) -> dict[str, dict[str, int]]:
    """Counts of the added effects, by hidden effects; for designed records."""
    table: dict[str, dict[str, int]] = {}
    for outcome in outcomes:
        if outcome.counts and not outcome.scenario.taken:
            row = table.setdefault(" + ".join(sorted(outcome.scenario.truth)), {})
            answer = (
                "failed" if outcome.failure else " + ".join(sorted(_of(outcome).added)) or _of(outcome).ended
            )
            row[answer] = row.get(answer, 0) + 1
    return table
