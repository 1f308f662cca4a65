"""What a disturbance at each slot does to the readings of every record, by the engine's derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.disturbance_effect import SPACING, amplitude, disturbed_system, level, sort_slots
from rigctl.compare.reading_bases import View, reading_bases, tents
from rigctl.engine.compile import CompiledSystem, Progress, compile_system
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.record import MeasuredRecord
from rigctl.physics.family import Slot

Floats = NDArray[np.float64]
Places = NDArray[np.intp]
#: samples of a record beyond which the process's derivatives are worked out at some and interpolated
_SAMPLES = 160


@dataclass(frozen=True)
class Part:
    """Columns that belong together: a slot, and what its disturbance depends on there.

    `knots` is the number of neighbouring columns that are alike; 0 for columns without an order.
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
    parts: what the columns are.
    readings: (n, channels, columns) of each record: the change of the readings.
    courses: (n, columns) of each record: the disturbance itself.
    """

    parts: tuple[Part, ...]
    readings: tuple[Floats, ...] = field(repr=False)
    courses: tuple[Floats, ...] = field(repr=False)


def disturbance_columns(
    fit: FitResult, problem: Problem, knots: int, progress: Progress | None = None
) -> DisturbanceColumns:
    """The columns of the records of `problem`, the fitted ones of `fit`, in its slots' order.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    moving, reading = sort_slots(problem)
    compiled = compile_system(disturbed_system(problem, moving, reading, knots), progress=progress)
    spacing = max((_length(record) for record in problem.records), default=0.0) / (knots - 1) or 1.0
    disturbed = _with_system(problem, fit, compiled, spacing)
    local = [fit.local[k] for k in fit.fitted]
    parts, readings, courses = _of_motion(disturbed, local, moving, knots, spacing)
    outputs = [fit.outputs[k] for k in fit.fitted]
    grid = (knots, spacing) if moving else (knots, 0.0)
    steps = _simulated(disturbed, local, [level(slot) for slot in reading])
    for place, slot in enumerate(reading):
        channel = int(np.argmax(np.sum([np.abs(step[:, :, place]).sum(axis=0) for step in steps], axis=0)))
        for view, bases in reading_bases(problem.records, outputs, channel, *grid).items():
            first, width = readings[0].shape[2], bases[0].shape[1]
            ordered = knots if view == "time" else 0
            parts.append(Part(slot, view, slice(first, first + width), ordered))
            for k, basis in enumerate(bases):
                added = steps[k][:, :, place, None] * basis[:, None, :]
                readings[k] = np.concatenate([readings[k], added], axis=2)
                courses[k] = np.concatenate([courses[k], basis], axis=1)
    return DisturbanceColumns(tuple(parts), tuple(readings), tuple(courses))


def _of_motion(
    problem: Problem, local: Sequence[Floats], moving: Sequence[Slot], knots: int, spacing: float
) -> tuple[list[Part], list[Floats], list[Floats]]:
    """Parts, readings and courses of the slots that something moves by."""
    chosen = [_few(record) for record in problem.records]
    names = [amplitude(slot, k) for slot in moving for k in range(knots)]
    arrays = _simulated(_at_samples(problem, chosen), local, names)
    readings = [
        _interpolated(array, places, record.times)
        for array, places, record in zip(arrays, chosen, problem.records, strict=True)
    ]
    courses = [
        np.tile(tents(record.times - record.switch_times[0], knots, spacing), (1, len(moving)))
        for record in problem.records
    ]
    parts = [Part(slot, "time", slice(k * knots, (k + 1) * knots), knots) for k, slot in enumerate(moving)]
    return parts, readings, courses


def _length(record: MeasuredRecord) -> float:
    return float(record.times[-1] - record.switch_times[0])


def _with_system(problem: Problem, fit: FitResult, compiled: CompiledSystem, spacing: float) -> Problem:
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


def _simulated(problem: Problem, local: Sequence[Floats], names: Sequence[str]) -> list[Floats]:
    """(n, channels, names) of each record."""
    if not names:
        return [np.empty((r.times.size, len(problem.measurements.outputs), 0)) for r in problem.records]
    found = problem.simulate(np.empty(0), local, names).require()
    return [np.take(array, problem.channels, axis=1) for array in found.sensitivities]


def _few(record: MeasuredRecord) -> Places:
    """Samples of a record that tell the others: every so many, and both sides of each switch."""
    count = record.times.size
    if count <= _SAMPLES:
        return np.arange(count, dtype=np.intp)
    switched = np.flatnonzero(np.diff(record.phase))
    every = np.arange(0, count, -(-count // _SAMPLES))
    return np.unique(np.concatenate([every, switched, switched + 1, [count - 1]])).astype(np.intp)


def _at_samples(problem: Problem, chosen: Sequence[Places]) -> Problem:
    """The records at some of their samples."""
    records = tuple(
        replace(record, times=record.times[at], values=record.values[at], phase=record.phase[at])
        for record, at in zip(problem.records, chosen, strict=True)
    )
    return replace(problem, measurements=replace(problem.measurements, records=records))


def _interpolated(array: Floats, places: Places, times: Floats) -> Floats:
    """(samples, channels, columns) between the chosen samples, on straight lines."""
    if places.size == times.size:
        return array
    right = np.clip(np.searchsorted(places, np.arange(times.size), side="left"), 1, places.size - 1)
    left = right - 1
    begin, end = times[places[left]], times[places[right]]
    share = ((times - begin) / (end - begin))[:, None, None]
    result: Floats = array[left] * (1.0 - share)
    result += array[right] * share
    return result
