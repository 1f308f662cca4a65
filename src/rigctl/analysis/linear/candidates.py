"""The effects that a model may lack: those of the library that it does not have and that do not contradict
it.

In: a model, and the ranges that the measurements cover. Out: `Candidate`s, each an effect at one choice of
its shape parameters, or at one finite size: a linear problem has a column for a size, and none for a
threshold or an exponent, which are therefore tried over a grid. Thresholds are searched over the range that
the data cover, as beyond it they change nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import Effect, EffectParameter, qualified
from rigctl.effects.registry import library
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model
from rigctl.physics.derived_slots import rates_in_symbols
from rigctl.physics.family import ModelFamily

#: quantiles between which readings count as their range, so that spikes do not
_ENDS = (0.005, 0.995)

#: the lowest and highest value, SI, of a state, of "reading NAME", of its span ("length of NAME"), of an
#: input ("input NAME"), of its magnitude ("|u|") and span ("travel of NAME"), or of a record's "time"
Ranges = Mapping[str, tuple[float, float]]


def data_ranges(family: ModelFamily, measurements: Measurements) -> Ranges:
    """The ranges of the measurements: of measured states, of inputs' magnitudes, of records' lengths."""
    if not family.generic:
        return {}
    ranges: dict[str, tuple[float, float]] = {}
    states = _read_states(family)
    for at, name in enumerate(measurements.outputs):
        values = np.concatenate([record.values[:, at] for record in measurements.records])
        values = values[np.isfinite(values)]
        if not values.size:
            continue
        low, high = (float(end) for end in np.quantile(values, _ENDS))
        ranges |= {f"reading {name}": (low, high), f"length of {name}": (0.0, high - low)}
        if name in states:
            ranges[states[name]] = (low, high)
    for k, name in enumerate(measurements.inputs):
        values = np.concatenate([np.empty(0), *(_acting(record, k) for record in measurements.records)])
        if values.size:
            low, high = float(values.min()), float(values.max())
            ranges |= {f"input {name}": (low, high), f"travel of {name}": (0.0, high - low)}
            ranges[f"|{name}|"] = (0.0, max(-low, high))
    lengths = [
        float(record.times[-1] - record.times[0]) for record in measurements.records if record.times.size
    ]
    if lengths:
        ranges["time"] = (0.0, float(np.median(lengths)))
    return {name: ends for name, ends in ranges.items() if ends[1] > ends[0]}


def _acting(record: MeasuredRecord, index: int) -> NDArray[np.float64]:
    """The values of an input in a record: its time series if it changes continuously, else its commands."""
    if index in record.along:
        return record.lines[:, record.along.index(index)]
    return record.inputs[:, index]


def _read_states(family: ModelFamily) -> dict[str, str]:
    """For each output that reads a single state, that state."""
    try:
        written = rates_in_symbols(family)
    except RigctlError:
        return {}
    states = {state.name for state in family.states}
    readings = {output.name: written[f"reading of {output.name}"] for output in family.outputs}
    return {
        name: expr.name for name, expr in readings.items() if expr.op == "variable" and expr.name in states
    }


@dataclass(frozen=True)
class Candidate:
    """One effect at one choice of its shapes.

    Attributes
    ----------
    effect: of the library, or a user's own.
    columns: the parameters that switch it on, by their names in the system.
    signs: of each column, 1 or -1 if physics allows one direction only, 0 if both.
    shapes: values of its shape parameters that differ from their starts, by qualified name, SI.
    secants: parameters that are evaluated at this value, by qualified name, SI, instead of their null,
        because the effect has a threshold and its slope at the null is uninformative.
    """

    effect: Effect
    columns: tuple[str, ...]
    signs: tuple[int, ...]
    shapes: Mapping[str, float]
    secants: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.effect.name

    def parameter(self, column: str) -> EffectParameter:
        """The effect's parameter that the system calls `column`."""
        return self.effect.parameter(column.partition(".")[2])


