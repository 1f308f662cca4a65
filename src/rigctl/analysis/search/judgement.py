"""The verdict on what a search found: which effects are missing, how certain that is, what is against it.

In: a search with its best set. Out: a `Judgement`, whose verdict follows from three questions that are kept
apart: does the set leave little enough to be the cause (`sure`), could another set be it (rivals), and does
it predict what it was not fitted to (cross-validation, blocks). The search has only minimised a criterion,
which has a minimum whether or not anything is missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from rigctl.analysis.agreement.adequacy import Adequacy
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import SLIGHT
from rigctl.analysis.diagnosis_result import Verdict
from rigctl.analysis.laws.answer import LawAnswer, Laws
from rigctl.analysis.linear.block_validation import BlockValidation, leave_blocks_out
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search.certainty import (
    FoundSet,
    certain_levels,
    cross_validations,
    evidence_against,
    size_scatters,
)
from rigctl.analysis.search.identity import Levels, same_cause
from rigctl.analysis.search.own_scale import proven_by_collapse
from rigctl.analysis.search.reasons import OnlyEdgesSearched, Reason, failed_checks
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.remainder import Remainder, remainder
from rigctl.analysis.search.rivals import Rival, classes_of, find_rivals
from rigctl.analysis.search.search import Search


@dataclass(frozen=True)
class Judgement:
    """What a search shows.

    Attributes
    ----------
    best: the most probable set of effects that are sure to be distinguished from other shapes of its laws.
    rivals: the effects with which its members may be confused.
    answer: the set with its classes (none if nothing is named), cross-validations and remainder.
    every_law: the laws of its effects, estimated as they are asked for.
    scatters: of the sizes of its members between records.
    blocks: where only the floor of the noise is known, how the set predicts blocks of time left out of its
        fit; else None.
    """

    search: Search = field(repr=False)
    best: RefittedSet
    rivals: tuple[Rival, ...]
    answer: FoundSet = field(repr=False)
    every_law: Laws = field(repr=False)
    scatters: tuple[SizeScatter, ...]
    blocks: BlockValidation | None = None

    @property
    def checks(self) -> Mapping[str, CrossValidation | None]:
        """Cross-validation of each member."""
        return self.answer.checks

    @property
    def remaining(self) -> Remainder | None:
        """What the set leaves."""
        return self.answer.remaining

    @property
    def close(self) -> tuple[Rival, ...]:
        """The rivals that these data do not distinguish from the set."""
        return tuple(rival for rival in self.rivals if not rival.separable)

    @cached_property
    def laws(self) -> tuple[LawAnswer, ...]:
        """The laws of the set's members; none of a set that is only the nearest."""
        outside = self.of_set is Verdict.OUTSIDE_LIBRARY
        return () if outside else self.every_law.of(self.best.effects)

    @cached_property
    def of_set(self) -> Verdict:
        """The verdict on the set, whatever its laws are."""
        return verdict_on(self.search, self.best, self.close, self.checks, self.remaining, self.blocks)

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict: an effect whose own variable does not matter is not certain to be what is missing, nor
        one at the edge of a program whose inside was not searched."""
        if (self.undriven or self.edges) and self.of_set is Verdict.MISSING_EFFECT:
            return Verdict.AMBIGUOUS
        return self.of_set

    @cached_property
    def edges(self) -> tuple[OnlyEdgesSearched, ...]:
        """That effects were searched at the edges of a program alone, if one computes the model."""
        program = self.search.before.fit.problem.model.family.program
        return () if program is None else (OnlyEdgesSearched.of(program),)

    @property
    def shown(self) -> ModelComparison:
        """The model as the answer describes it: where nothing is named in the scale of what a set leaves, as
        it was compared, in the scale of its own errors."""
        given = self.search.given
        if given is None or self.named or not self.search.in_own_scale:
            return self.search.before
        return given

    @property
    def named(self) -> bool:
        """Whether the verdict names effects."""
        return self.verdict in (Verdict.MISSING_EFFECT, Verdict.AMBIGUOUS)

    @cached_property
    def undriven(self) -> tuple[Reason, ...]:
        """The laws and sizes of members that do not change with their own variables."""
        constant = [one for one in self.laws if one.constant and one.effect in self.best.effects]
        return (*constant, *(one for one in self.scatters if one.follows))

    @cached_property
    def levels(self) -> tuple[Levels, ...]:
        """How far the answer goes for each member."""
        if not self.named or self.edges:  # what may be inside a program has no certain location either
            return ()
        return certain_levels(self.answer, self.laws, self.scatters)

    @cached_property
    def against(self) -> tuple[Reason, ...]:
        """Why the set may not be what is missing, besides its rivals; members that are certain all the same
        are not doubted."""
        return tuple(self.answer.against(self.answer.certain_alone(self.levels)))

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Groups of effects that are not distinguished, one for each member; empty if nothing is named."""
        return self.answer.classes if self.named else ()

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """The members that failed cross-validation, if nothing else speaks against the set."""
        others = self.close or self.undriven or self.edges
        alone = self.named and not others and len(self.answer.against()) == 1
        return failed_checks(self.checks) if alone else ()


