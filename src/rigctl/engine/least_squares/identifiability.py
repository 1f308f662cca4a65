"""Which parameters, and which combinations of them, the data do not determine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.block import Block

Floats = NDArray[np.float64]

#: a combination with a smaller singular value than this share of the largest is not determined by the data
WEAK = 1e-4
_MENTIONED, _NOTICEABLE = 0.1, 1e-3


@dataclass(frozen=True)
class Combination:
    """A direction in which all parameters can change together with hardly any change of the residuals.

    Attributes
    ----------
    singular_value: of the columns scaled to unit length, as a share of the largest one: 0 for a direction
        without any effect, 1 for uncorrelated parameters.
    parts: share of each parameter in it, largest first; a change of a parameter counts in units of its own
        effect on the residuals.
    changes: the changes that compensate for each other, in the parameters' own units, of all parameters with
        a noticeable share.
    """

    singular_value: float
    parts: tuple[tuple[str, float], ...]
    changes: tuple[tuple[str, float], ...] = ()

    def __str__(self) -> str:
        terms = " ".join(f"{share:+.2f}·{name}" for name, share in self.parts)
        return f"{terms} (singular value {self.singular_value:.1e})"


def null_columns(blocks: Sequence[Block], names: Sequence[str]) -> tuple[str, ...]:
    """The shared parameters that affect no residual, for example of an effect that needs another one."""
    squares = np.zeros(len(names))
    for block in blocks:
        if block.shared is not None:
            squares += np.square(block.shared).sum(axis=0)
    return tuple(name for name, square in zip(names, squares, strict=True) if not square > 0.0)


def weak_combinations(
    matrix: Floats,
    norms: Floats,
    names: Sequence[str],
    sizes: Floats | None = None,
    *,
    least: float = WEAK,
) -> tuple[Floats, tuple[Combination, ...]]:
    """Singular values of the shared parameters' columns, and the combinations that are too weak.

    Parameters
    ----------
    matrix: (rows, p) with the records' own parameters projected out.
    norms: (p) lengths of the columns before that, to which they are scaled.
    sizes: (p) by which the columns of `matrix` were divided already; 1 by default.
    least: a combination with a smaller singular value than this share of the largest is too weak.

    G. H. Golub, C. F. Van Loan, Matrix Computations, 5.5.7 (subset selection by SVD).
    """
    if not len(names):
        return np.empty(0), ()
    lengths = np.where(norms > 0.0, norms, 1.0)
    whole = lengths if sizes is None else lengths * sizes
    _, values, directions = np.linalg.svd(matrix / lengths, full_matrices=False)
    padded = np.zeros(len(names))
    padded[: values.size] = values
    largest = padded.max() or 1.0
    weak = []
    for index in range(values.size):
        share = values[index] / largest
        if share < least:
            parts = _parts(directions[index], names)
            changes = tuple(
                (name, float(share / size))
                for name, share, size in zip(names, directions[index], whole, strict=True)
                if abs(share) > _NOTICEABLE
            )
            weak.append(Combination(float(values[index] / largest), parts, changes))
    return padded / largest, tuple(weak)


def _parts(direction: Floats, names: Sequence[str]) -> tuple[tuple[str, float], ...]:
    # rounded, so that equal shares keep the order of the names
    order = np.argsort(-np.round(np.abs(direction), 6), kind="stable")
    sign = np.sign(direction[order[0]]) or 1.0
    return tuple(
        (names[index], float(sign * direction[index]))
        for index in order
        if abs(direction[index]) > _MENTIONED
    )
