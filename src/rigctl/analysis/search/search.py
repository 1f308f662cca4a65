"""Search for the set of effects that explains a misfit: singles, pairs, forward and backward steps.

In: a comparison of the model with the data. Out: the best set, `Search.best`, which need not be right. Each
step takes its candidates from a linear problem and decides by refits: scores, pairs and cosines are linear at
their fits, and only order what is worth fitting. The search continues as long as the tests reject what is
left, however small its share, and the members of a set are exchanged for their rivals. All pairs of effects
are tried on the linearised problem, as two effects may improve the criterion only together. The sets
themselves are fitted, compared and judged by `RefittedSets`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import (
    ALIKE,
    FAR,
    FAR_SHARE,
    LEAST_DIFFERENCE,
    TOLERANCE,
    WORTH,
)
from rigctl.analysis.fitting import OnProgress, no_progress
from rigctl.analysis.linear.candidates import Candidate, at_sizes
from rigctl.analysis.linear.linearisation import linearise
from rigctl.analysis.linear.nuisance_projection import project
from rigctl.analysis.linear.pair_gains import pair_gains
from rigctl.analysis.linear.score_test import Score, screen
from rigctl.analysis.linear.separability import cosine, separation, softened
from rigctl.analysis.search.linearised_set import View
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.refit_alone import alone, near_best
from rigctl.analysis.search.refitted_sets import MOST_RIVALS, RefittedSets
from rigctl.errors import RigctlError
from rigctl.tasks import counted

_BEST = 3
_PAIRS = 2
_SWAPS = 3
#: number of sizes at which an effect is tried if its slope at the null is uninformative
_SIZES = 2
#: largest number of effects refitted from finite sizes where only the floor of the noise is known, and the
#: share of the best one's gain that they must promise
_TWINS, _TWIN = 5, 0.5
#: largest number of effects in one set: three wrong effects together explain almost anything, and three right
#: ones are found one after the other by the loop
_TOGETHER = 2


def require_number_of_effects(most: int) -> None:
    """Refuse a search for sets of no effect, which a comparison is.

    Raises
    ------
    RigctlError
        `most` is less than one.
    """
    if most < 1:
        raise RigctlError("too few effects to search for", value=str(most), expected="at least 1")


@dataclass
class Search(RefittedSets):
    """The search for the best set of one comparison.

    Attributes
    ----------
    most: largest number of effects in a set.
    unusual_best: a set better than the best one, put aside because a parameter is outside its usual range.
    given: the model as it was compared, before the scale of its errors was reduced to what a set of effects
        leaves.
    """

    most: int = _TOGETHER
    on_progress: OnProgress = no_progress
    unusual_best: RefittedSet | None = None
    given: ModelComparison | None = None

    def best(self) -> RefittedSet:
        """The set that explains the misfit best: singles, pairs, backward steps, and replacements."""
        # Every step proposes sets by a linear problem, refits a few of them, and keeps the one with the least
        # mBIC (`least`). Whether there is a next step depends not on mBIC but on the tests of what the best
        # set leaves (`left`, `below_noise`). All refits stay in `trials`, where the judgement finds them.
        #
        # 1. One effect. Its rivals are tried in its place at once: the first one to enter need not be right.
        best = self._at_sizes(self.best_single())
        best = self._swapped(best)
        # 2. Two effects, if the one leaves something. A pair loses a member that does not pay before members
        #    are exchanged, so that exchanges are compared with what is really needed.
        best = self._backward(self._pairs(best))
        best = self._exchanged(self._swapped(best))
        # 3. Corrections for what mBIC does not know: laws have a shape tolerance, within which a set of fewer
        #    parameters is preferred; two effects may be imitated by one that leaves hardly anything; a size
        #    may be unusual; and an effect may only follow the law of one that the model has.
        best = self._pair_instead(self._simplest(best))
        return self._beyond_laws(self._usual_first(best))

    def best_single(self) -> RefittedSet:
        """The single effect that explains the misfit best, or none."""
        if not self.null_tests.screening.scores:
            return self.null
        self._singles()
        return self.least([self.null, *self.trials.values()])

    @cached_property
    def in_own_scale(self) -> bool:
        """Whether only the floor of some noise is known: what a model leaves is then the scale of its
        errors."""
        return bool(self.before.fit.problem.noise.own_scale)

    def nearest(self) -> RefittedSet:
        """The set with the least misfit, whatever it costs: single effects, also at finite sizes."""
        if not self.null_tests.screening.scores:
            return self.null
        self._singles()
        self._finite_sizes()
        return min(self.describing([self.null, *self.trials.values()]), key=lambda one: one.chi2)

    def _singles(self) -> None:
        # All scores come from one linearisation, at the fit without any effect: they order the candidates,
        # and no more. Refitted are the leaders, and whatever has a signature so similar to the first one's
        # that only a refit can tell the two apart.
        scores = self.null_tests.screening.scores
        lin, projected = self.null_tests.linearisation, self.null_tests.projected
        by_gain = sorted(scores, key=lambda score: -score.gain)
        leader = by_gain[0]
        alike = [
            score
            for score in by_gain
            if score.gain > 0.0 and self._near(cosine(projected, leader.candidate, score.candidate), leader.z)
        ]
        # An effect has a score at each of its shapes: it is named once, at its best place in the order.
        chosen = list(dict.fromkeys(score.effect for score in [*by_gain[:_BEST], *alike]))
        if self.of_few_rows:
            chosen = self._near_alone([score.effect for score in by_gain])
        by_name = {score.effect: score for score in scores}
        few = [by_name[effect] for effect in chosen[: None if self.of_few_rows else _BEST + MOST_RIVALS]]
        worth = [score for score in few if score.gain > 0.0 or self.of_few_rows]
        for score in counted(worth, "Refitting with each of the likely effects", self.on_progress):
            self.refitted((lin.candidates[score.candidate],), self.null)

    def promised(self, score: Score) -> float:
        """The reduction of χ² by an effect: as fitted by itself if it was, else by the linear problem."""
        fitted = self.alone.get(score.effect)
        return score.gain if fitted is None else max(self.null.chi2 - fitted.chi2, 0.0)

    def alone_amplitudes(self, effect: str) -> list[float]:
        """An effect's parameters less their null as fitted by itself, SI; empty if it was not."""
        fitted = self.alone.get(effect)
        if fitted is None:
            return []
        at = {u.name: float(v) for u, v in zip(fitted.fit.problem.shared, fitted.fit.values, strict=True)}
        declared_by_name = {name: fitted.candidate.parameter(name) for name in fitted.candidate.columns}
        return [
            at.get(name, declared.at_null) - declared.at_null for name, declared in declared_by_name.items()
        ]

    def _near_alone(self, effects: Sequence[str]) -> list[str]:
        """The effects that come close to the best one when each is fitted by itself."""
        scores = {score.effect: score for score in self.before.screening.scores}
        for effect in counted(effects, "Fitting with each effect alone", self.on_progress):
            candidate = self.before.linearisation.candidates[scores[effect].candidate]
            from_null = scores[effect].gain > 0.0
            rival = min((one.chi2 for one in self.alone.values() if one is not None), default=math.inf)
            self.alone[effect] = alone(self.before, candidate, from_null=from_null, rival=rival)
        return near_best(self.alone)

    @staticmethod
    def _near(cos: float, size: float) -> bool:
        """Whether two signatures are so similar that a refit must decide between them."""
        return cos > ALIKE and separation(size, cos) < max(FAR, FAR_SHARE * size)

    def _at_sizes(self, best: RefittedSet) -> RefittedSet:
        """The best set with effects whose slope at the null is uninformative, if no other explains the
        misfit.

        After the fitted parameters have compensated for a large effect, the slope of the residual with
        respect to it may have the wrong sign: such effects are evaluated at a few finite sizes, like those
        with a threshold.
        """
        if self.of_few_rows or not self.left(best) > self.allowed or self.below_noise(best):
            return best
        self._finite_sizes()
        return self.least([best, *self.trials.values()])

    def _finite_sizes(self) -> None:
        """Refit the effects whose slope at the null is uninformative, from the finite sizes that promise
        most."""
        tried = {name for trial in self.trials.values() for name in trial.effects}
        gains = {score.effect: score.gain for score in self.before.screening.scores}
        # Silent: not refitted yet, and with a score that promises next to nothing. An effect with secants is
        # left out, since its score was taken at finite sizes already.
        silent = [
            one
            for one in self.before.linearisation.candidates
            if one.name not in tried and gains.get(one.name, math.inf) < WORTH and not one.secants
        ]
        sized = [secant for one in silent for secant in at_sizes(one, _SIZES)]
        if not sized:
            return
        self.on_progress("Trying effects at finite sizes")
        try:
            scores = screen(project(linearise(self.before.fit, self.whole, sized))).scores
        except RigctlError:  # the model cannot be simulated with one of them
            return
        # for so large an effect the linear problem is inaccurate: it only orders the candidates
        promising = sorted((score for score in scores if score.gain > WORTH), key=lambda one: -one.gain)
        most = _PAIRS
        if self.in_own_scale and promising:  # an effect and its twin at another location promise the same
            most = sum(score.gain >= _TWIN * promising[0].gain for score in promising[:_TWINS])
        names = [score.effect for score in promising][: max(most, _PAIRS)]
        for name in counted(names, "Refitting from finite sizes", self.on_progress):
            for one in (one for one in sized if one.name == name):
                self.refitted_also_from((one,), self.null)

    def _pairs(self, best: RefittedSet) -> RefittedSet:
        """The best pairs of the linear problem, with the best single effect's next candidates and without it.

        Beside an effect that leaves hardly anything, only the next candidates; no pairs if nothing is left.
        """
        remaining = self.left(best)
        if self.most < 2 or not remaining or self.below_noise(best):
            return best
        if best.candidates and remaining <= self.allowed:
            self._forward(best)
            return self._complete_before_least([best, *self.trials.values()])
        # Two kinds of pairs are refitted. `better`: those that promise more than any set fitted so far, since
        # two effects may cancel in every score and be visible only together. `without`: the best ones that do
        # not contain the leading effect, which may lead only because it imitates such a pair.
        lin = self.null_tests.linearisation
        promised = self.null.chi2 - min(trial.chi2 for trial in (best, *self.trials.values()))
        pairs = [
            (pair.gain, [lin.candidates[k] for k in pair.candidates])
            for pair in pair_gains(self.null_tests.projected)
        ]
        better = [chosen for gain, chosen in pairs[:_PAIRS] if gain > promised + WORTH]
        members = set(best.effects)
        without = [
            chosen for gain, chosen in pairs if gain > WORTH and not {c.name for c in chosen} & members
        ]
        both = better + [one for one in without[: _PAIRS if members else 0] if one not in better]
        for chosen in counted(both, "Refitting with pairs of effects", self.on_progress):
            self.refitted(chosen, self.null)
        if best.candidates:
            self._forward(best)
        return self.least([best, *self.trials.values()])

    def _pair_instead(self, best: RefittedSet) -> RefittedSet:
        """Two other effects that are a significantly better explanation, though the single one leaves little.

        An effect that imitates two may leave less than any test detects, and yet more than one parameter
        costs: for 200 readings for example 36 in χ², of which no third effect absorbs much.
        """
        if len(best.candidates) != 1 or self.most < 2 or not self.sure(best) or self.below_noise(best):
            return best
        # A pair is refitted only if the linear problem promises more than the single effect achieves, plus
        # the penalty for one effect more. `pair_gains` fall, so that the first pair that does not ends the
        # search.
        candidates, scores = self.null_tests.linearisation.candidates, self.null_tests.screening.scores
        linear = max((score.gain for score in scores if score.effect in best.effects), default=0.0)
        reached = max(self.null.chi2 - best.chi2, linear)
        tried = [best]
        for pair in pair_gains(self.null_tests.projected):
            chosen = [candidates[index] for index in pair.candidates]
            if pair.gain < reached + min(self.price(one) for one in chosen) or len(tried) > _PAIRS:
                break
            if best.effects[0] in {one.name for one in chosen}:
                continue
            self.on_progress("Refitting with other pairs of effects")
            instead = self.refitted(chosen, self.null)
            tried += [] if instead is None else [instead]
        instead = self.least(tried)
        # "Significantly" is by the evidence, in which the discrepancy of each law is integrated out: a pair
        # that only describes the shape of the single effect's law does not replace it.
        surely = LEAST_DIFFERENCE * softened(self.null.chi2 - best.chi2)
        return instead if self.evidence(instead) < self.evidence(best) - surely else best

    def _exchanged(self, best: RefittedSet) -> RefittedSet:
        """`best`, or a better set with one member of an incomplete pair replaced by the next candidate of
        its linearisation."""
        for _ in range(_SWAPS):
            if len(best.candidates) < 2 or self.left(best) < TOLERANCE**2 or self.below_noise(best):
                break
            exchanged = self.least([best, *self._exchanges(best)])
            if exchanged is best:
                break
            best = self._swapped(self._backward(exchanged))
        return best

    def _exchanges(self, best: RefittedSet) -> list[RefittedSet]:
        # Within the shape tolerance of the laws found so far: without it the next candidates would be those
        # that correct the shape of a law, and not those that describe another cause.
        view = self.with_discrepancies(best)
        exchanges = [
            (*(one for one in best.candidates if one is not member), candidate)
            for candidate in self._next_candidates(view)
            for member in best.candidates
        ]
        sets = [
            self.refitted(chosen, best)
            for chosen in counted(exchanges, "Refitting with one effect for another", self.on_progress)
        ]
        return [trial for trial in sets if trial is not None]

    def _forward(self, best: RefittedSet) -> None:
        """Refit `best` with each of the effects for which its own linearisation predicts the largest gain."""
        view = self.with_discrepancies(best)
        for candidate in counted(
            self._next_candidates(view), "Refitting with one more effect", self.on_progress
        ):
            self.refitted((*best.candidates, candidate), best)

    @staticmethod
    def _next_candidates(view: View) -> list[Candidate]:
        """The candidates for which the linearisation of a set predicts the largest gain."""
        scores = sorted(view.screening.scores, key=lambda one: -one.gain)[:_PAIRS]
        return [view.linearisation.candidates[one.candidate] for one in scores if one.gain > WORTH]

    def _backward(self, best: RefittedSet) -> RefittedSet:
        """`best` without members that do not lower mBIC, or explain no more than another law's shape may."""
        while len(best.candidates) > 1:
            tried = [
                self.refitted_also_from(tuple(one for one in best.candidates if one is not member), best)
                for member in best.candidates
            ]
            shorter = [one for one in tried if one is not None]
            # mBIC first: does a set with a member less cost less? If not, a member goes only if it may be the
            # shape of the other one's law (`slight`).
            least = self.least([best, *shorter])
            if least is best:
                reached = self.null.chi2 - best.chi2
                slight = [one for one in shorter if self.slight(best, one, reached)]
                if not slight:
                    break
                least = min(slight, key=lambda one: one.chi2)
            best = least
        return best

    def _usual_first(self, best: RefittedSet) -> RefittedSet:
        """A set with a parameter outside its usual range leads only if no set without one suffices.

        Which of the two is right is left open by the verdict: the one put aside is a rival.
        """
        if not best.unusual:
            return best
        usual = [
            trial
            for trial in self.trials.values()
            if len(trial.effects) <= len(best.effects) and not trial.unusual
        ]
        for trial in sorted(usual, key=self.mbic):
            if self.mbic(trial) >= self.mbic(self.null):
                break
            if self.left(trial) <= self.allowed:
                self.unusual_best = best
                return trial
        return best

    def _beyond_laws(self, best: RefittedSet) -> RefittedSet:
        """The empty set if the model's own laws explain much of `best` within their shape tolerance."""
        if len(best.candidates) == 1 and self.has_discrepancies and self.slight(best, self.null):
            return self.null
        return best

    def _simplest(self, best: RefittedSet) -> RefittedSet:
        """The set with the fewest parameters among those that differ by less than the shape tolerance."""
        for member in best.candidates:
            # A tenth of the member's size is a hundredth of the χ² that it explains.
            limit = TOLERANCE**2 * self.explained(best, member)
            alike = [
                rival
                for rival, _, _ in self.rivals(best, member)
                if rival.parameters < best.parameters and rival.chi2 - best.chi2 < limit
            ]
            if alike:
                return min(alike, key=lambda one: (one.parameters, one.chi2))
        return best

    def _swapped(self, best: RefittedSet) -> RefittedSet:
        """`best` with members replaced by rivals that explain more: the first found need not be right."""
        for _ in range(_SWAPS):
            sets = [rival for member in best.candidates for rival, _, _ in self.rivals(best, member)]
            least = self._complete_before_least([best, *sets])
            if least is best:
                break
            best = self._backward(least)
        return best

    def _complete_before_least(self, sets: Sequence[RefittedSet]) -> RefittedSet:
        """The set with the least mBIC; of two or more effects rather one that leaves nothing.

        Beside the discrepancy of a strong effect's law, a difference in mBIC between two second effects is
        within that discrepancy: the evidence decides, if only one of them leaves nothing.
        """
        least = self.least(sets)
        count = len(least.candidates)
        if count < 2 or not self.tolerance or not self.excess(least):
            return least
        # Only among sets that are better than every smaller one: of the others, the smaller one is to be
        # preferred.
        shorter = [one for one in (self.null, *self.trials.values()) if len(one.candidates) < count]
        limit, evidence = self.mbic(self.least(shorter)), self.evidence(least)
        others = [one for one in sets if len(one.candidates) == count and self.mbic(one) < limit]
        better = [one for one in others if self.evidence(one) < evidence and not self.excess(one)]
        return min(better, key=self.evidence, default=least)
