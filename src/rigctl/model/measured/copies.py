"""Records with the same readings: counted twice, or held out of a fit that has seen them."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from rigctl.model.measured.record import Floats, MeasuredRecord, Measurements

#: readings that are alike by more than chance, of a channel that moves
_ALIKE: Final = 20
#: digits that are compared: two imports of one measurement may round differently in the last ones
_DIGITS: Final = 10
#: rounding of the times, s
_TIME: Final = 9


def copies_in(measurements: Measurements, preferred: Sequence[int]) -> dict[int, int]:
    """Return the indices of the records that repeat another one, and that other one, which counts.

    A copy has the same times, and the same readings and recorded inputs wherever both records have some; a
    channel that moves must be among them. Rows of a table are none: two of them may agree by chance.

    Parameters
    ----------
    preferred: indices of the records to be kept rather than their copies, in order: first those that a fit
        sees.
    """
    records, inputs = measurements.records, measurements.inputs
    digests = [{} if record.row else dict(_digests(record, inputs)) for record in records]
    found: dict[bytes, list[int]] = {}
    copies: dict[int, int] = {}
    for index in dict.fromkeys((*preferred, *range(len(records)))):
        moving = [digest for digest, moves in digests[index].values() if moves]
        known = sorted({other for digest in moving for other in found.get(digest, ())})
        original = next((other for other in known if _agree(digests[index], digests[other])), None)
        if original is not None:
            copies[index] = original
            continue
        for digest in moving:
            found.setdefault(digest, []).append(index)
    return dict(sorted(copies.items()))


def copy_notes(
    records: Sequence[MeasuredRecord], copies: Mapping[int, int], held_out: Collection[int]
) -> Iterator[str]:
    """Yield a remark on the copies of fitted records that were to be held out, and one on the others."""
    told: dict[str, list[str]] = {}
    for copy, original in copies.items():
        seen = copy in held_out and original not in held_out
        why = "it is not held out, as the fit has seen them" if seen else "it counts once"
        repeats = f"{records[copy].label} has the same samples as {records[original].label}"
        told.setdefault(why, []).append(repeats)
    for why, (first, *more) in told.items():
        others = f", as {len(more)} more are copies" if more else ""
        yield f"{first}{others}: {why}"


def _digests(record: MeasuredRecord, inputs: Sequence[str]) -> Iterator[tuple[str, tuple[bytes, bool]]]:
    """Yield a digest of each channel and recorded input, and whether it is a channel that moves."""
    times = np.round(record.times, _TIME).tobytes()
    for index, values in enumerate(record.values.T):
        here = np.isfinite(values)
        if here.any():
            moves = int(here.sum()) >= _ALIKE and float(np.ptp(values[here])) > 0.0
            yield f"{index}", (_digest(times, values), moves)
    for index, name in enumerate(inputs):
        if name not in record.unrecorded:
            yield name, (_digest(times, record.input_course(index)), False)


def _digest(times: bytes, values: Floats) -> bytes:
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    scale = 10.0 ** np.ceil(np.log10(largest)) if largest > 0.0 else 1.0
    rounded = np.round(values / scale, _DIGITS) + 0.0  # no negative zeros
    rounded[np.isnan(rounded)] = np.nan  # of one kind
    return hashlib.sha256(times + rounded.tobytes()).digest()


def _agree(one: Mapping[str, tuple[bytes, bool]], other: Mapping[str, tuple[bytes, bool]]) -> bool:
    return all(one[name][0] == other[name][0] for name in one.keys() & other.keys())
