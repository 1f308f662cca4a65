"""The worth of a set of records: how far it separates the rivals, or how precisely it determines a size.

In: the `Evidence` of records together, of every rival. Out: a number that a search maximises, and the
probability by which it may stop. One class for each aim: `Discrimination`, `Detection`, `Precision`. A
distance counts as a share of the sufficient distance, up to 1: a pair that is distinguished reliably needs
no further record, however far one would separate it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import LEAST_SEPARATION
from rigctl.design.information import Evidence
from rigctl.design.information_so_far import Known
from rigctl.design.power import Gain, detection_power, enough, enough_seen, power_to_distinguish, threshold_of
from rigctl.design.result import NONE
from rigctl.design.rivals import Question, Rival

Floats = NDArray[np.float64]
#: indices of a truth and of a rival
Pair: TypeAlias = tuple[int, int]


#: D at draws of the truth scatters about D at the fits: a search relies on this share of it
_SURE = 1.0 / 1.5
#: just below the D that corresponds to the separation required for a verdict
_INDISTINGUISHABLE = 0.999 * (2.0 * LEAST_SEPARATION) ** 2
#: weight of the mean over the rivals, beside the least
_OTHERS = 0.1


class Criterion(Protocol):
    """The quantity that is maximised, and the probability that it predicts before any draws are used."""

    def worth(self, evidence: Evidence) -> float:
        """Worth of all new records together, which a search maximises."""
        ...

    def separation(self, evidence: Evidence) -> float:
        """The criterion as displayed: D, λ², or the logarithm of a ratio of volumes."""
        ...

    def predicted_probability(self, evidence: Evidence) -> float:
        """The probability, at the rivals' fits, that the records answer the question."""
        ...


@dataclass(frozen=True)
class Margins:
    """The margins by which the data so far prefer one rival to another, and those that a verdict requires.

    Attributes
    ----------
    mbic: (k) of each rival.
    chi2: (k) that each leaves.
    none: the index of the model without any; None if it is not a rival.
    """

    mbic: Floats
    chi2: Floats
    none: int | None

    @classmethod
    def of(cls, rivals: Sequence[Rival], none: int | None) -> Margins:
        """The margins of rivals that are fitted to the data so far."""
        return cls(np.array([one.mbic for one in rivals]), np.array([one.trial.chi2 for one in rivals]), none)

    def margin(self, truth: int, rival: int) -> float:
        """L₀: mBIC of the rival less that of the truth."""
        return float(self.mbic[rival] - self.mbic[truth])

    def threshold(self, truth: int, distances: Floats) -> float:
        """t, if the truth explains what it does so far, and its D from the model without it in addition."""
        if self.none is None or self.none == truth:
            return threshold_of(0.0)
        # The more an effect explains, the larger a difference its shape tolerance can make: t grows with χ².
        so_far = float(self.chi2[self.none] - self.chi2[truth])
        return threshold_of(max(so_far, 0.0) + float(distances[truth, self.none]))


@dataclass(frozen=True)
class Discrimination:
    """``Σ w_i·min_j D_ij`` over the pairs to be distinguished, each divided by its overdispersion.

    A search maximises it with ``min(D_ij/D*_ij, 1)`` in place of D_ij, D* being sufficient; a tenth of the
    mean over j is added to the minimum, so that a pair which no record distinguishes does not hide the
    others.

    Attributes
    ----------
    reach: by pair, the share of the linear D that remains when the rival is actually refitted; 1 if not
        computed, and 0 for a rival that contains the right one.
    """

    question: Question
    known: Known
    reach: Mapping[Pair, float] = field(default_factory=dict)

    @cached_property
    def margins(self) -> Margins:
        """Margins of the rivals."""
        names = [one.name for one in self.question.rivals]
        return Margins.of(self.question.rivals, names.index(NONE) if NONE in names else None)

    @cached_property
    def rivals_of(self) -> dict[int, tuple[int, ...]]:
        """For each possible truth, the rivals from which it is to be distinguished."""
        rivals_by_truth: dict[int, tuple[int, ...]] = {}
        for truth, rival in self.question.pairs:
            rivals_by_truth[truth] = (*rivals_by_truth.get(truth, ()), rival)
        return rivals_by_truth

    @cached_property
    def weights(self) -> dict[int, float]:
        """Weights of the possible truths, with sum 1."""
        raw = {truth: self.question.rivals[truth].weight for truth in self.rivals_of}
        total = sum(raw.values()) or 1.0
        return {truth: weight / total for truth, weight in raw.items()}

    def distances(self, evidence: Evidence) -> Floats:
        """(k, k) D in noise as wide as the truth's own fit leaves it."""
        # Row i: noise as wide as the truth i leaves it at its own fit, whichever rival is refitted.
        factors = np.array([one.overdispersion for one in self.question.rivals])
        distances = np.asarray(evidence.distances(self.known.information) / factors[:, None])
        for pair in self.pairs:
            distances[pair] *= self.stays(pair)
        return distances

    def separation(self, evidence: Evidence) -> float:
        """The criterion at the rivals' fits."""
        distances = self.distances(evidence)
        return self.together({pair: float(distances[pair]) for pair in self.pairs})

    def worth(self, evidence: Evidence) -> float:
        """The worth at the rivals' fits."""
        # For each truth its nearest rival counts, because a verdict names one effect only if all others are
        # excluded.
        shares = self._shares(evidence)
        return sum(
            weight * (min(shares[truth]) + _OTHERS * sum(shares[truth]) / len(shares[truth]))
            for truth, weight in self.weights.items()
        )

    def _shares(self, evidence: Evidence) -> dict[int, list[float]]:
        """For each possible truth, D of its rivals as shares of what is sufficient."""
        distances = self.distances(evidence)
        return {
            truth: [
                min(_SURE * float(distances[truth, rival]) / self._enough(truth, rival, distances), 1.0)
                for rival in rivals
            ]
            for truth, rivals in self.rivals_of.items()
        }

    def so_far(self, pair: Pair) -> float:
        """D₀ of the data so far; for two rivals that a diagnosis does not distinguish, less than a verdict
        requires: by chance they may be less separated than is expected of two such rivals."""
        truth, rival = pair
        expected = float(self.known.distances[truth, rival])
        names = frozenset((self.question.rivals[truth].name, self.question.rivals[rival].name))
        return min(expected, _INDISTINGUISHABLE) if names in self.question.alike else expected

    def _enough(self, truth: int, rival: int, distances: Floats) -> float:
        margin, so_far = self.margins.margin(truth, rival), self.so_far((truth, rival))
        return enough(margin, so_far, self.margins.threshold(truth, distances))

    def predicted_probability(self, evidence: Evidence) -> float:
        """The probability at the rivals' fits, less an allowance for draws."""
        distances = _SURE * self.distances(evidence)
        gains = {pair: Gain(distances[pair][None], distances[pair][None]) for pair in self.pairs}
        return self.together({pair: self.of_pair(pair, one, distances) for pair, one in gains.items()})

    def stays(self, pair: Pair) -> float:
        """The share of a pair's linear D that its rival cannot absorb."""
        truth, rival = (self.question.rivals[index] for index in pair)
        return 0.0 if rival.contains(truth) else self.reach.get(pair, 1.0)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """The pairs to be distinguished."""
        return self.question.pairs

    def of_pair(self, pair: tuple[int, int], gained: Gain, distances: Floats) -> float:
        """P of one pair."""
        truth, rival = pair
        return power_to_distinguish(
            gained,
            self.margins.margin(truth, rival),
            self.so_far(pair),
            self.margins.threshold(truth, distances),
        )

    def together(self, of_pairs: dict[tuple[int, int], float]) -> float:
        """The probability that the right one is distinguished from all its rivals: ``Σ w_i·min_j P_ij``."""
        return sum(
            weight * min(of_pairs[truth, rival] for rival in self.rivals_of[truth])
            for truth, weight in self.weights.items()
        )


