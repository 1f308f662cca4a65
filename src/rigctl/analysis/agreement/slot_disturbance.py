"""The changes of every record's readings by an unknown disturbance at each slot.

The disturbance is declared like an effect whose amplitudes are at their null; the engine's derivatives are
its columns. At a slot of the process or of a command it is ``w(t) = Σ_k a_k·Λ(t/h − k)``, with hat functions
Λ (linear B-splines) at K knots that are h apart. At a slot on which only the readings depend it is a
constant: no motion follows from it, so that one derivative describes any time series of the disturbance.

An error of a sensor is a function of time, of the reading, and of its rate of change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own, qualified
from rigctl.engine.compile import CompiledSystem, Progress, compile_system
from rigctl.engine.symbols import Scalar, positive_part
from rigctl.engine.system import System
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.record import MeasuredRecord
from rigctl.physics.family import ModelFamily, Slot
from rigctl.physics.scope import Scope

#: name of the hidden effect
DISTURBANCE = "disturbance"
#: its parameter for the time between two knots, s
SPACING = qualified(DISTURBANCE, "spacing")
#: width over which a hat function's corners are rounded, in knots
_CORNER = 1e-3
#: amplitudes stay at their null, so bounds are irrelevant
_BOUND = 1e12


def amplitude(slot: Slot, knot: int) -> str:
    """The system's name of the parameter of a slot's disturbance at a knot."""
    return qualified(DISTURBANCE, f"{slot.name}_{knot}")


def level(slot: Slot) -> str:
    """The system's name of the parameter of a slot's constant disturbance."""
    return qualified(DISTURBANCE, f"{slot.name}_level")


def disturbed_system(problem: Problem, moving: Sequence[Slot], reading: Sequence[Slot], knots: int) -> System:
    """The model of `problem` with hat functions at the slots `moving` and constants at the slots `reading`.

    Raises
    ------
    RigctlError
        a slot accepts no term.
    """
    return problem.system_with(_effect(problem.model.family, moving, reading, knots))


def sort_slots(problem: Problem) -> tuple[tuple[Slot, ...], tuple[Slot, ...]]:
    """The slots on which a state or a switch time depends, and those on which only measured readings do."""
    slots = problem.model.family.slots
    system = disturbed_system(problem, (), slots, 0)
    measured = set(problem.measurements.outputs)
    moved = [*system.rhs, *(delay.expr for delay in system.delays)]
    read = [output.expr for output in system.outputs if output.name in measured]
    moving, reading = [], []
    for slot in slots:
        variable = system.graph.variables.get(level(slot))
        if variable is None:
            continue
        if any(expr.depends_on & variable.depends_on for expr in moved):
            moving.append(slot)
        elif any(expr.depends_on & variable.depends_on for expr in read):
            reading.append(slot)
    return tuple(moving), tuple(reading)


def _effect(family: ModelFamily, moving: Sequence[Slot], reading: Sequence[Slot], knots: int) -> Effect:
    tents = [(slot.name, partial(_tents, slot, knots)) for slot in moving]
    levels = [(slot.name, partial(_level, slot)) for slot in reading]
    names = [(f"{slot.name}_{k}", slot.unit) for slot in moving for k in range(knots)]
    names += [(f"{slot.name}_level", slot.unit) for slot in reading]
    return Effect(
        name=DISTURBANCE,
        family=family.name,
        own_family=family,
        summary="What a record says of an unknown term.",
        equation="w(t) = sum of a_k * tent(t/h - k)",
        source="Kristensen, Madsen & Jorgensen, Automatica 40 (2004) 225",
        looks_like="Anything.",
        terms=(*tents, *levels),
        parameters=(
            *(EffectParameter(name, unit, 0.0, 1.0, -_BOUND, _BOUND, "amplitude") for name, unit in names),
            EffectParameter("spacing", "s", None, 1.0, 0.0, _BOUND, "h, from knot to knot"),
        ),
        states=(EffectState("clock", "s", 1.0, lambda m, p: 1.0, "time since the record began"),),
    )


def _tents(slot: Slot, knots: int, _: Scope, p: Own) -> Scalar:
    total: Scalar = 0.0
    for k, tent in enumerate(_shapes(p.clock / p.spacing, knots)):
        total = total + p[f"{slot.name}_{k}"] * tent
    return 1.0 + total if slot.combine == "product" else total


@lru_cache(maxsize=1)
def _shapes(position: Scalar, knots: int) -> tuple[Scalar, ...]:
    """Hat functions at 0, 1, … of `position`, each a second difference of ramps; shared by all slots."""
    ramps = [positive_part(position - float(k), _CORNER) for k in range(-1, knots + 1)]
    return tuple(ramps[k] - 2.0 * ramps[k + 1] + ramps[k + 2] for k in range(knots))


def _level(slot: Slot, _: Scope, p: Own) -> Scalar:
    value = p[f"{slot.name}_level"]
    return 1.0 + value if slot.combine == "product" else value


Floats = NDArray[np.float64]
#: the argument of a disturbance; for a table, "time" means its inputs
View: TypeAlias = Literal["time", "reading", "rate"]


def reading_bases(
    records: Sequence[MeasuredRecord], read: Sequence[Floats], knots: int, spacing: float
) -> dict[View, list[Floats]]:
    """(n, functions) for each record: the basis of each view of an error of one channel with readings `read`.

    - "time": hat functions at the knots; for a table, whose `spacing` is 0, hat functions over each input
      that varies;
    - "reading": a constant, a linear and a quadratic term over the range that the channel covers;
    - "rate": the time derivative, which a lag multiplies; not for a table.
    """
    low, high = min(float(x.min()) for x in read), max(float(x.max()) for x in read)
    position = [(2.0 * x - low - high) / ((high - low) or 1.0) for x in read]
    bases: dict[View, list[Floats]] = {}
    bases["reading"] = [np.column_stack([np.ones_like(x), x, 1.5 * x**2 - 0.5]) for x in position]
    if spacing > 0.0:
        bases["time"] = [tents(r.times - r.switch_times[0], knots, spacing) for r in records]
        if min(x.size for x in read) > 1:
            bases["rate"] = [
                np.gradient(x, record.times)[:, None] for x, record in zip(read, records, strict=True)
            ]
        return bases
    varying = _inputs(records)
    if varying[0].shape[1]:
        bases["time"] = [
            np.concatenate([tents(column, knots, 1.0 / (knots - 1)) for column in x.T], axis=1)
            for x in varying
        ]
    return bases


def tents(x: Floats, knots: int, spacing: float) -> Floats:
    """(n, knots) hat functions: ``max(0, 1 − |x/spacing − k|)``."""
    distance = np.abs(x[:, None] / spacing - np.arange(knots))
    return np.maximum(1.0 - distance, 0.0)


def _inputs(records: Sequence[MeasuredRecord]) -> list[Floats]:
    """(n, varying inputs) of each record at its samples, scaled to 0 … 1."""
    values = [
        record.inputs[np.searchsorted(record.switch_times, record.times, side="right") - 1]
        for record in records
    ]
    low = np.min([x.min(axis=0) for x in values], axis=0)
    high = np.max([x.max(axis=0) for x in values], axis=0)
    moved = high > low
    return [(x[:, moved] - low[moved]) / (high[moved] - low[moved]) for x in values]


Indices = NDArray[np.intp]
#: in records with more samples, derivatives are computed at some of them and interpolated
_SAMPLES = 500
#: number of samples after a switch that are always included: the action of a delay is sharp
_ABOUT = 12


@dataclass(frozen=True)
class ColumnGroup:
    """Columns that belong together: a slot, and the argument of its disturbance.

    `knots` is the number of neighbouring columns with a smooth prior; 0 for columns without an order.
    """

    slot: Slot
    view: View
    columns: slice
    knots: int = 0


@dataclass(frozen=True)
class DisturbanceColumns:
    """Disturbances of unit amplitude and their consequences.

    Attributes
    ----------
    parts: the meaning of the columns.
    readings: (n, channels, columns) for each record: the change of the readings.
    courses: (n, columns) for each record: the disturbance itself.
    """

    parts: tuple[ColumnGroup, ...]
    readings: tuple[Floats, ...] = field(repr=False)
    courses: tuple[Floats, ...] = field(repr=False)


@dataclass(frozen=True)
class Disturbed:
    """A model with a disturbance at every slot: `moving` those of its equations, `reading` of its sensors."""

    moving: tuple[Slot, ...]
    reading: tuple[Slot, ...]
    knots: int
    compiled: CompiledSystem


def disturbed(problem: Problem, knots: int, progress: Progress | None = None) -> Disturbed:
    """The model of `problem`, each disturbance with `knots` knots over a record."""
    moving, reading = sort_slots(problem)
    compiled = compile_system(disturbed_system(problem, moving, reading, knots), progress=progress)
    return Disturbed(moving, reading, knots, compiled)


def disturbance_columns(fit: FitResult, problem: Problem, model: Disturbed) -> DisturbanceColumns:
    """The columns of the records of `problem`, the fitted ones of `fit`, in its slots' order.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    moving, reading, knots, compiled = model.moving, model.reading, model.knots, model.compiled
    spacing = max((_length(record) for record in problem.records), default=0.0) / (knots - 1) or 1.0
    names = [
        *(amplitude(slot, k) for slot in moving for k in range(knots)),
        *(level(slot) for slot in reading),
    ]
    slopes = _slopes(fit, with_system(problem, fit, compiled, spacing), names)
    # Slots of the equations: one hat function after the other, through the motion to every reading.
    count = len(moving) * knots
    parts = [
        ColumnGroup(slot, "time", slice(k * knots, (k + 1) * knots), knots) for k, slot in enumerate(moving)
    ]
    readings = [[array[:, :, :count]] for array in slopes]
    courses = [
        [np.tile(tents(record.times - record.switch_times[0], knots, spacing), (1, len(moving)))]
        for record in problem.records
    ]
    # Slots of readings: no motion follows, so that one derivative times any function of time, reading or rate
    # is the change by a disturbance of that form. For a table "time" means its inputs.
    for index, slot in enumerate(reading):
        steps = [array[:, :, len(moving) * knots + index] for array in slopes]
        grid = (knots, spacing) if moving else (knots, 0.0)
        channel = _shown_on(problem, steps)
        outputs = [fit.outputs[k][:, channel] for k in fit.fitted]
        for view, bases in reading_bases(problem.records, outputs, *grid).items():
            last = count + bases[0].shape[1]
            parts.append(ColumnGroup(slot, view, slice(count, last), knots if view == "time" else 0))
            count = last
            for k, basis in enumerate(bases):
                readings[k].append(steps[k][:, :, None] * basis[:, None, :])
                courses[k].append(basis)
    return DisturbanceColumns(
        tuple(parts),
        tuple(np.concatenate(arrays, axis=2) for arrays in readings),
        tuple(np.concatenate(arrays, axis=1) for arrays in courses),
    )


