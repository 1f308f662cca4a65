"""A record's condition: what was set for it, excluding anything that noise could cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigctl.dataset.conditions import cluster
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model
from rigctl.units import show

#: prefix of a channel's initial value, for records that no command distinguishes
START = "start_"
#: initial values differ on purpose if by more than this share of the channel's range and this many sigmas
_DIFFERENT, _SIGMAS = 0.05, 20.0
#: a measured input is an operating point if its variation between records exceeds that within them by this
#: factor
_BETWEEN = 3.0

#: units of the operating variables of the shipped families, where a rig file or a column gives none
_BY_NAME = {
    "oil": "degC",
    "supply": "bar",
    "oil_temperature": "degC",
    "pressure_setpoint": "bar",
    "pressure": "bar",
    "ambient_temperature": "degC",
}


def with_conditions(
    records: Sequence[MeasuredRecord], model: Model, outputs: Sequence[str]
) -> list[MeasuredRecord]:
    """Records that no sweep distinguishes get conditions from their commands and initial values.

    An initial value is a condition only if it differs on purpose: initial readings have noise, which must not
    define conditions.
    """
    # a sweep of the procedure says what was varied on purpose: nothing needs to be guessed from the data
    if len({tuple(sorted(record.condition.items())) for record in records}) > 1:
        return list(records)
    inputs = [item.name for item in model.family.inputs]
    extra = [_levels_of_inputs(record, inputs) for record in records]
    for name, values in _started(records, outputs).items():
        for one, value in zip(extra, values, strict=True):
            one[f"{START}{name}"] = value
    named = [
        replace(record, condition={**record.condition, **more})
        for record, more in zip(records, extra, strict=True)
    ]
    differing = {
        name
        for name in named[0].condition
        if len({record.condition.get(name) for record in named}) > 1
        and not _within_noise(records, model, name)
    }
    return [
        replace(
            record, condition={name: value for name, value in record.condition.items() if name in differing}
        )
        for record in named
    ]


def _levels_of_inputs(record: MeasuredRecord, inputs: Sequence[str]) -> dict[str, float]:
    """The largest value of each of the model's inputs that the record has, SI."""
    return {
        name: float(record.inputs[:, k][np.argmax(np.abs(record.inputs[:, k]))])
        for k, name in enumerate(inputs)
        if name not in record.unrecorded
    }


def commanded_levels(measurements: Measurements, record: MeasuredRecord) -> dict[str, float]:
    """The largest value of each actuator that commands an input of the model, SI; none without a rig."""
    actuators = {} if measurements.rig is None else measurements.rig.actuators
    levels = _levels_of_inputs(record, measurements.inputs)
    return {name: level for name, level in levels.items() if name in actuators}


def _within_noise(records: Sequence[MeasuredRecord], model: Model, name: str) -> bool:
    """Whether a measured input differs less between records than it does within them."""
    names = [item.name for item in model.family.inputs]
    if name not in names:
        return False
    index = names.index(name)
    along = [record.lines[:, record.along.index(index)] for record in records if index in record.along]
    if not along:
        return False
    middles = [float(np.median(values)) for values in along]
    # 16 % to 84 % is two standard deviations of a normal distribution, and ignores what happens rarely
    within = float(np.median([np.percentile(values, 84) - np.percentile(values, 16) for values in along]))
    return float(np.ptp(middles)) < _BETWEEN * 0.5 * within


def _started(records: Sequence[MeasuredRecord], outputs: Sequence[str]) -> dict[str, list[float]]:
    """The initial value of the first channel with a reading, where it differs on purpose."""
    index = next((c for c in range(len(outputs)) if records[0].here[:, c].any()), None)
    if index is None or any(record.times.size < 2 for record in records):
        return {}
    starts = np.array([_first(record, index) for record in records])
    present = [record.values[record.here[:, index], index] for record in records]
    every = np.concatenate(present)
    changes = np.concatenate([np.abs(np.diff(values)) for values in present if values.size > 1] or [[0.0]])
    sigma = float(np.median(changes)) / 0.954  # of the differences of two readings, each with this sigma
    least = max(_DIFFERENT * float(np.ptp(every)), _SIGMAS * sigma)
    known = starts[np.isfinite(starts)]
    if not known.size or float(np.ptp(known)) <= least:
        return {}
    return {outputs[index]: cluster(starts.tolist(), least)}


def _first(record: MeasuredRecord, index: int) -> float:
    """The first reading: later ones may already have changed."""
    values = record.values[record.here[:, index], index]
    return float(values[0]) if values.size else float("nan")


def variable_units(measurements: Measurements) -> dict[str, str]:
    """The unit in which each operating variable is shown: that of its channel, actuator or column."""
    rig = measurements.rig
    units = {}
    # in the order of the records: the iteration order of a set differs between processes
    for name in dict.fromkeys(name for record in measurements.records for name in record.condition):
        channel = name.removeprefix(START)
        if rig is not None and channel in rig.channels:
            units[name] = rig.channels[channel].unit
        elif rig is not None and name in rig.actuators:
            units[name] = rig.actuators[name].display_unit
        elif name in measurements.columns:
            units[name] = measurements.columns[name]
        else:
            units[name] = _BY_NAME.get(name, "1")
    return units


def condition_text(condition: Mapping[str, float], units: Mapping[str, str]) -> str:
    """A condition in words: ``oil 40 degC, supply 30 bar``."""
    return ", ".join(
        f"{name} {show(value, units[name])}" for name, value in condition.items() if name in units
    )
