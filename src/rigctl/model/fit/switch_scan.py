"""Grid search over the times of switches whose costs have several minima, one after the other.

If the plant responds to a switch much faster than it is sampled, the cost is flat in the time of the switch
except for a jump where it passes a sample: the first sample after it has responded already, or not. A
gradient-based fit stays on the side where it started. So each time is tried over its whole interval with
everything else fixed, at the cost of a few simulations without derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import (
    LeastSquaresResult,
    Options,
    Prior,
    Refused,
    Unknown,
    least_squares,
    started,
)
from rigctl.engine.least_squares.unknown import prior_rows
from rigctl.errors import RigctlError
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.switching import LOGGER_DELAYS, moves_switches, switch_name, switch_shifts

Floats = NDArray[np.float64]

#: trial values of each time, as shares of its uncertainty
_TRIED = (-1.0, -0.5, 0.0, 0.5, 1.0)
#: least reduction of a record's χ² for a time to be adopted
_BETTER = 1.0
#: largest number of scans and refits
_SCANS = 3
#: fixed unknowns may move by this share of their size
_HELD = 1e-4


def with_best_switches(problem: Problem, result: LeastSquaresResult, options: Options) -> LeastSquaresResult:
    """The fit repeated from the switch times preferred by a scan, as long as that improves it.

    Parameters
    ----------
    result: a fit of `problem`.
    options: of the fits made here.
    """
    if not any(one.kind == "switch" for record_local in problem.local for one in record_local):
        return result
    # scan and refit in turn: with other switch times the parameters change, and with these the best times.
    # The refit is kept if the cost falls, and nothing is scanned again once it falls by less than a scan
    # resolves
    for _ in range(_SCANS):
        values, local, moved = scanned_switches(problem, result.values, result.local)
        try:
            again = _refitted(problem, values, local, options)
        except RigctlError:  # the model cannot be simulated there: the fit is kept
            break
        better = result.cost - again.cost
        if better > 0.0:
            result = again
        if not moved or better < 0.5 * _BETTER:
            break
    return result


def _refitted(
    problem: Problem, values: Floats, local: Sequence[Floats], options: Options
) -> LeastSquaresResult:
    """Fitted from there, first with the switch times fixed.

    A time just beside a sample is a barrier to the steps of all unknowns fitted with it, which become too
    short to make progress.
    """
    shared = started(problem.shared, values)
    record_local = [
        started(unknowns, each) for unknowns, each in zip(problem.local_unknowns(), local, strict=True)
    ]
    held = least_squares(
        problem.evaluate,
        [_held(one) if one.name in LOGGER_DELAYS else one for one in shared],
        [[_held(one) if moves_switches(one.name) else one for one in each] for each in record_local],
        options=options,
    )
    return least_squares(
        problem.evaluate,
        started(shared, held.values),
        [started(unknowns, each) for unknowns, each in zip(record_local, held.local, strict=True)],
        options=options,
    )


def _held(one: Unknown) -> Unknown:
    return replace(one, prior=Prior(one.start, _HELD * one.size))


def scanned_switches(
    problem: Problem, shared: Floats, local: Sequence[Floats]
) -> tuple[Floats, tuple[Floats, ...], bool]:
    """The unknowns with each switch time where its record is fitted best; whether any moved.

    A common shift of the times of a kind is first moved to the logger's delay: the times stay, and only the
    priors change.

    Parameters
    ----------
    shared: (shared) of `problem.shared`; fixed except for the delays.
    local: the unknowns of each record; all are fixed except the time that is tried.
    """
    best = [np.array(values) for values in local]
    times = [[k for k, one in enumerate(each) if one.kind == "switch"] for each in problem.local]
    if not any(times):
        return shared, tuple(best), False
    # first along the valley in which the delay of all switches and the times of single ones compensate each
    # other: what is common to all belongs to the delay, whose prior it costs once
    shared, best, moved = _shared_out(problem, shared, best)
    lowest = _costs(problem, shared, best)
    if lowest is None:
        return shared, tuple(best), False
    unknowns = problem.local_unknowns()
    # the first switch of every record at once, then the second: records do not depend on each other, so that
    # one simulation tries one time in each of them
    for rank in range(max(len(each) for each in times)):
        indices = [each[rank] if rank < len(each) else None for each in times]
        for share in _TRIED:
            tried = [
                _at(record_local, values, index, share)
                for record_local, values, index in zip(unknowns, best, indices, strict=True)
            ]
            costs = _costs(problem, shared, tried)
            if costs is None:
                continue
            for index in np.flatnonzero(costs < lowest - _BETTER):
                best[index], lowest[index] = tried[index], costs[index]
                moved = True
    return shared, tuple(best), moved


def _shared_out(
    problem: Problem, shared: Floats, local: Sequence[Floats]
) -> tuple[Floats, list[Floats], bool]:
    """The switch times, split between the bench's mean delay and each switch according to their priors.

    Minimises ``(w + δ)²/s_w² + Σ (d_k − 2h_k·δ)²/s_k²`` over δ, within the bounds: a gradient-based fit may
    not move along this valley, beside which the cost jumps.
    """
    values, record_local = shared.copy(), [np.array(each) for each in local]
    gained = 0.0
    for column, delay in enumerate(problem.shared):
        members = _members(problem, delay.name)
        if not members or delay.prior is None:
            continue
        # the cost is a parabola in δ, of curvature `weight` and slope −`pull` at 0; the bounds of every
        # member limit δ
        weight, pull = 1.0 / delay.prior.std**2, -(values[column] - delay.prior.mean) / delay.prior.std**2
        low, high = delay.lower - values[column], delay.upper - values[column]
        for record, index, width in members:
            one, d = problem.local[record][index].unknown, record_local[record][index]
            std = one.prior.std if one.prior is not None else width
            weight += (width / std) ** 2
            pull += width * d / std**2
            low, high = max(low, (d - one.upper) / width), min(high, (d - one.lower) / width)
        delta = float(np.clip(pull / weight, low, high))
        values[column] += delta
        for record, index, width in members:
            record_local[record][index] -= width * delta
        gained += 2.0 * pull * delta - weight * delta**2
    return (values, record_local, True) if gained > _BETTER else (shared, list(local), False)


def _members(problem: Problem, delay: str) -> list[tuple[int, int, float]]:
    """Record, index among its unknowns and ∂t/∂w (s) of each switch that `delay` moves; none if switches with
    different delays share an unknown."""
    members = []
    for number, (record, record_local) in enumerate(zip(problem.records, problem.local, strict=True)):
        moved = switch_shifts(record, [delay])[:, 0] if delay in LOGGER_DELAYS else np.zeros(0)
        if not moved.any():
            continue
        indices = {one.name: index for index, one in enumerate(record_local)}
        for k in np.flatnonzero(moved):
            index = indices.get(switch_name(int(k)))
            if index is None:
                return []
            members.append((number, index, float(moved[k])))
    return members


def _at(unknowns: Sequence[Unknown], values: Floats, index: int | None, share: float) -> Floats:
    """`values` with the one at `index` tried at `share` of its uncertainty."""
    if index is None:
        return values
    tried = values.copy()
    one = unknowns[index]
    middle, half = 0.5 * (one.lower + one.upper), 0.5 * (one.upper - one.lower)
    tried[index] = middle + share * half
    return tried


def _costs(problem: Problem, shared: Floats, local: Sequence[Floats]) -> Floats | None:
    """(records) χ² of each record with the priors of its unknowns; None if the model cannot be simulated."""
    blocks = problem.evaluate(shared, local, False)
    if isinstance(blocks, Refused):
        return None
    priors = [
        prior_rows(record_local, each)[0]
        for record_local, each in zip(problem.local_unknowns(), local, strict=True)
    ]
    return np.array(
        [block.residual @ block.residual + off @ off for block, off in zip(blocks, priors, strict=True)]
    )
