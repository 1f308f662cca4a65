"""Measurements that are there twice: counted twice, or held out of a fit that has seen them.

Two records share samples if, with a shift between their times, one continues or lies within the other: two
exports of one log that overlap, two formats of one file, one log divided at other places. Wherever both have
samples their readings and recorded inputs are then the same, but for a few that somebody edited. `_ALIKE`
readings that are the same although the channel changes between most of them are more than chance: noise does
not repeat.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.model.measured.record import Floats, Integers, MeasuredRecord, Measurements

#: consecutive readings that are alike by more than chance, and the fewest changes among them
_ALIKE: Final = 20
_CHANGES: Final = 10
#: rows of tables that are alike, in order, by more than chance
_ROWS: Final = 5
#: digits that are compared: two imports of one measurement may round differently in the last ones
_DIGITS: Final = 10
#: tolerance of times, as a share of the sampling interval
_TIME: Final = 1e-3
#: share of the common samples that are the same: a few may have been edited
_SAME: Final = 0.95
#: factor of the polynomial that is the key of a window
_FACTOR: Final = np.uint64(0x9E3779B97F4A7C15)


Samples = NDArray[np.bool_]


@dataclass(frozen=True)
class Copies:
    """Which records repeat others.

    Attributes
    ----------
    whole: for each record that repeats another one, that other one, which counts.
    parts: for each record of which a part is also in another one, that other one and (n) whether a sample is.
    """

    whole: Mapping[int, int]
    parts: Mapping[int, tuple[int, Samples]]


def copies_in(measurements: Measurements, preferred: Sequence[int]) -> Copies:
    """Return the records that repeat others, in whole or in part.

    Parameters
    ----------
    preferred: indices of the records whose samples are to be kept rather than those of their copies, in
        order: first those that a fit sees.
    """
    # cheap first: windows of readings by their keys name the pairs that may be copies, each of which is then
    # compared sample by sample
    records = measurements.records
    order = list(dict.fromkeys((*preferred, *range(len(records)))))
    place = {index: at for at, index in enumerate(order)}
    whole = dict(_equal_rows(measurements, order))
    windows = _Windows(measurements)
    suspects = sorted(sorted(pair, key=place.__getitem__) for pair in windows.suspects())
    overlaps = []
    # in order of preference, so that what a fit sees is kept; a copy of a copy has gone already
    for kept, copy in sorted(suspects, key=lambda pair: (place[pair[0]], place[pair[1]])):
        if kept in whole or copy in whole:
            continue
        shared = _shared(measurements, kept, copy, windows.shift(kept, copy))
        if shared is None:
            continue
        if _all_known(records[copy], shared[1]):
            whole[copy] = kept
        else:
            overlaps.append((kept, copy, shared))
    return Copies(dict(sorted(whole.items())), _parts(records, overlaps, whole))


def _parts(
    records: Sequence[MeasuredRecord],
    overlaps: Sequence[tuple[int, int, tuple[Integers, Integers]]],
    whole: Collection[int],
) -> dict[int, tuple[int, Samples]]:
    """Return which samples of which records are left out, so that those of each overlap remain once."""
    parts: dict[int, tuple[int, Samples]] = {}
    for kept, copy, (of_kept, of_copy) in overlaps:
        if kept in whole or copy in whole:
            continue
        one, other, mine, theirs = copy, kept, of_copy, of_kept
        if of_copy[0] == 0 and of_kept[0] > 0 and of_kept[-1] == records[kept].times.size - 1:
            # the end of the earlier one rather than the beginning, with its initial values, of the later one
            one, other, mine, theirs = kept, copy, of_kept, of_copy
        # what the other one has lost to a third must stay here, or nobody would have it
        if other in parts:
            mine = mine[~parts[other][1][theirs]]
        known = parts[one][1] if one in parts else np.zeros(records[one].times.size, dtype=bool)
        parts[one] = (other, known | np.isin(np.arange(known.size), mine))
    return dict(sorted(parts.items()))


def _all_known(record: MeasuredRecord, shared: Integers) -> bool:
    """Whether hardly anything remains of a record without these samples."""
    rest = record.here.any(axis=1) & ~np.isin(np.arange(record.times.size), shared)
    return bool(rest.sum() <= (1.0 - _SAME) * rest.size)


def each_once(measurements: Measurements, copies: Copies) -> tuple[Measurements, list[int]]:
    """Return the measurements with each sample once, and the indices of the remaining records."""
    records = list(measurements.records)
    for index, (_, shared) in copies.parts.items():
        values = records[index].values.copy()
        values[shared] = np.nan
        records[index] = replace(records[index], values=values)
    kept = [index for index in range(len(records)) if index not in copies.whole]
    return replace(measurements, records=tuple(records)).only(kept), kept


def copy_notes(records: Sequence[MeasuredRecord], copies: Copies, held_out: Collection[int]) -> Iterator[str]:
    """Yield a remark on the copies of fitted records that were to be held out, and one on the others."""
    by_reason: dict[str, list[str]] = {}
    for copy, original in copies.whole.items():
        seen = copy in held_out and original not in held_out
        why = "it is not held out, as the fit has seen them" if seen else "it counts once"
        repeats = f"{records[copy].label} has the same samples as {records[original].label}"
        by_reason.setdefault(why, []).append(repeats)
    for why, (first, *more) in by_reason.items():
        others = f", as {len(more)} more are copies" if more else ""
        yield f"{first}{others}: {why}"
    for part, (other, shared) in copies.parts.items():
        times = records[part].times[shared]
        span = f"from {times[0]:.6g} s to {times[-1]:.6g} s"
        yield (
            f"{records[part].label} has {times.size} samples, {span}, that are in {records[other].label} "
            "too: they count once"
        )


def _equal_rows(measurements: Measurements, order: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield rows of tables that are the same, in the same order, as rows of another table, and those."""
    tables: dict[str, list[int]] = {}
    for index in order:
        record = measurements.records[index]
        if record.row:
            tables.setdefault(record.run, []).append(index)
    rows = [sorted(of_run) for of_run in tables.values()]
    keys = [[_row_key(measurements.records[index]) for index in of_run] for of_run in rows]
    copied: set[int] = set()
    for later, earlier in ((k, j) for k in range(len(rows)) for j in range(k)):
        a, b = keys[earlier], keys[later]
        fewest = 1 if a == b else _ROWS
        for block in SequenceMatcher(None, a, b, autojunk=False).get_matching_blocks():
            for k in range(block.size if block.size >= fewest else 0):
                one, other = rows[earlier][block.a + k], rows[later][block.b + k]
                if not copied & {one, other}:
                    copied.add(other)
                    yield other, one


