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
#: samples of a record beyond which derivatives are worked out at some of them and interpolated
_SAMPLES = 500
#: samples from a switch on that are none of them left out: what a delay does is sharp
_ABOUT = 12


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
    names = [
        *(amplitude(slot, k) for slot in moving for k in range(knots)),
        *(level(slot) for slot in reading),
    ]
    slopes = _slopes(fit, _with_system(problem, fit, compiled, spacing), names)
    count = len(moving) * knots
    parts = [Part(slot, "time", slice(k * knots, (k + 1) * knots), knots) for k, slot in enumerate(moving)]
    readings = [[array[:, :, :count]] for array in slopes]
    courses = [
        [np.tile(tents(record.times - record.switch_times[0], knots, spacing), (1, len(moving)))]
        for record in problem.records
    ]
    for place, slot in enumerate(reading):
        steps = [array[:, :, len(moving) * knots + place] for array in slopes]
        grid = (knots, spacing) if moving else (knots, 0.0)
        channel = _shown_on(problem, steps)
        outputs = [fit.outputs[k][:, channel] for k in fit.fitted]
        for view, bases in reading_bases(problem.records, outputs, *grid).items():
            last = count + bases[0].shape[1]
            parts.append(Part(slot, view, slice(count, last), knots if view == "time" else 0))
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
    """The channel on which a reading's disturbance shows most, in units of the noise."""
    shown = np.sum([np.abs(step).sum(axis=0) for step in steps], axis=0) / problem.noise.sigma
    return int(np.argmax(shown))


def _slopes(fit: FitResult, problem: Problem, names: Sequence[str]) -> list[Floats]:
    """(n, channels, names) of each record: worked out at few samples, on straight lines between them."""
    slopes: list[Floats] = []
    for part in problem.parts(len(names)):
        some = problem.only(part)
        chosen = [_few(record) for record in some.records]
        local = [fit.local[fit.fitted[k]] for k in part]
        found = some.at_samples(chosen).simulate(np.empty(0), local, names).require()
        slopes += [
            _interpolated(np.take(array, problem.channels, axis=1), places, record.times)
            for array, places, record in zip(found.sensitivities, chosen, some.records, strict=True)
        ]
    return slopes


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


def _few(record: MeasuredRecord) -> Places:
    """Samples of a record that tell the others: every so many, and all about each switch."""
    count = record.times.size
    if count <= _SAMPLES:
        return np.arange(count, dtype=np.intp)
    switched = np.flatnonzero(np.diff(record.phase))
    every = np.arange(0, count, -(-count // _SAMPLES))
    about = (switched[:, None] + np.arange(_ABOUT)).ravel()
    chosen = np.unique(np.concatenate([every, about, [count - 1]]))
    return chosen[chosen < count].astype(np.intp)


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
