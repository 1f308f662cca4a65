"""The unknowns of a fit: the model's free parameters, and those of each record.

In: a model, what its family declares of records, and measurements. Out: `Unknown`, each with its start,
bounds, size and prior, under the name of the parameter or the state of the system that it is: by these names
`Problem` puts its value into the equations, and finds its column among the derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.record_level import RECORD, Quantity, RecordLevel, Start
from rigctl.engine.least_squares import Prior, Unknown
from rigctl.model.fit.switching import switch_unknowns
from rigctl.model.measured.groups import first_reading
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model
from rigctl.physics.si_unit import si_unit

#: bounds of a parameter without declared ones, as factors of its value
NARROW, WIDE = 0.05, 20.0
#: lower limit of the pressure in a closed chamber, Pa relative to the surroundings: the oil cavitates before
_VACUUM = -0.5e5


@dataclass(frozen=True)
class LocalUnknown:
    """An unknown of one record: of the record-level effect, an initial state, or the time of commands."""

    name: str
    unknown: Unknown
    kind: Literal["parameter", "start", "switch"] = "parameter"


def shared_unknowns(model: Model, extra: Sequence[Unknown] = ()) -> list[Unknown]:
    """The model's free parameters, then `extra`.

    Raises
    ------
    RigctlError
        a start lies outside its bounds.
    """
    return [parameter_unknown(model, name) for name in model.fitted] + list(extra)


def parameter_unknown(model: Model, name: str) -> Unknown:
    """A parameter of the model or of one of its effects as an unknown that starts at the model's value."""
    # bounds: those declared; where none are, a factor about the value, wide enough for a wrong guess and
    # narrow enough to keep a fit among possible values. Usual bounds of a shipped family hold only as long as
    # the user's own value lies within them
    effect, dot, parameter = name.partition(".")
    value = model.values[name]
    if dot:
        return effect_unknown(model.effect(effect), parameter, value)
    declared = model.family.parameter(name)
    low = max(declared.low, NARROW * value) if declared.low == 0.0 and value > 0.0 else declared.low
    high = declared.high if math.isfinite(declared.high) or not value else WIDE * abs(value)
    if declared.usual[0] and value < low:
        low = declared.widest[0]
    if declared.usual[1] and value > high:
        high = declared.widest[1]
    given = model.parameters.get(name)
    return Unknown(
        name,
        value,
        low,
        max(high, value),
        scale=abs(value) or 1.0,
        prior=given.prior if given is not None else None,
        unit=si_unit(declared.unit),
    )


def assumed_unknowns(model: Model) -> list[Unknown]:
    """The assumed numbers that no fit changes, with priors as wide as their ranges.

    The prior's mean is the assumed value: where the data say nothing, it stays there. Its standard deviation
    is that of a uniform distribution over the range.
    """
    unknowns = []
    for name, (low, high) in model.assumed.items():
        value = model.values[name]
        prior = Prior(value, _spread(low, high))
        unit = si_unit(model.family.parameter(name).unit)
        unknowns.append(
            Unknown(name, value, low, high, scale=abs(value) or high - low, prior=prior, unit=unit)
        )
    return unknowns


def effect_unknown(effect: Effect, name: str, start: float | None = None) -> Unknown:
    """A parameter of an effect as an unknown, from its typical size unless `start` is given."""
    declared = effect.parameter(name)
    typical = abs(declared.start - declared.at_null) or abs(declared.start) or 1.0
    given = declared.start if start is None else start
    low, high = declared.bounds_around(given)
    begin = min(max(given, low), high)
    return Unknown(
        qualified(effect.name, name),
        begin,
        low,
        high,
        scale=max(typical, abs(begin)),
        unit=si_unit(declared.unit),
    )


def setting_unknowns(level: RecordLevel, std: float) -> list[Unknown]:
    """The levels shared by all rows of a table that were set alike; see `RecordLevel.with_settings`."""
    return [Unknown(name, 0.0, scale=std, prior=Prior(0.0, std)) for name in level.setting_names]


def local_unknowns(
    level: RecordLevel, record: MeasuredRecord, measurements: Measurements, starts: Mapping[str, float]
) -> tuple[LocalUnknown, ...]:
    """The unknowns of one record, with their priors; `starts` are the initial states."""
    unknowns = []
    # the order is that of the columns of a record's block: quantities, unrecorded inputs, switches, initial
    # states
    for quantity in level.quantities:
        if record.row and quantity.cancels:
            continue
        unknowns.append(LocalUnknown(quantity.name, _quantity(quantity, measurements)))
    if not record.row:  # rows share theirs
        unknowns += [LocalUnknown(one.name, one) for one in _deviations(record)]
    unknowns += [LocalUnknown(one.name, one, "switch") for one in switch_unknowns(record)]
    for start in level.starts:
        if record.row and start.how == "rest":  # the values of a row are relative to that
            continue
        one = _start(start, record, measurements, starts)
        if one is not None:
            unknowns.append(LocalUnknown(start.state, one, "start"))
    return tuple(unknowns)


