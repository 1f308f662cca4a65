"""What a reading outside the possible range of its channel counts as: no value."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rigctl.rig.rig import Rig


class PossibleReadings:
    """The rows of a bench with NaN for every reading outside its channel's `range`.

    Such a reading contains no information on the measured quantity: a wire is loose, or a digit was lost on
    the line. Rows are ``(time, record, *channels, *commands)``, SI. A possible row is returned as it is,
    after about 50 ns for each channel; in the row of one of several devices the others have no value anyway.
    """

    def __init__(self, rig: Rig) -> None:
        columns = {name: index for index, name in enumerate(rig.layout.columns)}
        self._bands = {
            device: tuple((columns[name], *channel.band) for name, channel in part.channels.items())
            for device, part in {**rig.parts, "": rig}.items()
        }

    def of(self, row: tuple[float, ...], device: str = "") -> tuple[float, ...]:
        """Return `row`, with NaN for every impossible reading; of one `device`, if only that was read."""
        for column, low, high in self._bands[device]:
            if not low <= row[column] <= high:
                return self._without(row)
        return row

    def _without(self, row: Iterable[float]) -> tuple[float, ...]:
        values = list(row)
        for column, low, high in self._bands[""]:
            if not low <= values[column] <= high:
                values[column] = math.nan
        return tuple(values)
