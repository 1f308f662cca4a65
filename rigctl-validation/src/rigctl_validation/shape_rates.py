"""Rates of the shape tier: claims about effects whose laws are not the library's, level by level."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

from rigctl.analysis.decision_levels import LEAST_SEPARATION, SHAPE_TOLERANCE
from rigctl.analysis.search.identity import same_cause
from rigctl.effects.declaration import Effect
from rigctl.effects.registry import find_effect
from rigctl_validation.amplitude import CLOSE
from rigctl_validation.figures import Figures, Rate, rate_of
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.outcome import Claim, Outcome
from rigctl_validation.rates import TOGETHER, confusion

_FAMILY = "hydraulic_cylinder"


def shape_figures(outcomes: Sequence[Outcome]) -> Figures:
    """All results of the tier that are printed."""
    return Figures(tuple(outcomes), shape_rates(outcomes), confusion(outcomes))


def shape_rates(outcomes: Sequence[Outcome]) -> tuple[Rate, ...]:
    """All rates of the tier, with their targets."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    one = [o for o in counted if o.scenario.kind == "one" and not _beyond_usual(o)]
    beyond = [o for o in counted if o.scenario.kind == "one" and _beyond_usual(o)]
    two = [o for o in counted if o.scenario.kind == "two"]
    beside = [o for o in two if _least_beside(o) >= (1.0 - CLOSE) * TOGETHER]
    each = "λ >= 10 each, also beside the other and beyond its tolerance"
    removed = [o for o in counted if o.scenario.kind == "removed"]
    rates = [
        rate_of(
            "false alarm, nothing hidden", "noise estimated", _of(counted, "nothing"), _alarm, at_most=0.05
        ),
        *_by_size("place and driver named", one, _cause_named, at_least=0.95),
        *_by_size("place and driver, or the class where none can tell", one, _as_far_as_told, at_least=0.95),
        *_by_size("law or its class named", one, lambda o: o.right, at_least=0.90),
        *_by_size("wrong at a level that is claimed", one, wrongly_claimed, at_most=0.01),
        rate_of(
            "law corrected",
            "the true exponent in its interval",
            [o for o in counted if o.exponents],
            lambda o: all(interval.covers for interval in o.exponents),
        ),
        rate_of("beyond its usual range", "named or in the class", beyond, lambda o: o.right, at_least=1.0),
        rate_of("a strong and a weak effect: both named", each, beside, lambda o: o.exact, at_least=0.90),
        rate_of("a strong and a weak effect: both named", "all", two, lambda o: o.exact),
        rate_of("a strong and a weak effect: wrong at a level", "all", two, wrongly_claimed, at_most=0.01),
        rate_of("a strong and a weak effect: one, and that is all", each, beside, _one_is_all, at_most=0.05),
        rate_of("a strong and a weak effect: one, and that is all", "all", two, _one_is_all),
        *_by_size("truth removed, outside or a true level", removed, _honest, at_least=0.95),
        *_by_size("truth removed, wrong place or driver", removed, _wrong_cause, at_most=0.01),
        rate_of(
            "truth removed, wrong place or driver",
            "no other effect is nearly equivalent",
            [o for o in removed if not _nearly_equivalent(o)],
            _wrong_cause,
        ),
    ]
    return tuple(rate for rate in rates if rate.trials)


def _least_beside(outcome: Outcome) -> float:
    """The smallest λ of two effects beside each other, with their laws as declared and with their tolerance.

    Infinite if unknown.
    """
    return min((*outcome.beside, *outcome.beyond_laws), default=math.inf)


def wrongly_claimed(outcome: Outcome) -> bool:
    """Whether any claim is true of none of the hidden effects."""
    return any(_wrong(claim, outcome.scenario.truth) for claim in outcome.claims)


def _wrong(claim: Claim, truth: Sequence[str]) -> bool:
    if claim.law:
        return claim.effect not in truth
    if claim.driver:
        return not any(same_cause(_effect(claim.effect), _effect(name)) for name in truth)
    return claim.place and not any(_same_place(claim.effect, name) for name in truth)


def _wrong_cause(outcome: Outcome) -> bool:
    """Whether a claimed location or variable is that of none of the hidden effects."""
    truth = outcome.scenario.truth
    return any(
        (claim.driver and not any(same_cause(_effect(claim.effect), _effect(name)) for name in truth))
        or (claim.place and not any(_same_place(claim.effect, name) for name in truth))
        for claim in outcome.claims
    )


def _honest(outcome: Outcome) -> bool:
    """For an effect that the library lacks: outside the library, undecided, or at the true location."""
    return outcome.verdict is not None and outcome.verdict != "adequate" and not _wrong_cause(outcome)


def _cause_named(outcome: Outcome) -> bool:
    """Whether location and variables of the hidden effect are claimed.

    For a law that depends on one variable more than the library's, only the location has to be claimed.
    """
    truth = outcome.scenario.truth[0]
    if outcome.scenario.shape == "wrong" and find_hidden(truth).depends_also:
        return any(claim.place and _same_place(claim.effect, truth) for claim in outcome.claims)
    return any(claim.driver and same_cause(_effect(claim.effect), _effect(truth)) for claim in outcome.claims)


def _as_far_as_told(outcome: Outcome) -> bool:
    """Whether location and variables are named; or a class with the truth, if another effect is nearly
    equivalent."""
    return _cause_named(outcome) or (_nearly_equivalent(outcome) and outcome.right)


def _nearly_equivalent(outcome: Outcome) -> bool:
    """Whether another effect of the library is nearly equivalent to the hidden one.

    That is one that no data of these sensors distinguish from it in 99 cases of 100, or that differs by less
    than the shape tolerance of either law: such two are indistinguishable whatever their size.
    """
    apart = math.inf if outcome.separation is None else outcome.separation
    return apart < max(LEAST_SEPARATION, SHAPE_TOLERANCE * outcome.scenario.hidden[0].size)


def _beyond_usual(outcome: Outcome) -> bool:
    """Whether the hidden effect is larger than the library's usual range."""
    (wanted,) = outcome.scenario.hidden
    if wanted.amplitude is not None or not outcome.amplitudes:
        return wanted.amplitude is not None
    hidden = find_hidden(wanted.effect)
    declared = _effect(wanted.effect).parameter(hidden.parameter)
    return declared.unusual(declared.at_null + outcome.amplitudes[0])


def _one_is_all(outcome: Outcome) -> bool:
    return outcome.verdict == "missing_effect" and len(outcome.effects) == 1 and outcome.all_of_it


def _alarm(outcome: Outcome) -> bool:
    return outcome.verdict != "adequate"


def _same_place(one: str, other: str) -> bool:
    return set(_effect(one).slots) == set(_effect(other).slots)


@lru_cache(maxsize=256)
def _effect(name: str) -> Effect:
    return find_effect(name, _FAMILY)


def _of(outcomes: Sequence[Outcome], kind: str) -> list[Outcome]:
    return [outcome for outcome in outcomes if outcome.scenario.kind == kind]


def _by_size(
    name: str,
    among: Sequence[Outcome],
    happened: Callable[[Outcome], bool],
    *,
    at_least: float | None = None,
    at_most: float | None = None,
) -> list[Rate]:
    sizes = sorted({outcome.scenario.hidden[0].size for outcome in among})
    rates = [rate_of(name, "all sizes", among, happened, at_least=at_least, at_most=at_most)]
    for size in sizes:
        sized = [outcome for outcome in among if outcome.scenario.hidden[0].size == size]
        rates.append(rate_of(name, f"λ = {size:g}", sized, happened))
    return rates
