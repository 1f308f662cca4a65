"""Over what range the data go: where effects that begin at a threshold are looked for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.physics.derived_slots import rates_in_symbols
from rigctl.physics.family import ModelFamily

#: shares of the readings left out at either end: spikes are no range
_ENDS = (0.005, 0.995)

#: the lowest and the highest value of a state, of "reading NAME", of its span ("length of NAME"), of an
#: input ("input NAME"), of its size ("|u|") and span ("travel of NAME"), or of a record's "time", SI
Ranges = Mapping[str, tuple[float, float]]


def data_ranges(family: ModelFamily, measurements: Measurements) -> Ranges:
    """The ranges of what was measured: of states that are read, of inputs' sizes, of records' lengths."""
    if not family.generic:
        return {}
    found: dict[str, tuple[float, float]] = {}
    states = _read_states(family)
    for at, name in enumerate(measurements.outputs):
        values = np.concatenate([record.values[:, at] for record in measurements.records])
        values = values[np.isfinite(values)]
        if not values.size:
            continue
        low, high = (float(end) for end in np.quantile(values, _ENDS))
        found |= {f"reading {name}": (low, high), f"length of {name}": (0.0, high - low)}
        if name in states:
            found[states[name]] = (low, high)
    for k, name in enumerate(measurements.inputs):
        values = np.concatenate([np.empty(0), *(_acting(record, k) for record in measurements.records)])
        if values.size:
            low, high = float(values.min()), float(values.max())
            found |= {f"input {name}": (low, high), f"travel of {name}": (0.0, high - low)}
            found[f"|{name}|"] = (0.0, max(-low, high))
    lengths = [
        float(record.times[-1] - record.times[0]) for record in measurements.records if record.times.size
    ]
    if lengths:
        found["time"] = (0.0, float(np.median(lengths)))
    return {name: ends for name, ends in found.items() if ends[1] > ends[0]}


def _acting(record: MeasuredRecord, place: int) -> NDArray[np.float64]:
    """What an input was in a record: its course where it changes steadily, else its commands."""
    if place in record.along:
        return record.lines[:, record.along.index(place)]
    return record.inputs[:, place]


def _read_states(family: ModelFamily) -> dict[str, str]:
    """Of each output that reads one state alone, the state."""
    try:
        written = rates_in_symbols(family)
    except RigctlError:
        return {}
    states = {state.name for state in family.states}
    readings = {output.name: written[f"reading of {output.name}"] for output in family.outputs}
    return {
        name: expr.name for name, expr in readings.items() if expr.op == "variable" and expr.name in states
    }