def candidates(
    model: Model, excluded: Collection[str] = (), ranges: Ranges | None = None
) -> tuple[Candidate, ...]:
    """Every effect that `model` may lack, at every shape of its grid, in the library's order.

    Parameters
    ----------
    excluded: names of effects that are not to be considered.
    ranges: of the measurements, over which thresholds are searched.
    """
    # An effect is impossible beside one that it replaces or that replaces it: the two would add the same term
    # twice.
    present = [model.effect(name) for name in model.effects]
    impossible = {name for effect in present for name in (effect.name, *effect.instead_of)} | {*excluded}
    tried: list[Candidate] = []
    for effect in (*library(model.family).values(), *model.own_effects):
        says_the_same = any(other.name in effect.instead_of for other in present)
        if effect.terms and effect.name not in impossible and not says_the_same:
            tried += at_each_shape(effect, ranges)
    return tuple(tried)


def require_known(excluded: Collection[str], models: Sequence[Model]) -> None:
    """Refuse the name of an effect to exclude that none of the models may have: it would exclude nothing.

    Raises
    ------
    RigctlError
        there is no such effect; names the nearest.
    """
    own = {effect.name for model in models for effect in model.own_effects}
    known = own.union(*(library(model.family) for model in models))
    for name in excluded:
        if name not in known:
            raise unknown_name("effect to exclude", name, known)


def by_effect(tried: Sequence[Candidate]) -> dict[str, tuple[int, ...]]:
    """The indices of each effect's candidates in `tried`."""
    indices: dict[str, list[int]] = {}
    for index, candidate in enumerate(tried):
        indices.setdefault(candidate.name, []).append(index)
    return {name: tuple(at) for name, at in indices.items()}


def at_each_shape(effect: Effect, ranges: Ranges | None = None) -> Iterator[Candidate]:
    """An effect at every shape of its grid; thresholds over the `ranges` of the measurements.

    None for a drift with an input that has one value in all data, from whose middle it would count.
    """
    known = ranges or {}
    origins = [one for one in effect.parameters if one.shape and one.shares and not one.refined]
    if ranges is not None and any(one.within not in known for one in origins):
        return
    switching = [parameter for parameter in effect.parameters if not parameter.shape]
    columns = tuple(qualified(effect.name, parameter.name) for parameter in switching)
    signs = tuple(int(parameter.sign) for parameter in switching)
    switched_on = [
        (qualified(effect.name, one.name), amplitude) for one in switching for amplitude in one.grid
    ]
    # With a threshold: at each size of the grid, by the secant from there to the null. Without one: by its
    # slope at the null, once if it has no shapes, else at each shape.
    for name, amplitude in switched_on:
        yield Candidate(effect, columns, signs, {}, {name: amplitude})
    measured = [one for one in effect.parameters if one.shape and one.within in known and one.shares]
    if not switched_on and not measured:
        yield Candidate(effect, columns, signs, {})
    for parameter in effect.parameters:
        if parameter.shape:
            for value in _grid(parameter, known):
                yield Candidate(effect, columns, signs, {qualified(effect.name, parameter.name): value})


def at_sizes(candidate: Candidate, count: int) -> Iterator[Candidate]:
    """A candidate with one parameter at `count` sizes, geometrically spaced from typical to its bound.

    None for a candidate with several parameters.
    """
    if len(candidate.columns) != 1:
        return
    (column,) = candidate.columns
    declared = candidate.parameter(column)
    typical = declared.start - declared.at_null
    limit = (declared.high if typical > 0.0 else declared.low) - declared.at_null
    if not typical or not limit / typical > 1.0:
        return
    for k in range(1, count + 1):
        size = typical * (limit / typical) ** (k / (count + 1))
        yield replace(candidate, secants={column: declared.at_null + size})


def _grid(parameter: EffectParameter, ranges: Ranges) -> tuple[float, ...]:
    """The values of a shape that are tried: over the measured range, if there is one."""
    if parameter.within not in ranges or not parameter.shares:
        return parameter.grid
    low, high = ranges[parameter.within]
    over = [low + share * (high - low) for share in parameter.shares]
    return tuple(min(max(value, parameter.low), parameter.high) for value in over)
