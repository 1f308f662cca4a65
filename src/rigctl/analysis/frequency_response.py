"""Frequency responses of measured records, with coherence, beside those of a model.

The model's is estimated as the measured one is: from its simulation of the same records, with the same
windows or periods. Leakage, the mean over an operating range and other inputs are then equal in both, and a
model need not be linear. The difference is judged by the response of the error, model less measured, in which
all of that cancels where the model is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import ALPHA
from rigctl.dataset.run import Record, Run
from rigctl.errors import RigctlError, unknown_name
from rigctl.expressions import parse, type_of_unit
from rigctl.frequency.response import SHORTEST, Response, Spectrum, estimate
from rigctl.frequency.signals import Floats, Held, Signals
from rigctl.json_values import finite_or_none
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.record import MeasuredRecord
from rigctl.units import interval_unit, parse_unit

Mask = NDArray[np.bool_]

#: an input that changes less than this share of its magnitude is constant
_CONSTANT: Final = 1e-9
#: sampling intervals that differ by less than this share are taken together
_ALIKE: Final = 0.1
#: intervals of a measured input from its nearest reading up to which it is interpolated
_NEAR: Final = 2.0


@dataclass(frozen=True)
class FrequencyResponse:
    """The response of one channel to one input.

    Attributes
    ----------
    input, output: their names; `input_unit` and `output_unit` as they are shown.
    records: labels of those that it was estimated from.
    spectrum: of the measured output; with a model also of the model's and of the error, model less measured.
    others: further inputs that moved, whose part is taken out.
    model: its name, or None.
    """

    input: str
    output: str
    input_unit: str
    output_unit: str
    records: tuple[str, ...]
    spectrum: Spectrum = field(repr=False)
    others: tuple[str, ...] = ()
    model: str | None = None

    @cached_property
    def unit(self) -> str:
        """The unit of its gain: ``K/%``, or ``1``."""
        above, below = interval_unit(self.output_unit), interval_unit(self.input_unit)
        if above == below:
            return "1"
        below = f"({below})" if "*" in below or "/" in below else below
        return above if below == "1" else f"{above}/{below}"

    @cached_property
    def _factor(self) -> float:
        return parse_unit(self.input_unit).factor / parse_unit(self.output_unit).factor

    def gain(self, response: Response) -> NDArray[np.complex128]:
        """(f) a response in `unit`."""
        return response.gain * self._factor

    def radius(self, response: Response) -> Floats:
        """(f) of its 95 % circle, in `unit`."""
        return response.radius * self._factor

    @property
    def measured(self) -> Response:
        """Of the measured output."""
        return self.spectrum.responses[0]

    @property
    def predicted(self) -> Response | None:
        """Of the model's output."""
        return self.spectrum.responses[1] if self.model is not None else None

    @cached_property
    def shown(self) -> Mask:
        """(f) excited lines with more coherence than chance gives, not `folded`; none if it may give all."""
        excited = self.spectrum.excited
        lowest = float(np.min(self.measured.p_value[excited], initial=1.0))
        if lowest * int(excited.sum()) > ALPHA:
            return np.zeros_like(excited)
        known = np.nan_to_num(self.measured.coherence)
        return np.asarray(excited & (known > self.spectrum.least_coherence) & ~self.folded)

    @cached_property
    def folded(self) -> Mask:
        """(f) excited lines at which samples also show the answer to frequencies beyond half their rate."""
        return self.spectrum.folded(self.measured)

    @property
    def band(self) -> tuple[float, float]:
        """The lowest and the highest frequency of `shown`, Hz; NaN where there is none."""
        at = self.spectrum.frequencies[self.shown]
        return (float(at[0]), float(at[-1])) if at.size else (np.nan, np.nan)

    @cached_property
    def differing(self) -> Mask:
        """(f) excited lines at which the model's error follows the input, beyond chance (Bonferroni)."""
        if self.model is None:
            return np.zeros_like(self.spectrum.excited)
        count = max(int(self.spectrum.excited.sum()), 1)
        return np.asarray(self.spectrum.excited & (self.spectrum.responses[2].p_value * count < ALPHA))

    @cached_property
    def worst(self) -> int | None:
        """The number of the differing line that is shown and has the largest ratio of both gains."""
        at = np.flatnonzero(self.differing & self.shown)
        if self.predicted is None or not at.size:
            return None
        with np.errstate(divide="ignore"):  # a model's that does not follow is 0
            ratio = np.abs(np.log(self.predicted.gain[at] / self.measured.gain[at]))
        return int(at[np.argmax(ratio)])

    def document(self) -> dict[str, Any]:
        """The machine-readable answer; only lines that are excited are in it."""
        spectrum = self.spectrum
        settled = spectrum.periods
        return {
            "input": self.input,
            "output": self.output,
            "unit": self.unit,
            "records": list(self.records),
            "other_inputs": list(self.others),
            "model": self.model,
            "method": "periods" if settled else "windows",
            "period": settled[0].length if settled else None,
            "periods_left_out": sum(one.settling for one in settled),
            "segments": spectrum.segments,
            "averages": spectrum.averages,
            "resolution": spectrum.resolution,
            "least_coherence": spectrum.least_coherence,
            "lines_left_out": spectrum.left_out,
            "lines": [self._line(k) for k in np.flatnonzero(spectrum.excited).tolist()],
        }

    def _line(self, k: int) -> dict[str, Any]:
        measured = self.measured
        line: dict[str, Any] = {
            "frequency": float(self.spectrum.frequencies[k]),
            **_polar(self.gain(measured)[k]),
            "radius": finite_or_none(float(self.radius(measured)[k])),
            "coherence": finite_or_none(float(measured.coherence[k])),
            "shown": bool(self.shown[k]),
            "folded": bool(self.folded[k]),
        }
        if self.predicted is not None:
            line["of_model"] = _polar(self.gain(self.predicted)[k])
            line["p_value"] = float(self.spectrum.responses[2].p_value[k])
            line["differs"] = bool(self.differing[k])
        return line


