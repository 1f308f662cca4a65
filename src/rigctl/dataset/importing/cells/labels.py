"""The record label of a row: a number, a name, or none."""

from __future__ import annotations

import math
from typing import Final

from rigctl.dataset.importing.cells.missing_values import MISSING

#: id of a row outside all records, and of one with an impossible label
BETWEEN: Final = -1
IMPOSSIBLE: Final = -2

#: whole numbers up to this one differ from each other in floating point
LARGEST: Final = 2.0**53 - 1.0

#: number of a record, or its name
Label = float | str


class LabelBook:
    """Assigns an id to every record of a file, in order of first appearance."""

    def __init__(self) -> None:
        self._ids: dict[Label, int] = {}
        self.labels: list[Label] = []  #: by id

    def id_of(self, text: str, *, named: bool = False) -> int:
        """Return the id of a label; `BETWEEN` for a missing or negative one, `IMPOSSIBLE` for a fraction.

        Parameters
        ----------
        named: the text is the name of a group, so that a number is a name too.
        """
        label = text if named else read_label(text)
        if label is None:
            return BETWEEN
        if isinstance(label, float) and not label.is_integer():
            return IMPOSSIBLE
        known = self._ids.setdefault(label, len(self.labels))
        if known == len(self.labels):
            self.labels.append(label)
        return known


def read_label(text: str) -> Label | None:
    """Return a number if the text is one, so that ``1`` and ``01`` are one record; None without a label.

    ``1_1`` is a name, and so is a number too large for its neighbours to differ from it.
    """
    written = text.strip()
    if written in MISSING:
        return None
    if "_" in written:  # which Python accepts between digits
        return written
    try:
        number = float(written)
    except ValueError:
        return written
    if math.isnan(number) or number < 0.0:
        return None
    if not math.isfinite(number):
        return 0.5
    return number if number <= LARGEST else written


def describe_label(label: Label) -> str:
    """Describe a record by its label: ``record 4``, ``record H1_000_010``."""
    return f"record {label:.0f}" if isinstance(label, float) else f"record {label}"
