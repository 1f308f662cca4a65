"""Search for the set of effects that explains a misfit: singles, pairs, forward and backward steps.

Two questions are kept apart. Completeness is judged against the noise: the search continues as long as the
tests reject what is left, however small its share. Identity is judged by the share of the misfit that an
effect leaves within the shape tolerance of its law (`rigctl.analysis.laws.shape_tolerance`), because no
effect of a library has a bench's exact law: a set that leaves more than a small share (`SHAPE`) may be
incomplete, or only resemble what is missing, and is not named. A second effect that is small beside the first
(`SLIGHT`) may be an artefact of the first one's law, unless it explains what that law leaves nearly to the
noise (`WHOLE`).

Every question about a refitted set is answered from its linearisation (`LinearisedSet`). All pairs of effects
are tried on the linearised problem, as two effects may improve the criterion only together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.candidates import Candidate, at_sizes
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import (
    ALIKE,
    BEYOND_LAWS,
    BEYOND_SHAPE,
    FAR,
    FAR_SHARE,
    LEAST_DIFFERENCE,
    LEAST_SEPARATION,
    SHAPE,
    SHAPE_OF_ROWS,
    SHAPE_TOLERANCE,
    SLIGHT,
    TOLERANCE,
    UNSEEN,
    WHOLE,
    WORTH,
)
from rigctl.analysis.fitting import OnProgress, no_progress
from rigctl.analysis.linearisation import linearise
from rigctl.analysis.linearised_set import LinearisedSet, View
from rigctl.analysis.mbic import effective_samples, mbic
from rigctl.analysis.nuisance_projection import project
from rigctl.analysis.pair_gains import pair_gains
from rigctl.analysis.refit import RefittedSet, at_limiting_case, plain, refit, value_of
from rigctl.analysis.refit_alone import Alone, alone, near_best
from rigctl.analysis.score_test import Score, screen
from rigctl.analysis.separability import cosine, separation, softened
from rigctl.effects.declaration import Effect
from rigctl.errors import RigctlError
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]


_BEST = 3
#: upper limit on the number of rivals that are refitted
_MOST_RIVALS = 7
_PAIRS = 2
_SWAPS = 3
#: number of sizes at which an effect is tried if its slope at the null says nothing
_SIZES = 2
#: largest number of effects in one set: three wrong effects together explain almost anything, and three right
#: ones are found one after the other by the loop
_TOGETHER = 2


@dataclass
class Search:
    """The sets that were tried on one comparison, and the best of them.

    Attributes
    ----------
    before: the model as given.
    whole: its data with the equations of the whole library, every effect at its null.
    most: largest number of effects in a set.
    alone: for a table, every effect fitted by itself.
    aside: a set better than the best one, put aside because a parameter is outside its usual range.
    """

    before: ModelComparison
    whole: Problem
    most: int = _TOGETHER
    on_progress: OnProgress = no_progress
    trials: dict[tuple[str, ...], RefittedSet] = field(default_factory=dict)
    alone: dict[str, Alone | None] = field(default_factory=dict)
    aside: RefittedSet | None = None
    _points: dict[tuple[str, ...], LinearisedSet] = field(default_factory=dict)
    _bends: dict[tuple[str, ...], float] = field(default_factory=dict)
    _begun: set[tuple[tuple[str, ...], float]] = field(default_factory=set)
    _rivals: dict[tuple[tuple[str, ...], str], list[tuple[RefittedSet, float, float]]] = field(
        default_factory=dict
    )

    @cached_property
    def none(self) -> RefittedSet:
        """The model as given."""
        return plain(self.before.fit)

    @cached_property
    def tolerance(self) -> float:
        """Standard deviation of the laws' discrepancy; 0 for a table, whose few rows any discrepancy could
        follow."""
        return 0.0 if self._few else SHAPE_TOLERANCE

    @cached_property
    def start(self) -> ModelComparison | View:
        """The model as given, within the shape tolerance of the effects that it already has."""
        if not (self.tolerance and self.before.fit.problem.model.with_laws):
            return self.before
        return self.at(self.none).view(self.tolerance)

    @property
    def bends_model(self) -> bool:
        """Whether the model already has effects, whose laws have a shape tolerance."""
        return self.start is not self.before

    @cached_property
    def library(self) -> int:
        """Number of effects that were considered."""
        return len({candidate.name for candidate in self.before.linearisation.candidates})

    def effect(self, name: str) -> Effect:
        """An effect of the library, or one declared by the model itself."""
        return self.before.fit.problem.model.effect(name)

    @cached_property
    def samples(self) -> float:
        """The effective sample size of the data."""
        return effective_samples(self.before.fit)

    def price(self, candidate: Candidate) -> float:
        """The penalty of mBIC for one more effect."""
        return mbic(0.0, len(candidate.columns), 1, self.samples, self.library)

    def mbic(self, trial: RefittedSet) -> float:
        """mBIC of a trial."""
        return trial.mbic(self.samples, self.library)

    def best(self) -> RefittedSet:
        """The set that explains the misfit best: singles, pairs, backward steps, and replacements."""
        best = self._swapped(self._at_sizes(self.best_single()))
        best_set = self._simplest(self._exchanged(self._swapped(self._backward(self._pairs(best)))))
        return self._beyond_laws(self._usual_first(self._pair_instead(best_set)))

    def best_single(self) -> RefittedSet:
        """The single effect that explains the misfit best, or none."""
        if not self.start.screening.scores:
            return self.none
        self._singles()
        return self._least([self.none, *self.trials.values()])

    def left(self, trial: RefittedSet) -> float:
        """The share of the squared misfit that a set leaves; 0 if the tests find nothing any more."""
        if not trial.candidates:
            return 0.0 if self.start.adequacy.agrees else 1.0
        excess = self.excess(trial)
        return excess / (max(self.none.chi2 - trial.chi2, 1e-12) + excess)

    def excess(self, trial: RefittedSet) -> float:
        """χ² that a set leaves, within the shape tolerance of its laws; 0 if the tests find nothing any more.

        It is the largest of the excesses of the plane and χ² tests over their spread, and of the reductions
        of χ² predicted for any further effect, less its penalty in mBIC.
        """
        if self.at(trial).adequacy.agrees:
            return 0.0
        return self._excess_in(self.bent(trial))

    def _excess_in(self, view: View) -> float:
        """χ² that a view of a set leaves; 0 if the tests find nothing any more."""
        if view.adequacy.agrees:
            return 0.0
        there = view.linearisation.candidates
        promised = max(
            (score.gain - self.price(there[score.candidate]) for score in view.screening.scores),
            default=0.0,
        )
        return max(promised, *(test.excess for test in view.adequacy.tests.values()))

    def scatter_is_all(self, trial: RefittedSet) -> bool:
        """Whether a constant of each record describes the one effect of a set, whatever its size depends on.

        True if its size scatters between records as much as the data require, without following any operating
        variable, and the set then leaves less than a tenth of the size of the effect with its scatter: delays
        that differ by a third explain more by their differences than by their mean.
        """
        (member,) = trial.candidates
        point = self.at(trial)
        found = point.scatter(member.name)
        alone = all(name.startswith(f"size of {member.name} ") for name in point.shaped().shapes)
        if found is None or not alone or found.follows or self.none.fit.problem.model.with_laws:
            return False
        exact, scattered = point.view(0.0).projected.residual, point.view(found.width).projected.residual
        scatter = float(exact @ exact) - float(scattered @ scattered)
        reached = max(self.none.chi2 - trial.chi2, 0.0) + max(scatter, 0.0)
        return self._excess_in(point.view(found.width)) < TOLERANCE**2 * reached

    def _below_noise(self, trial: RefittedSet) -> bool:
        """Whether to stop the search at this set, because its error is smaller than the noise.

        The tests then say nothing about what it leaves: neither that something is missing nor that
        nothing is.
        """
        return bool(trial.candidates) and self.at(trial).adequacy.below_noise

    def explained(self, trial: RefittedSet, member: Candidate) -> float:
        """The increase of χ² without one of a set's effects; 0 if the others cannot be fitted."""
        rest = tuple(one for one in trial.candidates if one is not member)
        without = self._try(rest, trial) if rest else self.none
        return 0.0 if without is None else max(without.chi2 - trial.chi2, 0.0)

    def known(self, chosen: Sequence[Candidate]) -> RefittedSet | None:
        """The set as it was fitted; None if it was not."""
        return self.trials.get(_key(chosen))

    def sure(self, trial: RefittedSet) -> bool:
        """Whether a set leaves so little that its effects count as the right ones."""
        return bool(trial.candidates) and self.left(trial) <= self.allowed

    @property
    def allowed(self) -> float:
        """The share of the misfit that the right set may leave."""
        return SHAPE if self.tolerance else SHAPE_OF_ROWS

    def beside(self, trial: RefittedSet) -> list[RefittedSet]:
        """The sets tried that hold one effect more and have a lower mBIC, best first."""
        members = set(trial.effects)
        more = [one for one in self.trials.values() if members < set(one.effects)]
        paying = [one for one in more if self.mbic(one) < self.mbic(trial)]
        return sorted((one for one in paying if len(one.effects) == len(members) + 1), key=self.mbic)

    def at(self, trial: RefittedSet) -> LinearisedSet:
        """The linearisation and the tests at a trial's fit."""
        key = _key(trial.candidates)
        if key not in self._points:
            known = None if trial.candidates else self.before.slopes
            self._points[key] = LinearisedSet(trial, self.whole, self.before.excluded, known)
        return self._points[key]

    def bent(self, trial: RefittedSet) -> View:
        """As `at`, within the shape tolerance of the laws of all effects in the model."""
        return self.at(trial).view(self.tolerance)

    def evidence(self, trial: RefittedSet) -> float:
        """mBIC with the discrepancies of a trial's laws integrated out: their reduction of χ², less their
        cost.

        Adds ``−gᵀ(I + A)⁻¹g + ln|I + A|``, with S the columns of the discrepancies scaled by the tolerance,
        the fitted unknowns projected off, ``A = S̃ᵀS̃`` and ``g = S̃ᵀr̃``.
        """
        key = _key(trial.candidates)
        if key not in self._bends:
            self._bends[key] = self.at(trial).bend_evidence(self.tolerance) if self.tolerance else 0.0
        return self.mbic(trial) + self._bends[key]

    def rivals(self, trial: RefittedSet, member: Candidate) -> list[tuple[RefittedSet, float, float]]:
        """(rival set, cosine, separation d) of the sets with another effect in place of `member`.

        Only effects with a large cosine or a small separation are refitted; the others are already
        distinguished.
        """
        key = (_key(trial.candidates), member.name)
        if key not in self._rivals:
            self._rivals[key] = self._find_rivals(trial, member)
        return self._rivals[key]

    def _find_rivals(self, trial: RefittedSet, member: Candidate) -> list[tuple[RefittedSet, float, float]]:
        rest = tuple(one for one in trial.candidates if one is not member)
        without = self.none if not rest else self._try(rest, trial)
        if without is None:
            return []
        size = max(without.chi2 - trial.chi2, 0.0) ** 0.5
        projected = self.at(trial).without(member)
        close: dict[str, tuple[float, Candidate, float]] = {}
        silent = set(self.before.screening.untestable)
        look = projected.linearisation
        for index, candidate in enumerate(look.candidates):
            if candidate.name == member.name or not projected.usable[look.columns_of(index)].any():
                continue
            if candidate.name in silent:  # invisible to these data in the model as given
                continue
            cos = cosine(projected, 0, index)
            d = separation(size, cos)
            held = close.get(candidate.name)
            if held is None or cos > held[0]:
                close[candidate.name] = (cos, candidate, d)
        near = [
            one
            for one in close.values()
            if (one[0] > ALIKE or one[2] < LEAST_SEPARATION) and one[2] < max(FAR, FAR_SHARE * size)
        ]
        near.sort(key=lambda one: -one[0])
        rivals = []
        if self.alone and not rest:  # effects that fit much worse by themselves need no refit
            kept = near_best(self.alone)
            near = [one for one in near if one[1].name in kept]
        for cos, candidate, d in near[: None if self._few else _MOST_RIVALS]:
            rival = self._try((*rest, candidate), without)
            if rival is not None and not (self._few and self._far(rival, trial)):
                rivals.append((rival, cos, d))
        return rivals

    @property
    def _few(self) -> bool:
        """True for a table: its few rows are quickly refitted, and refits alone distinguish many effects."""
        return self.before.fit.problem.measurements.table

    def _far(self, rival: RefittedSet, best: RefittedSet) -> bool:
        """For a table, to which both were fitted: the best set is a hundred times as probable as the
        rival."""
        return self.mbic(rival) - self.mbic(best) >= LEAST_DIFFERENCE

    def _singles(self) -> None:
        scores = self.start.screening.scores
        lin, projected = self.start.linearisation, self.start.projected
        by_gain = sorted(scores, key=lambda score: -score.gain)
        leader = by_gain[0]
        alike = [
            score
            for score in by_gain
            if score.gain > 0.0 and self._near(cosine(projected, leader.candidate, score.candidate), leader.z)
        ]
        chosen = list(dict.fromkeys(score.effect for score in [*by_gain[:_BEST], *alike]))
        if self._few:
            chosen = self._near_alone([score.effect for score in by_gain])
        by_name = {score.effect: score for score in scores}
        for effect in chosen[: None if self._few else _BEST + _MOST_RIVALS]:
            score = by_name[effect]
            if score.gain > 0.0 or self._few:
                self.on_progress(f"Refitting with {effect}")
                self._try((lin.candidates[score.candidate],), self.none)

    def promised(self, score: Score) -> float:
        """The reduction of χ² by an effect: as fitted by itself if it was, else by the linear problem."""
        fitted = self.alone.get(score.effect)
        return score.gain if fitted is None else max(self.none.chi2 - fitted.chi2, 0.0)

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
        for effect in effects:
            self.on_progress(f"Fitting with {effect} alone")
            candidate = self.before.linearisation.candidates[scores[effect].candidate]
            begun_at_null = scores[effect].gain > 0.0
            rival = min((one.chi2 for one in self.alone.values() if one is not None), default=math.inf)
            self.alone[effect] = alone(self.before, candidate, from_null=begun_at_null, rival=rival)
        return near_best(self.alone)

    @staticmethod
    def _near(cos: float, size: float) -> bool:
        """Whether two signatures are so similar that a refit must decide between them."""
        return cos > ALIKE and separation(size, cos) < max(FAR, FAR_SHARE * size)

    def _at_sizes(self, best: RefittedSet) -> RefittedSet:
        """With effects about which the slope at their null says nothing, if no other effect explains the
        misfit.

        After the fitted parameters have compensated for a large effect, the slope of the residual with
        respect to it may have the wrong sign: such effects are evaluated at a few finite sizes, like those
        with a threshold.
        """
        if self._few or not self.left(best) > self.allowed or self._below_noise(best):
            return best
        tried = {name for trial in self.trials.values() for name in trial.effects}
        shown = {score.effect: score.gain for score in self.before.screening.scores}
        silent = [
            one
            for one in self.before.linearisation.candidates
            if one.name not in tried and shown.get(one.name, math.inf) < WORTH and not one.secants
        ]
        sized = [secant for one in silent for secant in at_sizes(one, _SIZES)]
        if not sized:
            return best
        self.on_progress("Trying effects at finite sizes")
        try:
            scores = screen(project(linearise(self.before.fit, self.whole, sized))).scores
        except RigctlError:  # the model cannot be simulated with one of them
            return best
        # of an effect as large as what is missing the linear problem says little: it only orders them
        seen = sorted((score for score in scores if score.gain > WORTH), key=lambda one: -one.gain)
        for name in [score.effect for score in seen][:_PAIRS]:
            self.on_progress(f"Refitting with {name}")
            for one in (one for one in sized if one.name == name):
                self._deeper((one,), self.none)
        return self._least([best, *self.trials.values()])

    def _pairs(self, best: RefittedSet) -> RefittedSet:
        """The best pairs of the linear problem, with the best single effect's next candidates and without it.

        Beside an effect that leaves hardly anything, only the next candidates; no pairs if nothing is left.
        """
        left = self.left(best)
        if self.most < 2 or not left or self._below_noise(best):
            return best
        if best.candidates and left <= self.allowed:
            self._forward(best)
            return self._least([best, *self.trials.values()])
        lin = self.start.linearisation
        promised = self.none.chi2 - min(trial.chi2 for trial in (best, *self.trials.values()))
        pairs = [
            (pair.gain, [lin.candidates[k] for k in pair.candidates])
            for pair in pair_gains(self.start.projected)
        ]
        better = [chosen for gain, chosen in pairs[:_PAIRS] if gain > promised + WORTH]
        members = set(best.effects)
        without = [
            chosen for gain, chosen in pairs if gain > WORTH and not {c.name for c in chosen} & members
        ]
        for chosen in better + [one for one in without[: _PAIRS if members else 0] if one not in better]:
            self.on_progress(f"Refitting with {chosen[0].name} and {chosen[1].name}")
            self._try(chosen, self.none)
        if best.candidates:
            self._forward(best)
        return self._least([best, *self.trials.values()])

    def _pair_instead(self, best: RefittedSet) -> RefittedSet:
        """Two other effects that are a significantly better explanation, though the single one leaves little.

        An effect that imitates two may leave less than any test detects, and yet more than one parameter
        costs: for 200 readings for example 36 in χ², of which no third effect absorbs much.
        """
        if len(best.candidates) != 1 or self.most < 2 or not self.sure(best) or self._below_noise(best):
            return best
        candidates, scores = self.start.linearisation.candidates, self.start.screening.scores
        linear = max((score.gain for score in scores if score.effect in best.effects), default=0.0)
        reached = max(self.none.chi2 - best.chi2, linear)
        tried = [best]
        for pair in pair_gains(self.start.projected):
            chosen = [candidates[index] for index in pair.candidates]
            if pair.gain < reached + min(self.price(one) for one in chosen) or len(tried) > _PAIRS:
                break
            if best.effects[0] in {one.name for one in chosen}:
                continue
            self.on_progress(f"Refitting with {chosen[0].name} and {chosen[1].name}")
            instead = self._try(chosen, self.none)
            tried += [] if instead is None else [instead]
        instead = self._least(tried)
        surely = LEAST_DIFFERENCE * softened(self.none.chi2 - best.chi2)
        return instead if self.evidence(instead) < self.evidence(best) - surely else best

    def _exchanged(self, best: RefittedSet) -> RefittedSet:
        """With a member of a pair that leaves something replaced by the next candidate of its
        linearisation."""
        for _ in range(_SWAPS):
            if len(best.candidates) < 2 or self.left(best) < TOLERANCE**2 or self._below_noise(best):
                break
            exchanged = self._least([best, *self._exchanges(best)])
            if exchanged is best:
                break
            best = self._swapped(self._backward(exchanged))
        return best

    def _exchanges(self, best: RefittedSet) -> list[RefittedSet]:
        here = self.bent(best)
        sets = []
        for score in sorted(here.screening.scores, key=lambda one: -one.gain)[:_PAIRS]:
            candidate = here.linearisation.candidates[score.candidate]
            for member in best.candidates if score.gain > WORTH else ():
                self.on_progress(f"Refitting with {candidate.name} for {member.name}")
                rest = tuple(one for one in best.candidates if one is not member)
                sets.append(self._try((*rest, candidate), best))
        return [trial for trial in sets if trial is not None]

    def _forward(self, best: RefittedSet) -> RefittedSet | None:
        """`best` with one more effect: those for which its own linearisation predicts the largest gain."""
        here = self.bent(best)
        tried = []
        for score in sorted(here.screening.scores, key=lambda one: -one.gain)[:_PAIRS]:
            if score.gain > WORTH:
                candidate = here.linearisation.candidates[score.candidate]
                self.on_progress(f"Refitting with {', '.join([*best.effects, candidate.name])}")
                tried.append(self._try((*best.candidates, candidate), best))
        return self._least([one for one in tried if one is not None]) if any(tried) else None

    def _backward(self, best: RefittedSet) -> RefittedSet:
        """Without the members that do not lower mBIC, or explain no more than another law's shape may."""
        while len(best.candidates) > 1:
            tried = [
                self._deeper(tuple(one for one in best.candidates if one is not member), best)
                for member in best.candidates
            ]
            shorter = [one for one in tried if one is not None]
            least = self._least([best, *shorter])
            if least is best:
                reached = self.none.chi2 - best.chi2
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
            if self.mbic(trial) >= self.mbic(self.none):
                break
            if self.left(trial) <= self.allowed:
                self.aside = best
                return trial
        return best

    def _beyond_laws(self, best: RefittedSet) -> RefittedSet:
        """No further effect, if the model's own laws explain much of it within their shape tolerance."""
        if len(best.candidates) == 1 and self.bends_model and self.slight(best, self.none):
            return self.none
        return best

    def slight(self, best: RefittedSet, without: RefittedSet, reached: float = 0.0) -> bool:
        """Whether the effect that `without` lacks may be no more than the shape of the others' laws.

        So it is if it explains little beside them, and either their laws explain much of the same within
        their shape tolerance, or it leaves something: a second effect follows the shape of another one's law
        only roughly, and the rest remains visible. How much the effects already in the model explain is not
        known: beside them the shape tolerance is always considered.

        Parameters
        ----------
        reached: the reduction of χ² by all effects of `best`.
        """
        explained = without.chi2 - best.chi2
        little = explained < SLIGHT * reached
        if not (little or self.bends_model):
            return False
        if self.tolerance:
            beyond = self.evidence(without) - self.evidence(best)
            share = BEYOND_SHAPE if little else BEYOND_LAWS
            if beyond < max(LEAST_DIFFERENCE, share * explained):
                return True
            explained = beyond
        return little and self.excess(best) + UNSEEN >= WHOLE * explained

    def _simplest(self, best: RefittedSet) -> RefittedSet:
        """Of sets that differ by less than shapes may, the one with the fewest parameters."""
        for member in best.candidates:
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
        """With a member replaced by a rival that explains more: the effect found first need not be right."""
        for _ in range(_SWAPS):
            sets = [rival for member in best.candidates for rival, _, _ in self.rivals(best, member)]
            least = self._least([best, *sets])
            if least is best:
                break
            best = self._backward(least)
        return best

    def _try(self, chosen: Sequence[Candidate], begin: RefittedSet) -> RefittedSet | None:
        """The set fitted, starting from the fit of another set; each set only once."""
        key = _key(chosen)
        if key not in self.trials:
            begun, at = self._limiting_case(chosen, begin) or (begin, None)
            known = [0.5 * trial.chi2 for trial in self.trials.values()]
            rival = min(known, default=math.inf)
            # at ten times its usual size nearly every effect explains the few values of a table
            refitted = refit(self.before.fit, chosen, begun.fit, at=at, rival=rival, usual=self._few)
            if refitted is None:
                return None
            self.trials[key] = refitted
        return self.trials[key]

    def _deeper(self, chosen: Sequence[Candidate], begin: RefittedSet) -> RefittedSet | None:
        """The set fitted, also from here if it was fitted from elsewhere: the deepest of its minima counts.

        A second effect may only have led a fit out of a local minimum of the first one alone.
        """
        key, known = _key(chosen), self.trials.get(_key(chosen))
        if known is None or self._few:
            return self._try(chosen, begin)
        if (key, begin.chi2) not in self._begun:
            self._begun.add((key, begin.chi2))
            again = refit(self.before.fit, chosen, begin.fit, rival=0.5 * known.chi2)
            if again is not None and again.chi2 < known.chi2 - UNSEEN:
                self.trials[key] = again
                self._points.pop(key, None)
                self._bends.pop(key, None)
                self._rivals = {at: found for at, found in self._rivals.items() if at[0] != key}
        return self.trials[key]

    def _limiting_case(
        self, chosen: Sequence[Candidate], begin: RefittedSet
    ) -> tuple[RefittedSet, dict[str, float]] | None:
        """The set with a limiting case in place of one member, fitted, and the parameters of that member
        there; None if there is no such effect.

        A fit that starts there does not end with the larger misfit of the two.
        """
        for member in () if self._few else chosen:
            rest = [one for one in chosen if one is not member]
            for simpler in self.before.linearisation.candidates if member.effect.becomes else ():
                sources = at_limiting_case(member, simpler)
                limiting = None if sources is None else self._try((*rest, simpler), begin)
                if sources is not None and limiting is not None:
                    return limiting, {
                        column: value_of(limiting.fit, source) if isinstance(source, str) else source
                        for column, source in sources.items()
                    }
        return None

    def _least(self, trials: Iterable[RefittedSet]) -> RefittedSet:
        return min(trials, key=self.mbic)


def _key(chosen: Sequence[Candidate]) -> tuple[str, ...]:
    return tuple(sorted(f"{one.name} {sorted(one.shapes.items())}" for one in chosen))
