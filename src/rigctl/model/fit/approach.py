"""Approach the minimum of a fit without being led astray by bad starting values.

Far from the minimum the misfit is thousands of sigmas: priors have no weight beside it, and the first steps
drive unimportant parameters anywhere, for example into a wrong cycle of the oscillations, from which later
steps do not return. So the noise is first assumed to be as large as the misfit, which keeps the priors in
proportion, and is reduced as the misfit decreases.
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

#: root mean square misfit in sigmas below which the actual noise is used
_NEAR = 1.5
#: a round must reduce the misfit to less than this share
_FALL = 0.95
_ROUNDS = 8
#: standard deviations from its prior beyond which a parameter may have been led astray
_FAR = 2.5
#: upper limit on the number of readings that count against the priors
_WEIGHT = 1000
_OPTIONS = Options(cost=1e-2, iterations=12)
#: assumed relative uncertainty of a parameter without a prior
_UNKNOWN = 1.0


def approach(
    evaluate: Evaluate,
    shared: Sequence[Unknown],
    local: Sequence[Sequence[Unknown]],
    progress: Callable[[Iteration], None] | None = None,
) -> tuple[list[Unknown], list[list[Unknown]]]:
    """The unknowns, starting where the misfit is small; unchanged if nothing reduces it."""
    starts, record_local = list(shared), [list(each) for each in local]
    # first what nothing is known of, with the others at their starts; then everything, from where that is
    # about right
    unknown = [k for k, one in enumerate(starts) if one.prior is None]
    everything = list(range(len(starts)))
    for moved in [part for part in (unknown, everything) if part]:
        starts, record_local = _descend(evaluate, starts, record_local, moved, progress)
        if len(moved) == len(everything):
            break
    return starts, record_local


def reset_to_priors(shared: Sequence[Unknown], values: Floats) -> list[Unknown] | None:
    """The unknowns starting at `values`, with those far from their priors reset; None if none is far."""
    priors = [unknown.prior for unknown in shared]
    far = [
        not unknown.linear and prior is not None and abs(value - prior.mean) > _FAR * prior.std
        for unknown, prior, value in zip(shared, priors, values, strict=True)
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
    """Rounds of a fit of the shared unknowns at `moved`, each with a noise as large as the misfit."""
    starts, record_local = list(shared), [list(each) for each in local]
    misfit, count = _misfit(evaluate, starts, record_local)
    for _ in range(_ROUNDS):
        if not _NEAR < misfit < math.inf:
            break
        at = np.array([one.start for one in starts])
        # with noise as large as the misfit a prior weighs as much beside a reading as it does at the end;
        # beside more than `_WEIGHT` readings that is nothing, so the noise grows with their number
        result = least_squares(
            _blurred(_part(evaluate, at, moved), misfit * max(1.0, math.sqrt(count / _WEIGHT))),
            [_held(starts[k]) for k in moved],
            record_local,
            options=_OPTIONS,
            progress=progress,
        )
        at[list(moved)] = result.values
        next_starts = started(starts, at)
        next_local = [started(each, values) for each, values in zip(record_local, result.local, strict=True)]
        # a round counts only if the misfit fell in the actual noise; one that fell little is the last one
        fallen, _ = _misfit(evaluate, next_starts, next_local)
        if fallen >= misfit:
            break
        done = fallen > _FALL * misfit
        starts, record_local, misfit = next_starts, next_local, fallen
        if done:
            break
    return starts, record_local


def _part(evaluate: Evaluate, at: Floats, moved: Sequence[int]) -> Evaluate:
    """Residuals as a function of the shared unknowns `moved`, with the others fixed `at` their values."""

    def part(shared: Floats, local: Sequence[Floats], derivatives: bool) -> Sequence[Block] | Refused:
        full = at.copy()
        full[list(moved)] = shared
        blocks = evaluate(full, local, derivatives)
        if isinstance(blocks, Refused):
            return blocks
        return [Block(block.residual, later=partial(_of_some, block, list(moved))) for block in blocks]

    return part


def _misfit(
    evaluate: Evaluate, shared: Sequence[Unknown], local: Sequence[Sequence[Unknown]]
) -> tuple[float, int]:
    """Root mean square of the whitened residuals, infinite if the model cannot be simulated; and their
    number."""
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
    """Residuals for noise `factor` times as large."""

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
    """With a loose prior about its start if it has none."""
    return unknown if unknown.prior else replace(unknown, prior=Prior(unknown.start, _UNKNOWN * unknown.size))
