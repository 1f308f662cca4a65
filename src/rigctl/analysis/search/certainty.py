"""Which statements about the members of a set are certain, and what speaks against the set.

Several effects that leave something may together imitate an effect that is in no library, so that none of
them is certain. But one that by itself leaves no more than another shape of its law may is as certain beside
a second effect as without it: what the second one explains is a part of what the first one leaves.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rigctl.analysis.decision_levels import LEAST_DIFFERENCE
from rigctl.analysis.laws.answer import LawAnswer, Laws
from rigctl.analysis.laws.simpler_law import simpler_does
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.cross_validation import CrossValidation, held_out_gain
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search.identity import Levels, certain_members, levels_of
from rigctl.analysis.search.own_scale import doubts, not_a_sensor
from rigctl.analysis.search.reasons import Reason, reasons_against
from rigctl.analysis.search.refit import RefittedSet, left_by_refit
from rigctl.analysis.search.remainder import Remainder, remainder
from rigctl.analysis.search.rivals import classes_of, find_rivals
from rigctl.analysis.search.search import Search
from rigctl.model.fit.reached_bounds import decisive_bounds
from rigctl.tasks import counted


@dataclass(frozen=True)
class FoundSet:
    """A set of effects as the answer of a search.

    Attributes
    ----------
    classes: for each member, itself and the effects that are not distinguished from it.
    checks: the cross-validation of each member.
    remaining: what the set leaves.
    """

    search: Search = field(repr=False)
    best: RefittedSet
    classes: tuple[tuple[str, ...], ...]
    checks: Mapping[str, CrossValidation | None]
    remaining: Remainder | None

    def against(self, certain: Collection[str] = ()) -> list[Reason]:
        """What speaks against the set, see `evidence_against`; `certain` members are not doubted."""
        return evidence_against(self.search, self.best, self.checks, self.remaining, certain=certain)

    @property
    def incomplete(self) -> bool:
        """Whether these are several effects that leave something."""
        return len(self.best.candidates) > 1 and self.remaining is not None

    def certain_alone(self, levels: Sequence[Levels]) -> tuple[str, ...]:
        """The members of an incomplete set of which something is certain, as it is without the others."""
        return certain_members(levels) if self.incomplete else ()

    def left_alone(self, levels: Sequence[Levels]) -> dict[str, float]:
        """The share of the misfit that each member leaves alone, of which something is certain all the
        same."""
        alone = {}
        for name in self.certain_alone(levels):
            (member,) = (one for one in self.best.candidates if one.name == name)
            single = self.search.known([member])
            if single is not None:
                alone[name] = self.search.left(single)
        return alone


def cross_validations(search: Search, best: RefittedSet) -> dict[str, CrossValidation | None]:
    """Cross-validation of each member of a set, at its fit; None for a single record."""
    predicted = counted(best.candidates, "Predicting the conditions left out", search.on_progress)
    return {candidate.name: _cross_validation(search, best, candidate) for candidate in predicted}


def _cross_validation(search: Search, best: RefittedSet, candidate: Candidate) -> CrossValidation | None:
    point = search.at(best)
    lin = point.linearisation
    if len(lin.records) < 2:
        return None
    without = search.known([one for one in best.candidates if one is not candidate])
    if len(best.candidates) == 1:
        without = search.null

    def refitted(fold: Sequence[int]) -> tuple[float, float] | None:
        outside = [best.fit.fitted[k] for k in fold]
        if without is None:
            return None
        squares = left_by_refit(without.fit, outside), left_by_refit(best.fit, outside)
        return None if squares[0] is None or squares[1] is None else (squares[0], squares[1])

    again = refitted if search.sure(best) and not lin.fit.problem.measurements.table else None
    return held_out_gain(lin, candidate.columns, best.amplitudes(candidate), point.held(candidate), again)


def evidence_against(
    search: Search,
    best: RefittedSet,
    checks: Mapping[str, CrossValidation | None],
    remaining: Remainder | None,
    *,
    sizes: bool = True,
    certain: Collection[str] = (),
) -> list[Reason]:
    """Why a set may not be what is missing, besides its rivals; see `reasons_against`.

    A bound that a user wrote and that holds the fit with the set is a reason too: it leaves a misfit that the
    set may only imitate.
    """
    reasons = reasons_against(best, checks, remaining, search.reached(best), sizes=sizes, certain=certain)
    reasons += doubts(search, best) if search.in_own_scale else []
    reasons += decisive_bounds(best.fit)
    return [*reasons, *(not_a_sensor(best) if search.tolerance else [])]


def size_scatters(search: Search, best: RefittedSet) -> list[SizeScatter]:
    """The scatter between records of the sizes of those members that depend on no state or input."""
    scatters = [search.at(best).scatter(one.name) for one in best.candidates] if search.tolerance else []
    return [one for one in scatters if one is not None]


def certain_levels(
    answer: FoundSet, laws: Sequence[LawAnswer], scatters: Sequence[SizeScatter]
) -> tuple[Levels, ...]:
    """How far the answer goes for each member of the set: location, explanatory variable, law."""
    together = _levels(answer, laws, scatters)
    if not answer.incomplete:
        return together
    known = [answer.search.known([member]) for member in answer.best.candidates]
    better = min((one for one in known if one is not None), key=answer.search.mbic, default=None)
    return tuple(
        (_by_itself(answer, better, names, laws, scatters) if better is not None and one is better else None)
        or levels
        for one, names, levels in zip(known, answer.classes, together, strict=True)
    )


def _by_itself(
    answer: FoundSet,
    alone: RefittedSet,
    names: Sequence[str],
    laws: Sequence[LawAnswer],
    scatters: Sequence[SizeScatter],
) -> Levels | None:
    """The levels of the better member of an incomplete set without the others, but for its law.

    None if it leaves more alone than its law may, if its size is undetermined or unusual, if the noise is not
    as assumed, and for a table, whose laws have no shape tolerance.

    Parameters
    ----------
    alone: the member without the others, as fitted.
    names: the member and the effects that are not distinguished from it beside the others.
    laws, scatters: of the set, which count as well.
    """
    # Nothing is certain of a member alone if anything in the tests is in question: its size, the noise, or
    # whether it leaves little enough to be the right cause.
    search, (name,) = answer.search, alone.effects
    doubted = name in (*answer.best.undetermined, *answer.best.unusual)
    wrong_noise = answer.remaining is not None and answer.remaining.below_noise
    if doubted or wrong_noise or not search.tolerance or not search.sure(alone) or search.below_noise(alone):
        return None
    # Alone it is compared with rivals again, since beside the other member other effects may have looked
    # alike. Both classes, both sets of laws and scatters count: a level must hold in both situations.
    (also,) = classes_of(alone, find_rivals(search, alone))
    classes = (tuple(dict.fromkeys([*names, *also])),)
    checks = cross_validations(search, alone)
    single = FoundSet(search, alone, classes, checks, remainder(search, alone))
    every_law = [*Laws(search, alone).of(alone.effects), *laws]
    every_scatter = [*size_scatters(search, alone), *scatters]
    (levels,) = _levels(single, every_law, every_scatter)
    return replace(levels, law_sure=False)


def _levels(
    answer: FoundSet, laws: Sequence[LawAnswer], scatters: Sequence[SizeScatter]
) -> tuple[Levels, ...]:
    search, best, remaining = answer.search, answer.best, answer.remaining
    # The discrepancies of the laws, integrated out, raise the evidence by 100 : 1: another shape is required.
    other_shape = search.evidence(best) - search.mbic(best) < -LEAST_DIFFERENCE
    effects = {name: search.effect(name) for names in answer.classes for name in names}
    constant = {
        name: [law.law.driver.name for law in laws if law.effect == name and law.constant] for name in effects
    }
    varying = [one.effect for one in scatters if one.follows]
    usual = not answer.against()
    single = len(best.candidates) == 1
    # one effect that leaves nothing: a size beyond its usual range makes its law doubtful, not its location;
    # with a handful of values nearly every effect leaves nothing at some size
    alone_and_all = single and remaining is None and search.tolerance > 0.0
    sure = usual or (alone_and_all and not evidence_against(search, best, answer.checks, None, sizes=False))
    steady = best.effects if single and remaining is not None and search.scatter_is_all(best) else ()
    alone = (
        {names[0] for names in answer.classes if len(names) == 1}
        if usual and not other_shape and remaining is None
        else ()
    )
    return levels_of(
        answer.classes,
        effects,
        sure=sure,
        usual=usual,
        other_shape=other_shape,
        spare=[one.name for one in best.candidates if one.name in alone and simpler_does(search, best, one)],
        complete=remaining is None,
        constant=constant,
        steady=steady,
        varying=varying,
    )