def _polar(gain: complex) -> dict[str, Any]:
    size = abs(gain)
    return {
        "magnitude": finite_or_none(size),
        "phase": finite_or_none(float(np.degrees(np.angle(gain)))) if size else None,
    }


@dataclass(frozen=True)
class _Series:
    """Records as signals by name: inputs first, then outputs, (n, 1) or with the model's (n, 3)."""

    labels: tuple[str, ...]
    times: tuple[Floats, ...]
    inputs: dict[str, tuple[Held | Floats, ...]]
    outputs: dict[str, tuple[Floats, ...]]
    units: dict[str, str]
    model: str | None = None


def frequency_responses(
    runs: Sequence[Run],
    input_name: str | None = None,
    output_name: str | None = None,
    *,
    only: str | None = None,
    resolution: float | None = None,
) -> list[FrequencyResponse]:
    """The responses that the usable records of runs show, of every channel to every actuator that moves.

    Parameters
    ----------
    input_name, output_name: only that actuator or channel, and that channel.
    only: a condition on ``record``, its number from 1, and on sweep variables that selects records.
    resolution: distance between two lines, Hz; see `rigctl.frequency.response.estimate`.

    Raises
    ------
    RigctlError
        a name, condition or resolution is wrong, the input does not move, or the records are too short or
        uneven.
    """
    return _responses(_of_runs(runs, only, input_name), input_name, output_name, resolution)


def responses_of_fit(
    fitted: FitResult,
    name: str,
    input_name: str | None = None,
    output_name: str | None = None,
    *,
    resolution: float | None = None,
) -> list[FrequencyResponse]:
    """The responses that the records of a fit show, beside those of its model, called `name`.

    Raises
    ------
    RigctlError
        as `frequency_responses`; the data are a table without time.
    """
    return responses_of_outputs(
        fitted.problem, dict(enumerate(fitted.outputs)), name, input_name, output_name, resolution=resolution
    )


def responses_of_outputs(
    problem: Problem,
    outputs: Mapping[int, Floats],
    name: str,
    input_name: str | None = None,
    output_name: str | None = None,
    *,
    resolution: float | None = None,
    like: FrequencyResponse | None = None,
) -> list[FrequencyResponse]:
    """The responses that some records show, beside those of a model that was simulated for them.

    Parameters
    ----------
    outputs: (n, channels) of the model, SI, by the index of each record.
    name: of the model.
    like: the response of the same records to another model, which makes this one faster.

    Raises
    ------
    RigctlError
        as `frequency_responses`; the data are a table without time.
    """
    if problem.measurements.table:
        raise RigctlError("a frequency response needs records over time", value="a table")
    return _responses(_of_model(problem, outputs, name), input_name, output_name, resolution, like)


def moving_inputs(problem: Problem, records: Sequence[int]) -> tuple[str, ...]:
    """The model's inputs that move in any of these records."""
    timed = [problem.records[k] for k in _timed(problem, records)]
    names = enumerate(problem.measurements.inputs)
    return tuple(name for k, name in names if any(_moves(_given(record, k)) for record in timed))


def _timed(problem: Problem, records: Sequence[int]) -> list[int]:
    """The records over time: rows of a table may lie between them."""
    return [k for k in records if not problem.records[k].row and problem.records[k].times.size > 1]