def _row_key(record: MeasuredRecord) -> bytes:
    numbers = [*record.values.ravel(), *record.inputs.ravel(), *record.beside.values()]
    return np.array([float(f"{number:.{_DIGITS}g}") for number in numbers]).tobytes()


class _Windows:
    """Keys of `_ALIKE` consecutive readings of a channel, of all records over time."""

    def __init__(self, measurements: Measurements) -> None:
        self._keys: list[list[NDArray[np.uint64]]] = []  # by channel and record
        self._times: list[list[Floats]] = []
        self._whole: list[list[bytes]] = []
        for column in range(len(measurements.outputs)):
            scale = _scale(measurements, column)
            found = [_windows(record, column, scale) for record in measurements.records]
            self._keys.append([keys for keys, _, _ in found])
            self._times.append([times for _, times, _ in found])
            self._whole.append([whole for _, _, whole in found])

    def suspects(self) -> set[tuple[int, int]]:
        """Pairs of records that have a window in common, or all readings of a channel that moves."""
        pairs: set[tuple[int, int]] = set()
        for keys, whole in zip(self._keys, self._whole, strict=True):
            # sorted by key, equal ones of different records are neighbours
            owner = np.repeat(np.arange(len(keys)), [one.size for one in keys])
            key = np.concatenate([np.empty(0, dtype=np.uint64), *keys])
            by_key = np.lexsort((owner, key))
            key, owner = key[by_key], owner[by_key]
            twice = np.flatnonzero((key[1:] == key[:-1]) & (owner[1:] != owner[:-1]))
            found = np.unique(np.column_stack([owner[twice], owner[twice + 1]]), axis=0)
            pairs.update((int(one), int(other)) for one, other in found)
            first: dict[bytes, int] = {}
            for index, content in enumerate(whole):
                if content and first.setdefault(content, index) != index:
                    pairs.add((first[content], index))
        return pairs

    def shift(self, one: int, other: int) -> float:
        """By how much the times of the other record are later, s, by most of their common windows."""
        shifts = [np.empty(0)]
        for keys, times in zip(self._keys, self._times, strict=True):
            _, at, beside = np.intersect1d(keys[one], keys[other], return_indices=True)
            shifts.append(times[other][beside] - times[one][at])
        every = np.concatenate(shifts)
        return float(np.median(every)) if every.size else 0.0