@dataclass(frozen=True)
class Detection:
    """``Σ w_i·λ_i²`` of effects at their usual size, each against the model without, with the old data."""

    question: Question
    known: Known

    def noncentralities(self, evidence: Evidence) -> dict[int, float]:
        """λ² by effect: D from the model without it, old and new data together."""
        distances = (self.known.evidence + evidence).distances(self.known.prior)
        factor = self.question.rivals[self.none].overdispersion
        return {truth: float(distances[truth, self.none]) / factor for truth, _ in self.question.pairs}

    @property
    def none(self) -> int:
        """The index of the model without any of the effects."""
        return self.question.pairs[0][1]

    def separation(self, evidence: Evidence) -> float:
        """The criterion at the effects' usual sizes."""
        noncentralities = self.noncentralities(evidence)
        return sum(self.question.rivals[truth].weight * value for truth, value in noncentralities.items())

    def worth(self, evidence: Evidence) -> float:
        """The worth at the effects' usual sizes, each as a share of the sufficient λ²."""
        return sum(
            self.question.rivals[truth].weight * min(value / self._enough(truth), 1.0)
            for truth, value in self.noncentralities(evidence).items()
        )

    def _enough(self, truth: int) -> float:
        return enough_seen(self.question.rivals[truth].trial.parameters, self.question.library)

    def of_each(self, evidence: Evidence) -> dict[int, float]:
        """The power for each effect."""
        return {
            truth: detection_power(value, self.question.rivals[truth].trial.parameters, self.question.library)
            for truth, value in self.noncentralities(evidence).items()
        }

    def predicted_probability(self, evidence: Evidence) -> float:
        """The power, averaged over the effects."""
        probabilities = self.of_each(evidence)
        return sum(self.question.rivals[truth].weight * value for truth, value in probabilities.items())


@dataclass(frozen=True)
class Precision:
    """Ds-optimality: logarithm of the ratio of the volumes of the confidence regions of the chosen
    parameters."""

    question: Question
    known: Known

    @cached_property
    def places(self) -> list[int]:
        """Indices of the chosen parameters among the common unknowns."""
        names = [unknown.name for unknown in self.question.rivals[0].fit.problem.shared]
        return [k for k, name in enumerate(names) if name in self.question.columns]

    def covariance(self, evidence: Evidence | None = None) -> Floats:
        """Covariance of the chosen parameters, scaled, now or with new records."""
        known = self.known.information[0]
        # ln(|C_before|/|C_after|) of the chosen parameters alone: all others are nuisances, and inverting the
        # whole information before taking the block integrates them out.
        information = known if evidence is None else known + evidence.information[0]
        return np.asarray(np.linalg.inv(information), dtype=float)[np.ix_(self.places, self.places)]

    def worth(self, evidence: Evidence) -> float:
        """The worth at the fit."""
        before, after = (np.linalg.slogdet(self.covariance(one))[1] for one in (None, evidence))
        return float(before - after)

    def separation(self, evidence: Evidence) -> float:
        """The criterion at the fit."""
        return self.worth(evidence)

    def predicted_probability(self, evidence: Evidence) -> float:
        """0, so that a search never stops early: any further record improves the estimate."""
        return 0.0
