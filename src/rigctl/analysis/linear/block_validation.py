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
    """Mean squared errors, in units of the noise, of the blocks left out: without and with the effects.

    Attributes
    ----------
    before, after: of each block.
    ahead: of the second half, by fits to the first; None if that was not tried, or is not possible.
    """

    before: tuple[float, ...]
    after: tuple[float, ...]
    ahead: tuple[float, float] | None = None

    @property
    def passed(self) -> bool:
        """Whether the error outside the fit falls, over all blocks and in most of them."""
        better = sum(after < before for before, after in zip(self.before, self.after, strict=True))
        return sum(self.after) < _FALLS * sum(self.before) and 2 * better > len(self.before)

    @property
    def falls(self) -> bool:
        """Whether the sum of the errors falls, that of the second half included."""
        ahead = self.ahead or (0.0, 0.0)
        return sum(self.after) + ahead[1] < sum(self.before) + ahead[0]

    @property
    def ratio(self) -> float:
        """The root mean square error outside the fit with the effects, as a share of that without."""
        return float(np.sqrt(sum(self.after) / max(sum(self.before), 1e-300)))


def leave_blocks_out(
    without: FitResult, with_effects: FitResult, *, ahead: bool = False
) -> BlockValidation | None:
    """Both models fitted to the readings outside each block in turn; None if that is not possible.

    `ahead`: the second half of the records is left out as well.
    """
    count = sum(int(good.sum()) for good in without.problem.ok)
    every = [range(block, block + 1) for block in ([2] if count > _MANY else range(1, _BLOCKS))]
    tried = [pair for blocks in every if (pair := _errors_outside(without, with_effects, blocks)) is not None]
    if not tried:
        return None
    rest = _errors_outside(without, with_effects, range(_BLOCKS // 2, _BLOCKS)) if ahead else None
    return BlockValidation(tuple(pair[0] for pair in tried), tuple(pair[1] for pair in tried), rest)


def _errors_outside(without: FitResult, with_effects: FitResult, blocks: range) -> tuple[float, float] | None:
    """The errors of both models on blocks that are left out of their fits; None without a fit."""
    before = _error_outside(without, blocks)
    after = None if before is None else _error_outside(with_effects, blocks)
    return None if before is None or after is None else (before, after)


def _error_outside(fitted: FitResult, blocks: range) -> float | None:
    """Mean squared error of some blocks of every fitted record, by a fit to the rest; None without a fit."""
    problem = fitted.problem
    masks = [_inside(record.times.size, blocks) for record in problem.records]
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


def _inside(count: int, blocks: range) -> NDArray[np.bool_]:
    """(count) which samples of a record are in one of these blocks."""
    return np.isin(np.arange(count) * _BLOCKS // max(count, 1), blocks)
