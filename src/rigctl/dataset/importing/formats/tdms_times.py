"""The times of LabVIEW's waveform channels: equidistant from ``wf_start_time`` on, in one or several parts.

A program that was stopped and appends to the same channels writes ``wf_start_time`` anew. A file stores only
the last value with a channel, but each of its segments contains those that were written with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Waveform:
    """The times of one channel.

    Parameters
    ----------
    step: time between two samples, s.
    offset: of the first sample of a part, s.
    parts: first sample of each part, and its start in ns since 1970 UTC; None if it is unknown.
    """

    step: float
    offset: float
    parts: tuple[tuple[int, int | None], ...]

    @property
    def origin(self) -> int | None:
        """The start of the first part, ns since 1970 UTC."""
        return self.parts[0][1]

    def nanoseconds(self, start: int, stop: int) -> NDArray[np.int64]:
        """Return the times of some samples: since 1970 UTC, or since zero if the start is unknown."""
        rows = np.arange(start, stop, dtype=np.int64)
        firsts = np.array([first for first, _ in self.parts], dtype=np.int64)
        begins = np.array([began or 0 for _, began in self.parts], dtype=np.int64)
        part = np.searchsorted(firsts, rows, side="right") - 1
        seconds = self.offset + self.step * (rows - firsts[part])
        return np.asarray(begins[part] + np.round(seconds * 1e9).astype(np.int64), dtype=np.int64)


def starts_of_parts(raw: IO[bytes]) -> dict[str, list[tuple[int, int]]]:
    """Return, by the path of a channel, the first sample and the ``wf_start_time`` of each part of its data.

    Times are nanoseconds since 1970 UTC.
    """
    from nptdms.reader import TdmsReader

    segments: list[tuple[Any, Mapping[str, Sequence[tuple[str, Any]]]]] = []

    class Listening(TdmsReader):  # type: ignore[misc]
        def _read_segment_metadata(self, *arguments: Any, **more: Any) -> Any:
            segment, properties = super()._read_segment_metadata(*arguments, **more)
            segments.append((segment, properties or {}))
            return segment, properties

    Listening(raw).read_metadata()
    rows: dict[str, int] = {}
    starts: dict[str, list[tuple[int, int]]] = {}
    for segment, properties in segments:
        for path, pairs in properties.items():
            began = dict(pairs).get("wf_start_time")
            if began is None:
                continue
            moment = int(began.as_datetime64("ns").astype(np.int64))
            known = starts.setdefault(path, [])
            if not known or known[-1][1] != moment:
                known.append((rows.get(path, 0), moment))
        for item in segment.ordered_objects:
            if item.has_data:
                rows[item.path] = rows.get(item.path, 0) + item.number_values * segment.num_chunks
    return {path: _of_data(known) for path, known in starts.items()}


def _of_data(starts: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the last start before each part: properties may be written before the data, and again."""
    by_row = dict(starts)
    return [(0, by_row[min(by_row)]), *((row, began) for row, began in by_row.items() if row > min(by_row))]
