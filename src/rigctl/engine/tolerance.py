"""The accuracy of an integration."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerance:
    """The permitted error of one step in state i: ``absolute·scale_i + relative·|y_i|``.

    `absolute` is a fraction of each state's natural scale (`system.State`).
    """

    relative: float
    absolute: float


#: for fitting and diagnosis
DEFAULT = Tolerance(relative=1e-5, absolute=1e-2)

#: for checks and references: about a hundred times as accurate, for two to three times the time
TIGHT = Tolerance(relative=1e-7, absolute=1e-4)
