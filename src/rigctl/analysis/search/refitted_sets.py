"""The sets of effects fitted to one comparison: what each explains, costs and leaves, and its rivals.

Two questions are kept apart. Completeness is judged against the noise: whether the tests reject what is left,
however small its share. Identity is judged by the share of the misfit that a set leaves within the shape
tolerance of its laws (`rigctl.analysis.linear.shape_tolerance`), because no effect of a library has a bench's
exact law: a set that leaves more than a small share (`SHAPE`) may be incomplete, or only resemble what is
missing. A second effect that is small beside the first (`SLIGHT`) may be an artefact of the first one's law,
unless it explains what that law leaves nearly to the noise (`WHOLE`); and so may any effect of which hardly
anything is beyond the tolerance of the others (`BEYOND_LAWS`).

Every question about a refitted set is answered from its linearisation (`LinearisedSet`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from rigctl.analysis.agreement.parameter_bounds import value_of
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
)
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.mbic import effective_samples, mbic
from rigctl.analysis.linear.separability import cosine, separation
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search.linearised_set import LinearisedSet, View
from rigctl.analysis.search.refit import RefittedSet, at_limiting_case, plain, refit
from rigctl.analysis.search.refit_alone import Alone, near_best
from rigctl.effects.declaration import Effect
from rigctl.model.fit.problem import Problem

#: upper limit on the number of rivals that are refitted
MOST_RIVALS = 7


@dataclass
class RefittedSets:
    """The sets that were fitted to one comparison.

    Attributes
    ----------
    before: the model as given.
    whole: its data with the equations of the whole library, every effect at its null.
    trials: the sets, each by its members and their shapes.
    alone: for a table, every effect fitted by itself.
    """

    before: ModelComparison
    whole: Problem
    trials: dict[tuple[str, ...], RefittedSet] = field(default_factory=dict, kw_only=True)
    alone: dict[str, Alone | None] = field(default_factory=dict, kw_only=True)
    _points: dict[tuple[str, ...], LinearisedSet] = field(default_factory=dict, kw_only=True)
    _discrepancy_evidence: dict[tuple[str, ...], float] = field(default_factory=dict, kw_only=True)
    _tried_starts: set[tuple[tuple[str, ...], float]] = field(default_factory=set, kw_only=True)
    _rivals: dict[tuple[tuple[str, ...], str], list[tuple[RefittedSet, float, float]]] = field(
        default_factory=dict, kw_only=True
    )

    @cached_property
    def null(self) -> RefittedSet:
        """The null hypothesis: the model as given, with no effect added."""
        return plain(self.before.fit)

    @cached_property
    def tolerance(self) -> float:
        """Standard deviation of the laws' discrepancy; 0 for a table, whose few rows any discrepancy could
        follow."""
        return 0.0 if self.of_few_rows else SHAPE_TOLERANCE

    @cached_property
    def null_tests(self) -> ModelComparison | View:
        """The model as given, within the shape tolerance of the effects that it already has."""
        if not (self.tolerance and self.before.fit.problem.model.with_laws):
            return self.before
        return self.at(self.null).view(self.tolerance)

    @property
    def has_discrepancies(self) -> bool:
        """Whether the model already has effects, whose laws have a shape tolerance."""
        return self.null_tests is not self.before

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

    def left(self, trial: RefittedSet) -> float:
        """The share of the squared misfit that a set leaves; 0 where `excess` is."""
        if not trial.candidates:
            return 0.0 if self.null_tests.adequacy.agrees else 1.0
        excess = self.excess(trial)
        return excess / (max(self.reached(trial), 1e-12) + excess) if excess else 0.0

    def reached(self, trial: RefittedSet) -> float:
        """The reduction of χ² by a set; for a single effect also that by the scatter of its size.

        Fitted parameters may absorb the mean of a delay that differs from switch to switch, but not its
        differences. The scatter counts if it is plausible (`SizeScatter.counts`).
        """
        size_scatter = self._size_scatter(trial)
        explained = 0.0 if size_scatter is None else size_scatter.explained
        return max(self.null.chi2 - trial.chi2, 0.0) + explained

    def excess(self, trial: RefittedSet) -> float:
        """χ² that a set leaves, within the shape tolerance of its laws.

        0 if the tests find nothing any more, or what they find is less than any further effect would cost. It
        is the largest of the excesses of the plane and χ² tests over their spread, and of the reductions of
        χ² predicted for any further effect, less its penalty in mBIC.
        """
        if self.at(trial).adequacy.agrees:
            return 0.0
        return self._excess_in(self.with_discrepancies(trial))

    def _excess_in(self, view: View) -> float:
        """χ² that a view of a set leaves, see `excess`."""
        if view.adequacy.agrees:
            return 0.0
        # Three tests see different misfits: a score sees what an effect of the library would remove, the
        # plane what changes with the operating point, χ² everything else if there is much of it. None bounds
        # the others.
        candidates = view.linearisation.candidates
        promised = max(
            (score.gain - self.price(candidates[score.candidate]) for score in view.screening.scores),
            default=0.0,
        )
        return max(promised, *(test.excess for test in view.adequacy.tests.values()))

    def scatter_is_all(self, trial: RefittedSet) -> bool:
        """Whether a constant of each record describes the one effect of a set, whatever its size depends on.

        True if its size scatters between records as much as the data require, without following any operating
        variable, and the set then leaves less than a tenth of the size of the effect with its scatter: delays
        that differ by a third explain more by their differences than by their mean.
        """
        size_scatter = self._size_scatter(trial)
        if size_scatter is None:
            return False
        return self._excess_in(self.at(trial).view(size_scatter.width)) < TOLERANCE**2 * self.reached(trial)

    def _size_scatter(self, trial: RefittedSet) -> SizeScatter | None:
        """The scatter of the size of a set's one effect between records or switches, if it counts as
        explained.

        None for several effects, for one with explanatory variables, for a table, and for a model that
        already has effects: their laws have a tolerance of their own.
        """
        if len(trial.candidates) != 1 or not self.tolerance or self.has_discrepancies:
            return None
        (member,) = trial.candidates
        point = self.at(trial)
        size_scatter = point.scatter(member.name)
        if size_scatter is None or not size_scatter.counts:
            return None
        alone = all(name.startswith(f"size of {member.name} ") for name in point.shaped().shapes)
        return size_scatter if alone else None

    def explained(self, trial: RefittedSet, member: Candidate) -> float:
        """The increase of χ² without one of a set's effects; 0 if the others cannot be fitted."""
        rest = tuple(one for one in trial.candidates if one is not member)
        without = self.refitted(rest, trial) if rest else self.null
        return 0.0 if without is None else max(without.chi2 - trial.chi2, 0.0)

    def slight(self, best: RefittedSet, without: RefittedSet, reached: float = 0.0) -> bool:
        """Whether the effect that `without` lacks may be no more than the shape of the others' laws.

        So it is if it explains little beside them, and either their laws explain much of the same within
        their shape tolerance, or it leaves something: a second effect follows the shape of another one's law
        only roughly, and the rest remains visible. Nor is it kept, however much it explains, if hardly
        anything of that is beyond the shape tolerance of the effects already in the model, or of the others
        where these leave little without it.

        Parameters
        ----------
        reached: the reduction of χ² by all effects of `best`.
        """
        explained = without.chi2 - best.chi2
        little = explained < SLIGHT * reached
        if not (little or self.has_discrepancies or (self.tolerance and self.sure(without))):
            return False
        if self.tolerance:
            # What the member explains beyond the discrepancy of the others' laws: the difference of the
            # evidences, in which these are integrated out on both sides.
            beyond = self.evidence(without) - self.evidence(best)
            share = BEYOND_SHAPE if little else BEYOND_LAWS
            if beyond < max(LEAST_DIFFERENCE, share * explained):
                return True
            explained = beyond
        # The member is small. It stays only if hardly anything is left with it, since what merely follows the
        # shape of another law leaves a rest; `UNSEEN` is what the tests cannot see of that rest.
        return little and self.excess(best) + UNSEEN >= WHOLE * explained

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

    def below_noise(self, trial: RefittedSet) -> bool:
        """Whether to stop the search at this set, because its error is smaller than the noise.

        The tests of what it leaves are then inconclusive: they show neither that something is missing
        nor that nothing is.
        """
        return bool(trial.candidates) and self.at(trial).adequacy.below_noise

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

    def with_discrepancies(self, trial: RefittedSet) -> View:
        """The linearisation and the tests within the shape tolerance of the laws of all effects."""
        return self.at(trial).view(self.tolerance)

    def evidence(self, trial: RefittedSet) -> float:
        """mBIC with the discrepancies of a trial's laws integrated out: their reduction of χ², less their
        cost.

        Adds ``−gᵀ(I + A)⁻¹g + ln|I + A|``, with S the columns of the discrepancies scaled by the tolerance,
        the fitted unknowns projected off, ``A = S̃ᵀS̃`` and ``g = S̃ᵀr̃``.
        """
        key = _key(trial.candidates)
        if key not in self._discrepancy_evidence:
            self._discrepancy_evidence[key] = (
                self.at(trial).discrepancy_evidence(self.tolerance) if self.tolerance else 0.0
            )
        return self.mbic(trial) + self._discrepancy_evidence[key]

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
        without = self.null if not rest else self.refitted(rest, trial)
        if without is None:
            return []
        size = max(without.chi2 - trial.chi2, 0.0) ** 0.5
        # The fit of the whole set, with the member taken out of the nuisances again and put first among the
        # candidates: cosines are between what it and others would add to the *other* members, which are
        # projected off.
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
            # A rival is worth a refit if the signatures are alike or the separation is small, unless it is so
            # large that an error of the linearisation (`FAR_SHARE` of the size) could not hide it.
            near = [one for one in near if one[1].name in kept]
        for cos, candidate, d in near[: None if self.of_few_rows else MOST_RIVALS]:
            rival = self.refitted((*rest, candidate), without)
            if rival is not None and not (self.of_few_rows and self._far(rival, trial)):
                rivals.append((rival, cos, d))
        return rivals

    @property
    def of_few_rows(self) -> bool:
        """True for a table: its few rows are quickly refitted, and refits alone distinguish many effects."""
        return self.before.fit.problem.measurements.table

    def _far(self, rival: RefittedSet, best: RefittedSet) -> bool:
        """For a table, to which both were fitted: the best set is a hundred times as probable as the
        rival."""
        return self.mbic(rival) - self.mbic(best) >= LEAST_DIFFERENCE

    def refitted(self, chosen: Sequence[Candidate], begin: RefittedSet) -> RefittedSet | None:
        """The set fitted, starting from the fit of another set; each set only once."""
        key = _key(chosen)
        if key not in self.trials:
            # A law that contains another as a limit starts there, at the fit of the simpler one: it can then
            # not end with a larger misfit than that one, and any gain is due to its additional parameter.
            start, at = self._limiting_case(chosen, begin) or (begin, None)
            # A fit minimises half of χ², its cost.
            known = [0.5 * trial.chi2 for trial in self.trials.values()]
            rival = min(known, default=math.inf)
            # at ten times its usual size nearly every effect explains the few values of a table
            refitted = refit(self.before.fit, chosen, start.fit, at=at, rival=rival, usual=self.of_few_rows)
            if refitted is None:
                return None
            self.trials[key] = refitted
        return self.trials[key]

    def refitted_also_from(self, chosen: Sequence[Candidate], begin: RefittedSet) -> RefittedSet | None:
        """The set fitted, also from here if it was fitted from elsewhere: the deepest of its minima counts.

        A second effect may only have led a fit out of a local minimum of the first one alone.
        """
        key, known = _key(chosen), self.trials.get(_key(chosen))
        if known is None or self.of_few_rows:
            return self.refitted(chosen, begin)
        if (key, begin.chi2) not in self._tried_starts:
            self._tried_starts.add((key, begin.chi2))
            again = refit(self.before.fit, chosen, begin.fit, rival=0.5 * known.chi2)
            if again is not None and again.chi2 < known.chi2 - UNSEEN:
                self.trials[key] = again
                self._points.pop(key, None)
                self._discrepancy_evidence.pop(key, None)
                self._rivals.clear()  # it may be a rival of others, or what they are compared with
        return self.trials[key]

    def _limiting_case(
        self, chosen: Sequence[Candidate], begin: RefittedSet
    ) -> tuple[RefittedSet, dict[str, float]] | None:
        """The set with a limiting case in place of one member, fitted, and the parameters of that member
        there; None if there is no such effect.

        A fit that starts there does not end with the larger misfit of the two.
        """
        for member in () if self.of_few_rows else chosen:
            rest = [one for one in chosen if one is not member]
            for simpler in self.before.linearisation.candidates if member.effect.becomes else ():
                sources = at_limiting_case(member, simpler)
                limiting = None if sources is None else self.refitted((*rest, simpler), begin)
                if sources is not None and limiting is not None:
                    return limiting, {
                        column: value_of(limiting.fit, source) if isinstance(source, str) else source
                        for column, source in sources.items()
                    }
        return None

    def least(self, trials: Iterable[RefittedSet]) -> RefittedSet:
        """The one of several sets with the least mBIC."""
        return min(self.describing(trials), key=self.mbic)

    def describing(self, trials: Iterable[RefittedSet]) -> list[RefittedSet]:
        """The sets that may be the answer: for a program, those of which the data determine every size.

        What is missing is mostly inside it, and a threshold at its edge, which the data do not determine,
        imitates some of anything.
        """
        every = list(trials)
        if self.before.fit.problem.model.family.program is None:
            return every
        return [one for one in every if not one.undetermined] or every


def _key(chosen: Sequence[Candidate]) -> tuple[str, ...]:
    return tuple(sorted(f"{one.name} {sorted(one.shapes.items())}" for one in chosen))