def _windows(record: MeasuredRecord, column: int, scale: float) -> tuple[NDArray[np.uint64], Floats, bytes]:
    """Return the keys of the windows in which most readings change, their times, and a key of all readings.

    Without a change the last one is empty, and so is everything of a row of a table.
    """
    here = np.isfinite(record.values[:, column])
    values = np.round(record.values[here, column] / scale, _DIGITS) + 0.0  # no negative zeros
    count = values.size - _ALIKE + 1
    if record.row or count <= 0:
        return np.empty(0, dtype=np.uint64), np.empty(0), b""
    # a polynomial in the bits of consecutive readings, modulo 2⁶⁴: one pass for each reading of a window,
    # instead of one comparison for each pair of records. The shift is for round numbers, whose low bits are
    # zero: they would use a part of the key only
    bits = values.view(np.uint64)
    key = np.zeros(count, dtype=np.uint64)
    for offset in range(_ALIKE):
        piece = bits[offset : offset + count]
        key = key * _FACTOR + (piece ^ (piece >> np.uint64(29)))
    changes = np.concatenate([[0], np.cumsum(np.diff(values) != 0.0)])
    distinct = changes[_ALIKE - 1 :] - changes[:count] >= _CHANGES
    whole = hashlib.sha256(values.tobytes()).digest() if changes[-1] else b""
    return key[distinct], record.times[here][:count][distinct], whole


def _scale(measurements: Measurements, column: int) -> float:
    """A power of ten above all values of a channel."""
    largest = [float(np.nanmax(np.abs(one.values[:, column]), initial=0.0)) for one in measurements.records]
    return float(10.0 ** np.ceil(np.log10(max(largest)))) if max(largest, default=0.0) > 0.0 else 1.0


def _shared(
    measurements: Measurements, one: int, other: int, shift: float
) -> tuple[Integers, Integers] | None:
    """Return which samples of two records are the same ones; None if these are two measurements.

    What both have in common at this shift begins with one of them and ends with one of them: records that are
    alike only for a while are those of a bench without noise.
    """
    a, b = measurements.records[one], measurements.records[other]
    step = float(np.median(np.diff(a.times)))
    # the samples of both at the same time, within the rounding of times
    at = np.searchsorted(b.times, a.times + shift - _TIME * step)
    matched = at < b.times.size
    matched[matched] &= np.abs(b.times[at[matched]] - a.times[matched] - shift) <= _TIME * step
    of_a = np.flatnonzero(matched)
    of_b = at[of_a]
    same, moves = _agreement(measurements, a, b, of_a, of_b)
    # how many samples they should have in common, from where the later one begins to where the first one ends
    begin, end = max(0.0, -shift) - 0.5 * step, min(a.times[-1], b.times[-1] - shift) + 0.5 * step
    common = min(int(((begin <= t) & (t <= end)).sum()) for t in (a.times, b.times - shift))
    if not moves or same.sum() < max(_ALIKE, _SAME * common):
        return None
    return of_a[same], of_b[same]


def _agreement(
    measurements: Measurements, a: MeasuredRecord, b: MeasuredRecord, of_a: Integers, of_b: Integers
) -> tuple[Samples, bool]:
    """Return which of the common samples are the same, and whether a channel moves among these."""
    same, seen, moves = np.ones(of_a.size, dtype=bool), np.zeros(of_a.size, dtype=bool), False
    for column in range(len(measurements.outputs)):
        x, y = a.values[of_a, column], b.values[of_b, column]
        both = np.isfinite(x) & np.isfinite(y)
        close = np.abs(x - y) <= 10.0**-_DIGITS * _scale(measurements, column)
        same &= close | ~both
        seen |= both
        alike = x[both & close]
        moves |= alike.size >= _ALIKE and bool(np.ptp(alike) > 0.0)
    for index, name in enumerate(measurements.inputs):
        if name not in a.unrecorded and name not in b.unrecorded:
            x, y = a.input_course(index)[of_a], b.input_course(index)[of_b]
            same &= np.abs(x - y) <= 1e-9 * float(np.abs(x).max(initial=1e-300))
    return same & seen, moves
