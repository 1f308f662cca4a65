"""How nearly other effects explain what a scenario hides: what any diagnosis of its readings could know.

Asked of readings without noise, and by refits: the library's effect of that name has another shape than the
bench's, and fitted parameters go further than slopes say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.candidates import Candidate
from rigctl.compare.unexplained import Unexplained
from rigctl.diagnose.confound import separation
from rigctl.diagnose.trial import Trial, plain, refit
from rigctl.model.fit.fit import FitResult

Floats = NDArray[np.float64]

#: so many of the effects that look most like a hidden one are fitted to it
_NEAREST = 3
#: how well, without noise
_COST = 1e-3


@dataclass(frozen=True)
class Likeness:
    """Of one hidden effect to the others of the library.

    Attributes
    ----------
    cosine: ``sqrt(Δχ²)/λ`` of the other effect that explains most of what is hidden.
    separation: d of the library's effect of that name and the other one that explains most, by what each
        leaves: the cosine in it is ``sqrt(Δχ²_other/Δχ²_own)``, its λ ``sqrt(Δχ²_own)``.
    """

    cosine: float
    separation: float


def likeness(seen: Unexplained, left: FitResult, effect: str, size: float) -> Likeness:
    """How nearly others explain a hidden effect.

    Parameters
    ----------
    seen: the linearisation that tells which of the others are worth a fit.
    left: the model without any effect, fitted to the readings with the hidden one.
    size: λ of the hidden one.
    """
    changed = _changed(seen, left)
    alike = seen.cosines(changed)
    near = dict(alike)
    own = seen.share_of(effect, changed)
    if own is not None:
        for name, cosine in seen.cosines(own[1]).items():
            near[name] = max(near[name], cosine)
    others = sorted((name for name in near if name != effect), key=lambda name: -near[name])[:_NEAREST]
    shapes = {name: seen.share_of(name, changed) for name in others}
    falls = {name: _fall(left, shape[0]) for name, shape in shapes.items() if shape is not None}
    slopes = max((cosine for name, cosine in alike.items() if name != effect), default=0.0)
    most = math.sqrt(max(falls.values(), default=0.0))
    return Likeness(
        cosine=min(1.0, max(slopes, most / size)),
        separation=_apart(0.0 if own is None else math.sqrt(_fall(left, own[0])), most),
    )


def beside_each_other(seen: Unexplained, left: FitResult, effects: Sequence[str]) -> tuple[float, ...]:
    """λ of each of several hidden effects beside the others: what leaving its library's effect out costs.

    An effect that another one nearly takes up has far less than its own size.

    Parameters
    ----------
    seen, left: as of `likeness`, the readings with all of the effects.
    """
    changed = _changed(seen, left)
    shapes = [seen.share_of(effect, changed) for effect in effects]
    chosen = [shape[0] for shape in shapes if shape is not None]
    every = refit(left, chosen, cost=_COST) if len(chosen) == len(effects) else None
    if every is None:
        return tuple(0.0 for _ in effects)
    rest = [tuple(one for one in chosen if one is not member) for member in chosen]
    without = [refit(left, others, every.fit, cost=_COST) if others else plain(left) for others in rest]
    return tuple(0.0 if one is None else math.sqrt(_below(one, every)) for one in without)


def _changed(seen: Unexplained, left: FitResult) -> Floats:
    """(rows) what a fit leaves of the readings it was made to."""
    readings = [record.values for record in left.problem.records]
    return seen.of([read - fitted for read, fitted in zip(readings, left.outputs, strict=True)])


def _fall(left: FitResult, candidate: Candidate) -> float:
    """Of χ², by a refit with one effect more."""
    found = refit(left, [candidate], cost=_COST)
    return 0.0 if found is None else _below(plain(left), found)


def _below(without: Trial, with_it: Trial) -> float:
    return max(0.0, without.chi2 - with_it.chi2)


def _apart(own: float, other: float) -> float:
    return separation(own, min(1.0, other / own)) if own > 0.0 else 0.0
