"""The contribution of one record to a fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError

Floats = NDArray[np.float64]


#: derivatives by the shared parameters (n, p), and by the record's own (n, m)
Derivatives: TypeAlias = tuple[Floats | None, Floats | None]


class Block:
    """The residuals of one record, in units of their standard deviation, and their derivatives.

    Attributes
    ----------
    residual: (n).
    shared: (n, p) by the shared parameters; None if derivatives were not requested.
    local: (n, m) by the record's own parameters; None likewise.

    Derivatives given as `later` are computed when they are first used: those of a rejected step never are.
    """

    def __init__(
        self,
        residual: Floats,
        shared: Floats | None = None,
        local: Floats | None = None,
        *,
        later: Callable[[], Derivatives] | None = None,
    ) -> None:
        self.residual = residual
        self._derivatives: Derivatives = shared, local
        self._later = later

    @property
    def shared(self) -> Floats | None:
        """(n, p) by the shared parameters."""
        return self._complete()[0]

    @property
    def local(self) -> Floats | None:
        """(n, m) by the record's own parameters."""
        return self._complete()[1]

    def _complete(self) -> Derivatives:
        later = self._later
        if later is not None:
            self._derivatives, self._later = later(), None
        return self._derivatives


@dataclass(frozen=True)
class Refused:
    """The model cannot be simulated with these parameters: the step that led there is rejected."""

    reason: str


#: ``evaluate(shared, local, derivatives)``: the shared values (p), the records' own values (m each), and
#: whether derivatives are wanted; returns one block for each record, in the same order at every call
Evaluate: TypeAlias = Callable[[Floats, Sequence[Floats], bool], Sequence[Block] | Refused]


def check_count(blocks: Sequence[Block], count: int) -> None:
    """Require a block for each record.

    Raises
    ------
    RigctlError
        there are more or fewer.
    """
    if len(blocks) != count:
        raise RigctlError(f"the fit returned {len(blocks)} records", expected=str(count))


def check_block(block: Block, number: int, shared: int, local: int) -> None:
    """Require derivatives by `shared` and `local` parameters, all of them finite.

    Raises
    ------
    RigctlError
        they are missing or not finite; the message names the record by its `number`.
    """
    n = block.residual.size
    for kind, derivatives, columns in (
        ("shared", block.shared, shared),
        ("record-level", block.local, local),
    ):
        if columns and (derivatives is None or derivatives.shape != (n, columns)):
            shape = None if derivatives is None else derivatives.shape
            raise RigctlError(
                f"record {number}: derivatives by the {kind} parameters have the shape {shape}",
                expected=str((n, columns)),
            )
        if derivatives is not None and not np.isfinite(derivatives).all():
            raise RigctlError(f"record {number}: a derivative by the {kind} parameters is not finite")
