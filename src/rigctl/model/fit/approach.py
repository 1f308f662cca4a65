"""Come near the minimum of a fit without being led astray by a bad start.

Far from the minimum the misfit is thousands of sigmas: what is known beforehand weighs nothing beside it, and
the first steps drive parameters that matter little anywhere, into a wrong beat of the oscillations, say, from
which no later step finds out. So the noise is taken for as large as the misfit is, which keeps the priors in
proportion, and made smaller as the misfit falls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import Block, Iteration, Options, Prior, Refused, Unknown, least_squares
from rigctl.engine.least_squares.block import Evaluate

Floats = NDArray[np.float64]

#: misfit in sigmas, root mean square, from which on the noise is taken as it is
_NEAR = 1.5
#: a round must bring the misfit below this share of what it was
_FALL = 0.95
_ROUNDS = 8
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
    begun, own = list(shared), [list(each) for each in local]
    misfit = _misfit(evaluate, begun, own)
    for _ in range(_ROUNDS):
        if misfit is None or misfit < _NEAR:
            break
        found = least_squares(
            _blurred(evaluate, misfit), [_held(u) for u in begun], own, options=_OPTIONS, progress=progress
        )
        next_begun = _started(begun, found.values)
        next_own = [_started(each, values) for each, values in zip(own, found.local, strict=True)]
        fallen = _misfit(evaluate, next_begun, next_own)
        if fallen is None or fallen >= misfit:
            break
        done = fallen > _FALL * misfit
        begun, own, misfit = next_begun, next_own, fallen
        if done:
            break
    return begun, own


def _misfit(
    evaluate: Evaluate, shared: Sequence[Unknown], local: Sequence[Sequence[Unknown]]
) -> float | None:
    """Root mean square of the whitened residuals; None where the model has no value."""
    blocks = evaluate(
        np.array([u.start for u in shared]), [np.array([u.start for u in own]) for own in local], False
    )
    if isinstance(blocks, Refused):
        return None
    squares = sum(float(block.residual @ block.residual) for block in blocks)
    return float(np.sqrt(squares / max(1, sum(block.residual.size for block in blocks))))


def _blurred(evaluate: Evaluate, factor: float) -> Evaluate:
    """The same residuals in a noise that is `factor` times as large."""

    def blurred(shared: Floats, local: Sequence[Floats], derivatives: bool) -> Sequence[Block] | Refused:
        blocks = evaluate(shared, local, derivatives)
        if isinstance(blocks, Refused):
            return blocks
        return [_divided(block, factor) for block in blocks]

    return blurred


def _divided(block: Block, factor: float) -> Block:
    return Block(
        block.residual / factor,
        None if block.shared is None else block.shared / factor,
        None if block.local is None else block.local / factor,
    )


def _held(unknown: Unknown) -> Unknown:
    """With a loose prior about its start where nothing else is known."""
    return unknown if unknown.prior else replace(unknown, prior=Prior(unknown.start, _UNKNOWN * unknown.size))


def _started(unknowns: Sequence[Unknown], values: Floats) -> list[Unknown]:
    return [
        replace(u, start=min(max(float(v), u.lower), u.upper)) for u, v in zip(unknowns, values, strict=True)
    ]
