"""The last evaluations of a problem, because a fit often starts where the previous one ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import Block

Floats = NDArray[np.float64]

#: largest number of derivative values in memory: more records are processed in parts
ROOM = 2**21
#: number of evaluations that are cached
_RECENT = 3


@dataclass(frozen=True)
class Evaluated:
    """Residuals with the requested derivatives, and the (n, outputs) of each record behind them."""

    blocks: list[Block]
    outputs: list[Floats]


class Recent:
    """The last evaluations of a problem, except those larger than the derivatives of one part.

    They are discarded after a fit (`Problem.fresh`), since a diagnosis keeps the problems of dozens of fits.
    """

    def __init__(self) -> None:
        self._entries: tuple[tuple[tuple[bytes, ...], bool, Evaluated], ...] = ()

    def at(self, point: tuple[bytes, ...], derivatives: bool) -> Evaluated | None:
        """The evaluation at `point`, if remembered; one with derivatives also serves requests without."""
        for known, complete, evaluated in self._entries:
            if known == point and (complete or not derivatives):
                return evaluated
        return None

    def keep(self, point: tuple[bytes, ...], columns: int, evaluated: Evaluated) -> None:
        """Store another evaluation, with derivatives by this number of columns."""
        if sum(block.residual.size for block in evaluated.blocks) * max(1, columns) <= ROOM:
            self._entries = ((point, columns > 0, evaluated), *self._entries[: _RECENT - 1])


def point_of(shared: Floats, local: Sequence[Floats]) -> tuple[bytes, ...]:
    """The key of the evaluation at a point."""
    return (shared.tobytes(), *(one.tobytes() for one in local))