def unrecorded_unknowns(measurements: Measurements) -> list[Unknown]:
    """The unrecorded inputs: the common value of each in all records, uniform over its range.

    The value in a record is that plus a deviation, ``u_i = m + d_i``. Independent values would each be pulled
    towards the middle of the range, even if all of many records are at its end.
    """
    unknowns = []
    for name, (low, high) in measurements.unrecorded.items():
        prior = Prior(0.5 * (low + high), _spread(low, high))
        unknowns.append(
            Unknown(qualified(RECORD, name), prior.mean, low, high, scale=high - low, prior=prior)
        )
    return unknowns


def _deviations(record: MeasuredRecord) -> list[Unknown]:
    """The deviations of this record's unrecorded inputs from the common values.

    Noise may carry the sum beyond the range: held there, only noise of one sign would remain.
    """
    return [
        Unknown(
            qualified(RECORD, name),
            0.0,
            low - high,
            high - low,
            scale=high - low,
            prior=Prior(0.0, _spread(low, high)),
        )
        for name, (low, high) in record.unrecorded.items()
    ]


def _spread(low: float, high: float) -> float:
    """Standard deviation of a uniform distribution."""
    return (high - low) / math.sqrt(12.0)


def _quantity(quantity: Quantity, measurements: Measurements) -> Unknown:
    std = quantity.std(measurements.rig)
    return Unknown(quantity.name, 0.0, scale=max(std, 1e-12), prior=Prior(0.0, std))


def _start(
    start: Start, record: MeasuredRecord, measurements: Measurements, starts: Mapping[str, float]
) -> Unknown | None:
    # a reading is where the fit starts, and no prior: it is among the residuals already
    if start.how == "measured":
        reading = _first(start.state, record, measurements)
        if math.isfinite(reading):
            return Unknown(start.state, reading, scale=max(1.0, 0.01 * abs(reading)))
    if start.how != "set" and start.rest > 0.0:
        mean = starts[start.state]
        return Unknown(start.state, mean, scale=start.rest, prior=Prior(mean, start.rest))
    if start.how == "set" and start.spread > 0.0:
        return _set(start, record, measurements)
    return None


def _set(start: Start, record: MeasuredRecord, measurements: Measurements) -> Unknown | None:
    """The part of a setting that a closed valve retains: of this record's, or of a higher earlier one."""
    # a closed valve holds what was set, of this record or of a higher one before it, which may have left its
    # pressure: the upper bound is therefore the highest setting of all records
    index = measurements.inputs.index(start.input)
    given = float(record.inputs[0, index])
    std, mean = start.spread * given, start.share * given
    if std <= 0.0:
        return None
    reading = _first(start.state, record, measurements)
    if math.isfinite(reading):  # a reading overrides the setting
        return Unknown(start.state, reading, min(_VACUUM, reading), scale=std)
    highest = max(float(each.inputs[:, index].max()) for each in measurements.records)
    return Unknown(start.state, mean, _VACUUM, 1.2 * highest, scale=std, prior=Prior(mean, std))


def _first(state: str, record: MeasuredRecord, measurements: Measurements) -> float:
    """The first reading of a state's channel; NaN if there is none."""
    if state not in measurements.outputs:
        return math.nan
    return first_reading(record, measurements.outputs.index(state))


def start_values(
    level: RecordLevel,
    record: MeasuredRecord,
    measurements: Measurements,
    usual: dict[str, float],
    parameters: Mapping[str, float],
) -> dict[str, float]:
    """The initial state of a record, as far as it is not unknown."""
    values = dict(usual)
    for start in level.starts:
        if start.state not in values:
            continue
        reading = _first(start.state, record, measurements)
        if start.how == "set":
            values[start.state] = start.share * float(
                record.inputs[0, measurements.inputs.index(start.input)]
            )
        elif start.how == "rest":
            at_rest = 0.0 if start.at_rest is None else start.at_rest(values, parameters)
            away = np.isfinite(reading) and abs(reading) > start.rest
            values[start.state] = reading if away else at_rest
        elif np.isfinite(reading):
            values[start.state] = reading
    unread = not np.isfinite(_first("oil_temperature", record, measurements))
    if unread and "oil_temperature" in values and "oil_temperature" in record.condition:
        values["oil_temperature"] = record.condition["oil_temperature"]
    return values
