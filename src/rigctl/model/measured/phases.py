"""The periods of constant commands in a record, and their names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.physics.family import ModelFamily
from rigctl.units import show

Floats = NDArray[np.float64]

_VALVE = {1.0: "extend", -1.0: "retract"}
#: ends of the parts of a record without a switch, as shares of its samples
_PARTS = (("early", 1 / 9), ("middle", 1 / 3), ("late", 1.0))
_ENOUGH = 30


def phases_of(
    times: Floats, switch_times: Floats, inputs: Floats, family: ModelFamily, units: Sequence[str]
) -> tuple[NDArray[np.intp], tuple[str, ...]]:
    """(phase of each sample, names): a sample at a switch belongs to the period before it.

    `units` are those in which the inputs are shown. A record without a switch is divided into an early, a
    middle and a late part instead.
    """
    # by rows that differ: a command repeated, or one of an input that is only measured, begins no phase
    changes = [0, *(np.flatnonzero((inputs[1:] != inputs[:-1]).any(axis=1)) + 1).tolist()]
    index = np.searchsorted(switch_times[changes[1:]], times, side="left")
    used = np.unique(index)
    if used.size == 1 and times.size >= _ENOUGH:
        ends = [round(share * times.size) for _, share in _PARTS]
        return np.searchsorted(ends, np.arange(times.size), side="right"), tuple(name for name, _ in _PARTS)
    names = _names([inputs[changes[k]] for k in used], family, units)
    return np.searchsorted(used, index).astype(np.intp), names


def _names(rows: Sequence[Floats], family: ModelFamily, units: Sequence[str]) -> tuple[str, ...]:
    moving = [k for k, item in enumerate(family.inputs) if item.role == "move"]
    names: list[str] = []
    previous: Floats | None = None
    for row in rows:
        if moving:
            name = _VALVE.get(float(row[moving[0]]), "hold" if names else "wait")
        else:
            name = _changed(previous, row, family, units)
        previous = row
        names.append(name)
    return _numbered(names)


def _changed(before: Floats | None, row: Floats, family: ModelFamily, units: Sequence[str]) -> str:
    """The command, in words."""
    changed = [
        f"{item.name} {show(float(row[k]), units[k])}" if units[k] else f"{item.name} {row[k]:g}"
        for k, item in enumerate(family.inputs)
        if before is None or row[k] != before[k]
    ]
    return ", ".join(changed) if before is not None else "start"


def _numbered(names: Sequence[str]) -> tuple[str, ...]:
    """Names that occur twice get a number."""
    occurrences, counts = Counter(names), Counter[str]()
    result = []
    for name in names:
        counts[name] += 1
        result.append(name if occurrences[name] == 1 else f"{name} {counts[name]}")
    return tuple(result)