def _of_model(problem: Problem, outputs: Mapping[int, Floats], name: str) -> _Series:
    measurements, rig = problem.measurements, problem.measurements.rig
    at = _timed(problem, sorted(outputs))
    records = [problem.records[k] for k in at]
    units = dict(zip(measurements.outputs, measurements.units, strict=True))
    for item in problem.model.family.inputs:
        units[item.name] = item.unit
        if rig is not None and item.name in rig.actuators:
            units[item.name] = rig.actuators[item.name].display_unit
        elif rig is not None and item.name in rig.channels:
            units[item.name] = rig.channels[item.name].unit
    by_channel = {}
    for column, output in enumerate(measurements.outputs):
        pairs = [
            (np.where(problem.ok[k][:, column], record.values[:, column], np.nan), outputs[k][:, column])
            for k, record in zip(at, records, strict=True)
        ]
        by_channel[output] = tuple(np.column_stack([seen, said, said - seen]) for seen, said in pairs)
    return _Series(
        tuple(record.label for record in records),
        tuple(record.times for record in records),
        {item: tuple(_given(one, k) for one in records) for k, item in enumerate(measurements.inputs)},
        by_channel,
        units,
        name,
    )


def _given(record: MeasuredRecord, index: int) -> Held | Floats:
    """An input of a model's record: a command, or what was measured."""
    if index in record.along:
        return record.input_course(index)
    return _within(record.times, record.switch_times, record.inputs[:, index])


def _of_runs(runs: Sequence[Run], only: str | None, input_name: str | None) -> _Series:
    every = [(run, record) for run in runs for record in run.each(run.usable) if record.time.size > 1]
    units = {name: run.layout.unit(name) for run in runs for name in run.layout.signals}
    chosen = _chosen(every, only)
    if not chosen:
        raise RigctlError(
            "no usable record with samples" if only is None else "no record is chosen by this", value=only
        )
    channels = _in_all([record.channels for _, record in chosen])
    commands = _in_all([record.commands for _, record in chosen])
    inputs: dict[str, tuple[Held | Floats, ...]] = {
        name: tuple(_commanded(record, name) for _, record in chosen) for name in commands
    }
    if input_name in channels:
        inputs[input_name] = tuple(record.channels[input_name] for _, record in chosen)
    return _Series(
        tuple(f"{run.id}/{record.index + 1}" for run, record in chosen),
        tuple(record.time for _, record in chosen),
        inputs,
        {
            name: tuple(record.channels[name][:, None] for _, record in chosen)
            for name in channels
            if name != input_name
        },
        units,
    )


def _in_all(each: Sequence[Any]) -> list[str]:
    """The names that every record has, in the order of the first."""
    return [name for name in each[0] if all(name in one for one in each)]


def _commanded(record: Record, name: str) -> Held:
    """A command by the exact times of its changes."""
    given = [one for one in record.switches if one.actuator == name]
    first = record.commands[name][0]
    times = np.array([float(record.time[0]), *(one.time for one in given)])
    values = np.array([first if np.isfinite(first) else 0.0, *(one.value for one in given)])
    order = np.argsort(times, kind="stable")
    return _within(record.time, times[order], values[order])


def _within(samples: Floats, times: Floats, values: Floats) -> Held:
    """A command without what changes with the last sample, or later: nothing in the record follows that."""
    before = times < samples[-1]
    before[0] = True
    return Held(times[before], values[before])


def _chosen(every: list[tuple[Run, Record]], only: str | None) -> list[tuple[Run, Record]]:
    if only is None or not only.strip():
        return every
    types = {"record": type_of_unit("1")}
    for run in dict.fromkeys(run.id for run, _ in every):
        (units,) = {tuple(one.record_units.items()) for one, _ in every if one.id == run}
        types |= {name: type_of_unit(unit) for name, unit in units}
    expression = parse(only)
    if not expression.check(types).boolean:
        raise RigctlError("records are chosen by a condition", value=only, expected="e.g. 'record == 2'")
    condition = expression.checked(types)
    return [
        one
        for number, one in enumerate(every, start=1)
        if condition.evaluate({"record": float(number), **one[1].sweep})
    ]


