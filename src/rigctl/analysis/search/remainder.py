"""What the effects that were found leave: how much, where, and which effect would absorb most of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rigctl.analysis.agreement.slot_evidence import slot_evidence
from rigctl.analysis.agreement.trends import Trend, trends
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.search import Search
from rigctl.notebook import worded

#: an effect that absorbs less than this share of the remainder does not determine where it is
_MOST = 0.5
#: least χ² of which a size is stated
STATED = 1.0


@dataclass(frozen=True)
class Remainder:
    """The systematic misfit that the effects of a diagnosis leave.

    Attributes
    ----------
    share: of the squared misfit, 0 … 1.
    size: in sigmas of the data: the square root of the χ² that is left; 0 for what a test detects although no
        further effect would be worth its cost.
    p_value: of the tests on the remainder; it is below their level.
    slot: the equation in which it is, "" if none stands out.
    over: the operating variable over which it changes most, "" if over none.
    effect: the effect that absorbs most of it beside the others, "" if none does.
    absorbed: the share of the remainder that it absorbs; `beside` the others.
    below_noise: the error with the set is below the noise, so the tests that see it assume a wrong noise.
    """

    share: float
    size: float
    p_value: float
    slot: str
    over: str
    effect: str
    absorbed: float = 0.0
    beside: tuple[str, ...] = ()
    below_noise: bool = False

    @property
    def statement(self) -> str:
        """In words."""
        return worded(self, "findings.reasons.remainder_text")

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "share": self.share,
            "size": self.size,
            "p_value": self.p_value,
            "slot": self.slot,
            "over": self.over,
            "effect": self.effect,
            "statement": self.statement,
            "below_noise": self.below_noise,
        }


def remainder(search: Search, best: RefittedSet) -> Remainder | None:
    """What the best set leaves; None if there is no set, or the tests find nothing any more."""
    if not best.candidates:
        return None
    excess = search.excess(best)
    if search.at(best).adequacy.agrees or search.with_discrepancies(best).adequacy.agrees:
        return None
    view = search.with_discrepancies(best)
    if view.adequacy.undecided and excess < STATED:
        return None  # slow noise, or something else: no test can tell, and nothing is claimed
    name, slot, absorbed = _next(search, best, excess)
    # Where: at the slot of the effect that absorbs most of the rest, if it absorbs enough; else where a free
    # disturbance has the highest evidence, which needs no library.
    if absorbed < _MOST:
        evidence = slot_evidence(best.fit)
        slot = evidence[0].slot if evidence else ""
    trend = _steepest(trends(best.fit))
    return Remainder(
        share=search.left(best),
        size=math.sqrt(excess),
        p_value=view.adequacy.p_value,
        slot=slot,
        over="" if trend is None else trend.variable,
        effect=name,
        absorbed=absorbed,
        beside=best.effects,
        below_noise=view.adequacy.below_noise,
    )


def _next(search: Search, best: RefittedSet, excess: float) -> tuple[str, str, float]:
    """(name, slot, share) of the effect that absorbs most of the remainder; "" if none improves mBIC."""
    beside = search.beside(best)
    if not beside or excess <= 0.0:
        return "", "", 0.0
    added = [one for one in beside[0].candidates if one.name not in best.effects]
    absorbed = min(1.0, (best.chi2 - beside[0].chi2) / excess)
    return added[0].name, (added[0].effect.slots or ("",))[0], absorbed


def _steepest(all_trends: tuple[Trend, ...]) -> Trend | None:
    grown = [trend for trend in all_trends if trend.significant]
    return max(grown, key=lambda trend: abs(trend.z), default=None)
