"""Whether the data need the whole of an effect's law, or a simpler law that is a limiting case of it
suffices.

If the simpler law is an effect of the library, the two are rivals. If it is not, nothing else tests this: an
effect with a superfluous parameter imitates the simpler law and fits as well, which is no evidence for its
own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import cast

from rigctl.analysis.decision_levels import LEAST_DIFFERENCE
from rigctl.analysis.linear.candidates import Candidate, at_each_shape
from rigctl.analysis.search.identity import same_cause
from rigctl.analysis.search.refit import RefittedSet, refit
from rigctl.analysis.search.rivals import nested_at
from rigctl.analysis.search.search import Search
from rigctl.effects.declaration import Effect, Own, Term
from rigctl.engine.symbols import Scalar
from rigctl.physics.scope import Scope


def simpler_does(search: Search, best: RefittedSet, member: Candidate) -> bool:
    """Whether a simpler law fits as well in place of a member of the best set.

    The simpler law has one parameter less: one parameter equals the other that is its lower limit, or is held
    at the value at which the effect becomes another one by declaration. Not tested if the search has already
    tried a simpler law of the same slot and variable in its place.
    """
    rest = [one for one in best.candidates if one is not member]
    if _was_tried(search, rest, member):
        return False
    if any(nested_at(best.fit, member.effect, law) for _, _, law in member.effect.becomes):
        return True
    refitted = (
        refit(search.before.fit, [*rest, candidate], best.fit)
        for effect in simpler_laws(member.effect)
        for candidate in at_each_shape(effect)
    )
    limit = search.mbic(best) + LEAST_DIFFERENCE
    return any(one is not None and search.mbic(one) < limit for one in refitted)


def simpler_laws(effect: Effect) -> Iterator[Effect]:
    """The effect with one parameter less, which equals the other that is its lower limit."""
    for parameter in effect.parameters:
        if parameter.at_least is not None:
            tied = {parameter.name: parameter.at_least}
            yield replace(
                effect,
                name=f"{effect.name}_with_equal_{parameter.name}",
                terms=tuple((slot, _with(term, tied)) for slot, term in effect.terms),
                states=tuple(replace(one, rate=_with(one.rate, tied)) for one in effect.states),
                parameters=tuple(one for one in effect.parameters if one is not parameter),
                other_ways=(),
                becomes=(),
                own_family=effect.model_family,
            )


class _Tied:
    """An effect's own parameters and states, of which some are replaced by others."""

    def __init__(self, own: Own, tied: Mapping[str, str]) -> None:
        self._own, self._tied = own, tied

    def __getattr__(self, name: str) -> Scalar:
        return self[name]

    def __getitem__(self, name: str) -> Scalar:
        return self._own[self._tied.get(name, name)]


def _with(term: Callable[[Scope, Own], Scalar], tied: Mapping[str, str]) -> Term:
    return lambda m, p: term(m, cast("Own", _Tied(p, tied)))


def _was_tried(search: Search, rest: list[Candidate], member: Candidate) -> bool:
    names = {one.name for one in rest}
    return any(
        same_cause(other.effect, member.effect) and len(other.columns) < len(member.columns)
        for trial in search.trials.values()
        if len(trial.candidates) == len(rest) + 1 and names <= set(trial.effects)
        for other in trial.candidates
        if other.name not in names
    )
