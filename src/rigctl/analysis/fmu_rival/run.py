"""Simulates records with an FMU, from the initial values at which it fits them best.

In: an FMU, and a fit whose records it is to be compared on. Out: its outputs for each record, SI. An FMU is a
program: it runs in a process of its own, for a limited time, and has no derivatives, so that its initial
values are found by finite differences.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import Location, RigctlError, nearest_name
from rigctl.fmu.description import Description, read_description
from rigctl.fmu.process import FmuProcess
from rigctl.foreign.process import PATIENCE
from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.record import MeasuredRecord

Floats = NDArray[np.float64]

#: shift of an initial value for its derivative, in sigmas
_BESIDE: Final = 5.0
#: two times closer than this are equal, s
_SAME: Final = 1e-12


@dataclass(frozen=True)
class FmuOutputs:
    """The outputs of an FMU: for each record (samples, outputs) in SI, NaN in columns that it does not have.

    `settable` names the channels whose initial value could be set.
    """

    outputs: tuple[str, ...]
    records: tuple[Floats, ...]
    settable: frozenset[str]


def require_fmu(path: Path) -> None:
    """Refuse a file that is no FMU, or one that cannot be run here, before any work is done.

    Raises
    ------
    RigctlError
        as `read_description`.
    """
    read_description(path)


def run_fmu(
    path: Path,
    fitted: FitResult,
    on_progress: Callable[[str], None] = lambda text: None,
    patience: float = PATIENCE,
) -> FmuOutputs:
    """Simulate every record of a fit with an FMU, from the initial values at which the FMU fits the readings
    best.

    The initial values of a fitted model would carry that model's errors, and a single reading has noise. For
    channels whose initial value can be set in the FMU, it is simulated from the first readings and from a
    shifted value of each, and once more from where the whitened error is least by these derivatives.

    Parameters
    ----------
    on_progress: called with a description of the current simulation.
    patience: longest time of one simulation, s.

    Raises
    ------
    RigctlError
        as `require_fmu`; the FMU does not fit the data, it fails, crashes, or a simulation takes longer than
        `patience`.
    """
    problem = fitted.problem
    about = read_description(path)
    with _Simulations(about, problem, on_progress, patience) as simulations:
        records = [_best(simulations, problem, index) for index in range(len(problem.records))]
    names = problem.measurements.outputs
    settable = frozenset(names[column] for column in simulations.columns)
    return FmuOutputs(tuple(simulations.outputs), tuple(records), settable)


class _Simulations:
    """Simulations of records by an FMU, counted; a context, in which its process runs.

    Attributes
    ----------
    outputs: of the FMU that are channels.
    columns: the channels whose initial value can be set.
    """

    def __init__(
        self,
        about: Description,
        problem: Problem,
        on_progress: Callable[[str], None],
        patience: float,
    ) -> None:
        channels = problem.measurements.outputs
        self._channels = channels
        self._inputs = _columns_of_inputs(about, problem.measurements.inputs)
        self.outputs = _common_outputs(about, channels)
        starts = {name: start for name in channels if (start := about.start_of(name)) is not None}
        self._starts = starts
        self.columns = [column for column, name in enumerate(channels) if name in self._starts]
        each = len(self.columns) + 2 if self.columns else 1
        self._name, self._on_progress = about.path.name, on_progress
        self._number, self._count = 0, each * len(problem.records)
        ports = (
            [about.port(name) for name in names] for names in (self._inputs, self.outputs, starts.values())
        )
        self._process = FmuProcess(
            about.path,
            about.kind,
            *ports,
            patience=patience,
            slow="'--rival-timeout' sets this time, e.g. '10 min'",
        )

    def __enter__(self) -> Self:
        self._process.__enter__()
        return self

    def __exit__(self, *problem: object) -> None:
        self._process.__exit__(None, None, None)

    def run(self, record: MeasuredRecord, begin: Floats) -> Floats:
        """(samples, channels), from initial values of the channels, NaN where the FMU's own is to hold."""
        self._number += 1
        which = f"simulation {self._number} of {self._count}"
        self._on_progress(f"Running {self._name}: {which}")
        points, samples = _points(record)
        drives = _inputs_at(record, points)[:, list(self._inputs.values())]
        start = {
            self._starts[self._channels[column]]: float(begin[column])
            for column in self.columns
            if np.isfinite(begin[column])
        }
        found = self._process.simulate(f"record {record.label}", which, points, drives, start)
        result = np.full((len(record.times), len(self._channels)), np.nan)
        result[:, [self._channels.index(name) for name in self.outputs]] = found[samples]
        return result


