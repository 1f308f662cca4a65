"""What a row says of the record it belongs to: a number, a name, or that it belongs to none."""

from __future__ import annotations

import math
from typing import Final

from rigctl.dataset.importing.table import MISSING

#: id of a row that belongs to no record, and of one whose label cannot be
BETWEEN: Final = -1
IMPOSSIBLE: Final = -2

#: number of a record, or its name
Label = float | str


class LabelBook:
    """Gives every record of a file an id, in the order in which they first appear."""

    def __init__(self) -> None:
        self._ids: dict[Label, int] = {}
        self.labels: list[Label] = []  #: by id

    def id_of(self, text: str, *, named: bool = False) -> int:
        """The id of a label; `BETWEEN` for a missing or negative one, `IMPOSSIBLE` for half a number.

        Parameters
        ----------
        named: the text is the name of a group, and a number is a name too.
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
    """A number where the text is one, so that ``1``, ``01`` and ``1.0`` are one record; None for none."""
    written = text.strip()
    if written in MISSING:
        return None
    try:
        number = float(written)
    except ValueError:
        return written
    if math.isnan(number) or number < 0.0:
        return None
    return number if math.isfinite(number) else 0.5


def describe_label(label: Label) -> str:
    """A record as the file calls it: ``record 4``, ``record H1_000_010``."""
    return f"record {label:g}" if isinstance(label, float) else f"record {label}"