def _shown_on(problem: Problem, steps: Sequence[Floats]) -> int:
    """The channel most affected by a disturbance of a reading, in units of the noise."""
    shown = np.sum([np.abs(step).sum(axis=0) for step in steps], axis=0) / problem.noise.sigma
    return int(np.argmax(shown))


def _slopes(fit: FitResult, problem: Problem, names: Sequence[str]) -> list[Floats]:
    """(n, channels, names) of each record: computed at few samples, interpolated linearly between them."""
    slopes: list[Floats] = []
    for part in problem.parts(len(names)):
        some = problem.only(part)
        samples = [_few(record) for record in some.records]
        local = [fit.local[fit.fitted[k]] for k in part]
        simulated = some.at_samples(samples).simulate(np.empty(0), local, names).require()
        slopes += [
            _interpolated(np.take(array, problem.channels, axis=1), indices, record.times)
            for array, indices, record in zip(simulated.sensitivities, samples, some.records, strict=True)
        ]
    return slopes


def _length(record: MeasuredRecord) -> float:
    return float(record.times[-1] - record.switch_times[0])


def with_system(problem: Problem, fit: FitResult, compiled: CompiledSystem, spacing: float) -> Problem:
    """`problem` with other equations, at the fitted values."""
    fitted = dict(zip(problem.compiled.system.parameter_names, problem.base.tolist(), strict=True))
    fitted |= {u.name: float(value) for u, value in zip(fit.problem.shared, fit.values, strict=True)}
    fitted[SPACING] = spacing
    system, known = compiled.system, problem.compiled.system.state_names
    starts = [dict(zip(known, start.tolist(), strict=True)) for start in problem.starts]
    return replace(
        problem,
        compiled=compiled,
        shared=(),
        base=np.array([fitted.get(p.name, p.value) for p in system.parameters]),
        starts=tuple(np.array([start.get(name, 0.0) for name in system.state_names]) for start in starts),
    )


def _few(record: MeasuredRecord) -> Indices:
    """Samples of a record from which the others are interpolated: equally spaced, and all after each
    switch."""
    count = record.times.size
    if count <= _SAMPLES:
        return np.arange(count, dtype=np.intp)
    switched = np.flatnonzero(np.diff(record.phase))
    every = np.arange(0, count, -(-count // _SAMPLES))
    about = (switched[:, None] + np.arange(_ABOUT)).ravel()
    chosen = np.unique(np.concatenate([every, about, [count - 1]]))
    return chosen[chosen < count].astype(np.intp)


def _interpolated(array: Floats, indices: Indices, times: Floats) -> Floats:
    """(samples, channels, columns) interpolated linearly between the chosen samples."""
    if indices.size == times.size:
        return array
    right = np.clip(np.searchsorted(indices, np.arange(times.size), side="left"), 1, indices.size - 1)
    left = right - 1
    begin, end = times[indices[left]], times[indices[right]]
    share = ((times - begin) / (end - begin))[:, None, None]
    result: Floats = array[left] * (1.0 - share)
    result += array[right] * share
    return result