def _responses(
    series: _Series,
    input_name: str | None,
    output_name: str | None,
    resolution: float | None,
    like: FrequencyResponse | None = None,
) -> list[FrequencyResponse]:
    if input_name is not None and input_name not in series.inputs:
        raise unknown_name("input", input_name, series.inputs)
    if output_name is not None and output_name not in series.outputs:
        raise unknown_name("output", output_name, series.outputs)
    if resolution is not None and not 0.0 < resolution < np.inf:
        raise RigctlError("a resolution is a frequency above zero", value=f"{resolution:g} Hz")
    moving = [name for name, each in series.inputs.items() if any(map(_moves, each))]
    if input_name is not None and input_name not in moving:
        hint = f"Inputs that move: {', '.join(moving)}" if moving else None
        raise RigctlError("this input does not move in these records", value=input_name, hint=hint)
    if not moving:
        raise RigctlError("no input moves in these records: they show no frequency response")
    found = [
        _response(series, one, [other for other in moving if other != one], output, resolution, like)
        for one in ([input_name] if input_name is not None else moving)
        for output in ([output_name] if output_name is not None else series.outputs)
    ]
    known = [one for one in found if one is not None]
    if not known:
        raise RigctlError("no channel besides the input has readings in these records")
    return known


def _moves(values: Held | Floats) -> bool:
    course = values.values if isinstance(values, Held) else values[np.isfinite(values)]
    return course.size > 0 and float(np.ptp(course)) > _CONSTANT * float(np.max(np.abs(course)))


def _response(
    series: _Series,
    asked: str,
    others: Sequence[str],
    output: str,
    resolution: float | None,
    like: FrequencyResponse | None,
) -> FrequencyResponse | None:
    """One response, from the records that are sampled evenly and alike; None without readings."""
    # Windows and periods of all records are averaged, so that these must be sampled evenly and alike: a
    # record that is not is left out, and named only if none remains.
    signals = [
        _signals(times, [series.inputs[name][k] for name in (asked, *others)], series.outputs[output][k])
        for k, times in enumerate(series.times)
    ]
    with_readings = [k for k, one in enumerate(signals) if np.isfinite(one.outputs).all(axis=1).sum() > 1]
    if not with_readings:
        return None
    even = [k for k in with_readings if not signals[k].uneven]
    if not even:
        raise RigctlError(
            "these records are sampled too unevenly for a frequency response",
            value=f"{output} in {', '.join(series.labels[k] for k in with_readings[:3])}",
            expected="intervals that differ by less than a quarter",
        )
    usual = float(np.median([signals[k].interval for k in even]))
    alike = [k for k in even if abs(signals[k].interval - usual) <= _ALIKE * usual]
    if resolution is not None and resolution * usual * SHORTEST > 1.0:
        raise RigctlError(
            "this resolution is too coarse for these records",
            value=f"{resolution:g} Hz",
            expected=f"at most {1.0 / (usual * SHORTEST):.3g} Hz, windows of {SHORTEST} samples",
        )
    labels = tuple(series.labels[k] for k in alike)
    same = like is not None and (like.input, like.output, like.records) == (asked, output, labels)
    spectrum = estimate([signals[k] for k in alike], resolution, like.spectrum if like and same else None)
    if spectrum is None:
        raise RigctlError(
            "these records are too short for a frequency response",
            value=f"{max(signals[k].times.size for k in alike)} samples of {output}"
            + ("" if resolution is None else f" at a resolution of {resolution:g} Hz"),
            expected="two windows or periods in the longest",
        )
    return FrequencyResponse(
        asked,
        output,
        series.units[asked],
        series.units[output],
        labels,
        spectrum,
        tuple(others),
        series.model,
    )


def _signals(times: Floats, inputs: Sequence[Held | Floats], outputs: Floats) -> Signals:
    """The signals of a record, in the rows that have a reading of the output: other devices' have none."""
    rows = np.asarray(np.isfinite(outputs).all(axis=1), dtype=np.bool_)
    at, left = times[rows], outputs[rows]
    given: list[Held | Floats] = []
    for values in inputs:
        if isinstance(values, Held):
            given.append(values)
            continue
        known, filled = _at(times, values, rows)
        given.append(filled)
        left = np.where(known[:, None], left, np.nan)
    return Signals(at, tuple(given), left)


def _at(times: Floats, values: Floats, rows: Mask) -> tuple[Mask, Floats]:
    """Where a measured input is known in the rows of an output, and its values there.

    A row that lacks it is left out; one of another device, which has rows of its own, is interpolated.
    """
    good, at = np.isfinite(values), times[rows]
    if not good.any():
        return good[rows], np.zeros(at.size)
    own = times[good]
    filled = np.interp(at, own, values[good])
    if 2 * int((good & rows).sum()) >= at.size or own.size < 2:
        return good[rows], filled
    following = np.clip(np.searchsorted(own, at), 1, own.size - 1)
    distance = np.minimum(np.abs(own[following] - at), np.abs(at - own[following - 1]))
    return np.asarray(distance <= _NEAR * float(np.median(np.diff(own)))), filled
