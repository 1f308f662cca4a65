"""Similarity of other effects to a hidden one: an upper limit on the power of any diagnosis.

Computed from noise-free readings, and by refits: the library's effect of that name has another shape than the
bench's, and fitted parameters move farther than a linearisation holds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import SHAPE_TOLERANCE
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.detectability import Unexplained
from rigctl.analysis.linear.separability import separation
from rigctl.analysis.search.linearised_set import LinearisedSet
from rigctl.analysis.search.refit import RefittedSet, plain, refit
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult

Floats = NDArray[np.float64]

#: number of the effects most similar to a hidden one that are fitted to it
_NEAREST = 3
#: least cosine for these: no refit makes others similar
_FAR = 0.5
#: relative accuracy of a fit without noise
_COST = 1e-3


@dataclass(frozen=True)
class Likeness:
    """The similarity of one hidden effect to the others of the library.

    Attributes
    ----------
    own: the library's effect of that name in the shape that explains most; None if it explains nothing.
    cosine: ``sqrt(Δχ²)/λ`` of the other effect that explains most of the hidden one, or the cosine of the
        signatures if that is larger.
    separation: d of the library's own effect and the other one that explains most, from what each leaves: its
        cosine is ``sqrt(Δχ²_other/Δχ²_own)``, its λ ``sqrt(Δχ²_own)``. None if the own effect could not be
        fitted.
    """

    own: Candidate | None
    cosine: float
    separation: float | None


def likeness(unexplained: Unexplained, fitted: FitResult, effect: str, size: float) -> Likeness:
    """Similarity of other effects to a hidden one.

    Parameters
    ----------
    unexplained: the linearisation by which the others worth fitting are selected.
    fitted: the model without any effect, fitted to the readings with the hidden one.
    size: λ of the hidden one.
    """
    changed = _changed(unexplained, fitted)
    alike = unexplained.cosines(changed)
    near = dict(alike)
    library_effect = unexplained.share_of(effect, changed)
    if library_effect is not None:
        for name, cosine in unexplained.cosines(library_effect[1]).items():
            near[name] = max(near[name], cosine)
    others = sorted((name for name in near if name != effect), key=lambda name: -near[name])[:_NEAREST]
    shapes = [unexplained.share_of(name, changed) for name in others if near[name] > _FAR]
    slopes = max((cosine for name, cosine in alike.items() if name != effect), default=0.0)
    falls = [_fall(fitted, shape[0]) for shape in shapes if shape is not None]
    most = max([slopes * size, *(math.sqrt(fall) for fall in falls if fall is not None)])
    fall = None if library_effect is None else _fall(fitted, library_effect[0])
    return Likeness(
        own=None if library_effect is None else library_effect[0],
        cosine=min(1.0, most / size),
        separation=separation(math.sqrt(fall), min(1.0, most / math.sqrt(fall))) if fall else None,
    )


def sizes_beside_each_other(
    fitted: FitResult, chosen: Sequence[Candidate]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """λ of each of several hidden effects beside the others, with their laws as declared, and beyond their
    shape tolerance.

    An effect that another one nearly absorbs has far less than its own size. The first is the cost of leaving
    the effect out, by refits; the second is computed from the linearised refit of all. Each is empty if
    unknown.

    Parameters
    ----------
    fitted: the model without any effect, fitted to the readings with all of them.
    """
    every = refit(fitted, chosen, cost=_COST)
    if every is None:
        return (), ()
    rest = [tuple(one for one in chosen if one is not member) for member in chosen]
    without = [refit(fitted, others, every.fit, cost=_COST) if others else plain(fitted) for others in rest]
    beside = tuple(math.sqrt(_below(one, every)) for one in without if one is not None)
    try:
        point = LinearisedSet(every, fitted.problem.rebuilt(fitted.at_end, library=True))
        return beside, tuple(point.size_beyond(member, SHAPE_TOLERANCE) for member in chosen)
    except RigctlError:  # the model cannot be simulated with one of the discrepancies
        return beside, ()


def _changed(unexplained: Unexplained, fit: FitResult) -> Floats:
    """(rows) residuals of a fit."""
    readings = [record.values for record in fit.problem.records]
    return unexplained.of([read - fitted for read, fitted in zip(readings, fit.outputs, strict=True)])


def _fall(fitted: FitResult, candidate: Candidate) -> float | None:
    """The reduction of χ² by a refit with one more effect; None if the model cannot be simulated with it."""
    refitted = refit(fitted, [candidate], cost=_COST)
    return None if refitted is None else _below(plain(fitted), refitted)


def _below(without: RefittedSet, with_it: RefittedSet) -> float:
    return max(0.0, without.chi2 - with_it.chi2)