def judge_set(search: Search, best: RefittedSet) -> Judgement:
    """The judgement of a search and its best set."""
    best, rivals = _sure_members(search, best)
    checks = cross_validations(search, best)
    answer = FoundSet(search, best, classes_of(best, rivals), checks, remainder(search, best))
    own = search.in_own_scale and proven_by_collapse(search, best)
    return Judgement(
        search,
        best,
        tuple(rivals),
        answer,
        Laws(search, best),
        tuple(size_scatters(search, best)),
        leave_blocks_out(search.null.fit, best.fit) if own else None,
    )


def agrees_within_tolerance(search: Search) -> bool:
    """Whether the model agrees with the data, within the shape tolerance of its effects' laws."""
    if search.in_own_scale and search.before.adequacy.stated and not search.before.adequacy.unusable:
        return False  # an effect that proves itself refutes what is stated
    before = search.before.adequacy
    return before.adequate or before.only_misread or search.null_tests.adequacy.adequate


def _sure_members(search: Search, best: RefittedSet) -> tuple[RefittedSet, list[Rival]]:
    """The best set and its rivals, without a small member that cannot be distinguished from other effects.

    What little such a member explains beside the rest is then part of the remainder, and reported as such,
    because its identity is uncertain. Laws of one cause do not count as other effects. The member stays if
    the tests find nothing left with it: then something is missing beside the other member, and its class
    lists the possible effects.
    """
    rivals = find_rivals(search, best)
    if len(best.candidates) < 2 or not search.excess(best):
        return best, rivals
    reached = search.null.chi2 - best.chi2
    for member in best.candidates:
        close = any(
            rival.member == member.name
            and not rival.separable
            and not same_cause(member.effect, search.effect(rival.name))
            for rival in rivals
        )
        rest = search.known([one for one in best.candidates if one is not member])
        if close and rest is not None and search.explained(best, member) < SLIGHT * reached:
            return rest, find_rivals(search, rest)
    return best, rivals


def verdict_on(
    search: Search,
    best: RefittedSet,
    close: Sequence[Rival],
    checks: Mapping[str, CrossValidation | None],
    remaining: Remainder | None,
    blocks: BlockValidation | None = None,
) -> Verdict:
    """The verdict on a set, from its rivals, its cross-validations and what it leaves."""
    unnamed = _nothing_to_name(search, best, blocks)
    if unnamed is not None:
        return unnamed
    # The order of these cases decides which verdict a set with several defects has: first what shows that it
    # is not the cause (too much left; predictions that fail), then what merely leaves it open (rivals,
    # doubts).
    if not best.candidates or not search.sure(best):
        return Verdict.OUTSIDE_LIBRARY
    if failed_checks(checks) and remaining is not None and len(best.candidates) > 1:
        # several effects that neither explain all of the misfit nor predict records left out of their fit
        # together imitate one that is not in the library
        return Verdict.OUTSIDE_LIBRARY
    if close or evidence_against(search, best, checks, remaining):
        return Verdict.AMBIGUOUS
    return Verdict.MISSING_EFFECT


def _nothing_left(search: Search, given: Adequacy) -> Verdict:
    """The verdict where no test finds anything within the tolerance of the laws.

    In the scale of its own errors any model agrees that leaves no pattern in them, and that is no noise: the
    tests of the comparison decide, `given`.
    """
    before = search.before.adequacy
    own = search.in_own_scale and not before.below_noise
    if before.only_misread or (own and given.rejected):  # the sensor is no effect of the library either
        return Verdict.OUTSIDE_LIBRARY
    return Verdict.UNDECIDED if before.below_noise or (own and not given.agrees) else Verdict.ADEQUATE


def _nothing_to_name(search: Search, best: RefittedSet, blocks: BlockValidation | None) -> Verdict | None:
    """The verdict where no effect may be named; None where one may be.

    Where only the floor of a noise is known, an effect is named only if it proves itself and predicts blocks
    of time left out of its fit. Otherwise the model's own tests decide, as in a comparison: they need no
    noise level either.
    """
    before = search.before.adequacy
    if before.unusable:
        return Verdict.UNDECIDED
    given = before if search.given is None else search.given.adequacy
    if agrees_within_tolerance(search):
        return _nothing_left(search, given)
    # With a known noise the tests have rejected the model, so that effects may be named. With the floor alone
    # the tests have no noise level to rely on, and the effects have to prove themselves.
    if not search.in_own_scale or (proven_by_collapse(search, best) and (blocks is None or blocks.passed)):
        return None
    if given.agrees:  # within the noise that is stated
        return Verdict.ADEQUATE
    return Verdict.OUTSIDE_LIBRARY if given.rejected else Verdict.UNDECIDED
