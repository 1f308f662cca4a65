"""Do effects improve the prediction of readings that they were not fitted to? Blocks of time are left out.

Records with the same conditions, or a single one, cannot be left out in turn. A quarter of every record can:
the model is fitted with and without the effects to the rest, and both predict it. The first quarter is never
left out, because the initial states would then be extrapolated backwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import started
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit

#: number of blocks of a record
_BLOCKS = 4
#: number of readings beyond which only one block is left out
_MANY = 20_000
#: the squared error outside the fit must fall below this share of that without the effects
_FALLS = 0.97
#: a fit of fewer readings ends when the next step would lower the cost by less than this share
_COST = 1e-3


@dataclass(frozen=True)
class BlockValidation:
    """Mean squared errors, in units of the noise, of the blocks left out: without and with the effects."""

    before: tuple[float, ...]
    after: tuple[float, ...]

    @property
    def passed(self) -> bool:
        """Whether the error outside the fit falls, over all blocks and in most of them."""
        better = sum(after < before for before, after in zip(self.before, self.after, strict=True))
        return sum(self.after) < _FALLS * sum(self.before) and 2 * better > len(self.before)

    @property
    def ratio(self) -> float:
        """The root mean square error outside the fit with the effects, as a share of that without."""
        return float(np.sqrt(sum(self.after) / max(sum(self.before), 1e-300)))


def leave_blocks_out(without: FitResult, with_effects: FitResult) -> BlockValidation | None:
    """Both models fitted to the readings outside each block in turn; None if that is not possible."""
    count = sum(int(good.sum()) for good in without.problem.ok)
    chosen = [2] if count > _MANY else range(1, _BLOCKS)
    before, after = [], []
    for block in chosen:
        errors = [_error_outside(one, block) for one in (without, with_effects)]
        if errors[0] is None or errors[1] is None:
            continue
        before.append(errors[0])
        after.append(errors[1])
    return BlockValidation(tuple(before), tuple(after)) if before else None


def _error_outside(fitted: FitResult, block: int) -> float | None:
    """Mean squared error of one block of every fitted record, by a fit to the rest; None without a fit."""
    problem = fitted.problem
    masks = [_block_of(record.times.size, block) for record in problem.records]
    inside = tuple(good & ~mask[:, None] for good, mask in zip(problem.ok, masks, strict=True))
    kept = replace(problem, ok=inside).whitened()
    kept = kept.with_shared(started(kept.shared, fitted.values))
    with suppress(RigctlError):  # the model cannot be simulated on the way
        again = fit(kept, fitted.held_out, local=fitted.local, cost=_COST)
        return _mean_square(fitted, again, masks)
    return None


def _mean_square(fitted: FitResult, again: FitResult, masks: Sequence[NDArray[np.bool_]]) -> float | None:
    problem = fitted.problem
    squares = [
        ((again.outputs[k] - problem.records[k].values) / problem.sigma[k])[problem.ok[k] & masks[k][:, None]]
        ** 2
        for k in fitted.fitted
    ]
    together = np.concatenate(squares)
    return float(np.mean(together)) if together.size else None


def _block_of(count: int, block: int) -> NDArray[np.bool_]:
    """(count) which samples of a record are in a block."""
    return np.asarray(np.arange(count) * _BLOCKS // max(count, 1) == block)