def _columns_of_inputs(about: Description, inputs: Sequence[str]) -> Mapping[str, int]:
    """Of each input of the FMU the column in the data.

    Raises
    ------
    RigctlError
        the data do not have one.
    """
    for name in about.named("input"):
        if name not in inputs:
            raise RigctlError(
                "the FMU needs an input that the data do not have",
                value=name,
                expected=f"inputs among {', '.join(inputs)}",
                nearest=nearest_name(name, inputs),
                where=Location(about.path),
            )
    return {name: inputs.index(name) for name in about.named("input")}


def _common_outputs(about: Description, channels: Sequence[str]) -> list[str]:
    """The outputs of the FMU that are channels.

    Raises
    ------
    RigctlError
        there are none.
    """
    theirs = about.named("output")
    common = [name for name in channels if name in theirs]
    if not common:
        raise RigctlError(
            "no output of the FMU is a channel",
            value=", ".join(theirs) or "none",
            expected=f"outputs among {', '.join(channels)}",
            where=Location(about.path),
        )
    return common


def _best(simulations: _Simulations, problem: Problem, index: int) -> Floats:
    """The outputs for a record from the initial values at which the FMU fits it best."""
    record, columns = problem.records[index], simulations.columns
    begin, step = _first_readings(problem, index), _BESIDE * problem.sigma[index][0]
    # From the first readings, from each of them shifted by five sigmas, and from where the linear problem has
    # the least error: an FMU gives no derivatives.
    base = simulations.run(record, begin)
    if not columns:
        return base
    units = np.eye(len(begin))
    beside = [simulations.run(record, begin + step * units[column]) for column in columns]
    return simulations.run(record, begin + _shift(problem, index, base, beside, step, columns))


def _first_readings(problem: Problem, index: int) -> Floats:
    """The first valid reading of each channel; NaN if there is none."""
    values, good = problem.records[index].values, problem.ok[index]
    return np.array(
        [values[np.argmax(good[:, k]), k] if good[:, k].any() else np.nan for k in range(good.shape[1])]
    )


def _shift(
    problem: Problem,
    index: int,
    base: Floats,
    beside: Sequence[Floats],
    step: Floats,
    columns: Sequence[int],
) -> Floats:
    """The least-squares change of a record's initial values, by finite differences to the runs `beside`."""
    values = problem.records[index].values

    def residual(outputs: Floats) -> Floats:
        return whitened_residual(problem, np.where(np.isnan(outputs), values, outputs), index)

    at = residual(base)
    changes = [(residual(one) - at) / step[k] for one, k in zip(beside, columns, strict=True)]
    shift = np.zeros(len(step))
    shift[list(columns)] = -np.linalg.lstsq(np.stack(changes, axis=1), at, rcond=None)[0]
    return shift


def _points(record: MeasuredRecord) -> tuple[Floats, NDArray[np.intp]]:
    """The times at which a record is sampled or an input changes, and the indices of its samples in them."""
    begin = record.switch_times[0]
    edges = np.concatenate([record.switch_times, record.knots])
    every = np.concatenate([[begin], record.times, edges])
    every = np.unique(every[(every >= begin) & (every <= max(record.times[-1], begin))])
    points = every[np.concatenate([[True], np.diff(every) > _SAME])]
    last = np.searchsorted(points, record.times + _SAME, side="right") - 1
    return points, np.maximum(last, 0)


def _inputs_at(record: MeasuredRecord, times: Floats) -> Floats:
    """(times, inputs) commanded from each of these times on, SI."""
    switch = np.searchsorted(record.switch_times, times + _SAME, side="right") - 1
    rows = np.array(record.inputs[np.maximum(switch, 0)], dtype=np.float64)
    if record.along:
        knots, lines = record.knots, record.lines
        right = np.clip(np.searchsorted(knots, times, side="right"), 1, len(knots) - 1)
        left = right - 1
        span = knots[right] - knots[left]
        share = np.where(span > 0.0, (times - knots[left]) / np.where(span > 0.0, span, 1.0), 0.0)
        share = np.clip(share, 0.0, 1.0)[:, None]
        rows[:, list(record.along)] = lines[left] + share * (lines[right] - lines[left])
    return rows
