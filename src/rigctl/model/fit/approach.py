"""Come near the minimum of a fit without being led astray by a bad start.

Far from the minimum the misfit is thousands of sigmas: what is known beforehand weighs nothing beside it, and
the first steps drive parameters that matter little anywhere, into a wrong beat of the oscillations, say, from
which no later step finds out. So the noise is taken for as large as the misfit is, which keeps the priors in
proportion, and made smaller as the misfit falls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import (
    Block,
    Iteration,
    Options,
    Prior,
    Refused,
    Unknown,
    least_squares,
    started,
)
from rigctl.engine.least_squares.block import Derivatives, Evaluate

Floats = NDArray[np.float64]

#: misfit in sigmas, root mean square, from which on the noise is taken as it is
_NEAR = 1.5
#: a round must bring the misfit below this share of what it was
_FALL = 0.95
_ROUNDS = 8
#: standard deviations from what is known of it at which a parameter may have been led astray
_FAR = 2.5
#: as many readings at the most count beside what is known beforehand
_WEIGHT = 1000
_OPTIONS = Options(cost=1e-2, iterations=12)
#: how far a parameter of which nothing is known may be off, as a share of its size
_UNKNOWN = 1.0


def approach(
    evaluate: Evaluate,
    shared: Sequence[Unknown],
    local: Sequence[Sequence[Unknown]],
    progress: Callable[[Iteration], None] | None = None,
) -> tuple[list[Unknown], list[list[Unknown]]]:
    """The unknowns, begun where the misfit is small; as they were where nothing brings it down."""
    begun, record_local = list(shared), [list(each) for each in local]
    unknown = [k for k, one in enumerate(begun) if one.prior is None]
    everything = list(range(len(begun)))
    for moved in [part for part in (unknown, everything) if part]:
        begun, record_local = _descend(evaluate, begun, record_local, moved, progress)
        if len(moved) == len(everything):
            break
    return begun, record_local


def brought_back(shared: Sequence[Unknown], values: Floats) -> list[Unknown] | None:
    """The unknowns begun at `values`, those far from what is known of them there; None where none is far."""
    priors = [unknown.prior for unknown in shared]
    far = [
        prior is not None and abs(value - prior.mean) > _FAR * prior.std
        for prior, value in zip(priors, values, strict=True)
    ]
    if not any(far):
        return None
    back = [
        prior.mean if prior is not None and off else value
        for prior, off, value in zip(priors, far, values, strict=True)
    ]
    return started(shared, np.array(back))


def _descend(
    evaluate: Evaluate,
    shared: Sequence[Unknown],
    local: Sequence[Sequence[Unknown]],
    moved: Sequence[int],
    progress: Callable[[Iteration], None] | None,
) -> tuple[list[Unknown], list[list[Unknown]]]:
    """Rounds of a fit of the shared unknowns at `moved`, each in a noise as large as the misfit."""
    begun, record_local = list(shared), [list(each) for each in local]
    misfit, count = _misfit(evaluate, begun, record_local)
    for _ in range(_ROUNDS):
        if not _NEAR < misfit < math.inf:
            break
        at = np.array([one.start for one in begun])
        result = least_squares(
            _blurred(_part(evaluate, at, moved), misfit * max(1.0, math.sqrt(count / _WEIGHT))),
            [_held(begun[k]) for k in moved],
            record_local,
            options=_OPTIONS,
            progress=progress,
        )
        at[list(moved)] = result.values
        next_begun = started(begun, at)
        next_local = [started(each, values) for each, values in zip(record_local, result.local, strict=True)]
        fallen, _ = _misfit(evaluate, next_begun, next_local)
        if fallen >= misfit:
            break
        done = fallen > _FALL * misfit
        begun, record_local, misfit = next_begun, next_local, fallen
        if done:
            break
    return begun, record_local


def _part(evaluate: Evaluate, at: Floats, moved: Sequence[int]) -> Evaluate:
    """The same residuals of some of the shared unknowns, the others staying `at` their values."""

    def part(shared: Floats, local: Sequence[Floats], derivatives: bool) -> Sequence[Block] | Refused:
        whole = at.copy()
        whole[list(moved)] = shared
        blocks = evaluate(whole, local, derivatives)
        if isinstance(blocks, Refused):
            return blocks
        return [Block(block.residual, later=partial(_of_some, block, list(moved))) for block in blocks]

    return part


def _misfit(
    evaluate: Evaluate, shared: Sequence[Unknown], local: Sequence[Sequence[Unknown]]
) -> tuple[float, int]:
    """Root mean square of the whitened residuals, infinite where the model has no value; and their number."""
    blocks = evaluate(
        np.array([u.start for u in shared]),
        [np.array([u.start for u in record_local]) for record_local in local],
        False,
    )
    if isinstance(blocks, Refused):
        return math.inf, 0
    squares = sum(float(block.residual @ block.residual) for block in blocks)
    count = sum(block.residual.size for block in blocks)
    return math.sqrt(squares / max(1, count)), count


def _blurred(evaluate: Evaluate, factor: float) -> Evaluate:
    """The same residuals in a noise that is `factor` times as large."""

    def blurred(shared: Floats, local: Sequence[Floats], derivatives: bool) -> Sequence[Block] | Refused:
        blocks = evaluate(shared, local, derivatives)
        if isinstance(blocks, Refused):
            return blocks
        return [_divided(block, factor) for block in blocks]

    return blurred


def _divided(block: Block, factor: float) -> Block:
    return Block(block.residual / factor, later=partial(_slopes_divided, block, factor))


def _slopes_divided(block: Block, factor: float) -> Derivatives:
    return (
        None if block.shared is None else block.shared / factor,
        None if block.local is None else block.local / factor,
    )


def _of_some(block: Block, moved: list[int]) -> Derivatives:
    return None if block.shared is None else block.shared[:, moved], block.local


def _held(unknown: Unknown) -> Unknown:
    """With a loose prior about its start where nothing else is known."""
    return unknown if unknown.prior else replace(unknown, prior=Prior(unknown.start, _UNKNOWN * unknown.size))
