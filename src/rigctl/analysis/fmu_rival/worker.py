"""Runs an FMU on records, in a separate process: ``python -m rigctl.analysis.fmu_rival.worker JOB ANSWER``.

An FMU is a compiled program. If it crashes or never returns, only this process is lost. Before each
simulation a line on stdout says which one it is, ``12 56`` for the twelfth of 56.
Only FMI 2.0 for co-simulation is supported, through FMPy.
"""

from __future__ import annotations

import json
import math
import os
import sys
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rigctl.analysis.fmu_rival.archive import checked_platforms
from rigctl.errors import RigctlError, nearest_name
from rigctl.units import parse_unit

#: possible names of the variable that sets a channel's initial value
_STARTS = ("state.{}", "{}_start", "{}_0")
#: two times closer than this are equal, s
_SAME = 1e-12


class _Fmu:
    """An FMU's variables by name, with the units in which they are read and written."""

    def __init__(self, path: Path, folder: str) -> None:
        from fmpy import extract, platform, read_model_description

        platforms = checked_platforms(path)
        try:
            self.description: Any = read_model_description(str(path))
        except Exception as problem:
            raise RigctlError(f"the description of the FMU cannot be read: {problem}") from problem
        if self.description.fmiVersion != "2.0" or self.description.coSimulation is None:
            raise RigctlError(
                "an unsupported kind of FMU",
                value=f"FMI {self.description.fmiVersion}",
                expected="2.0, co-simulation",
            )
        if platform not in platforms:
            raise RigctlError(
                "the FMU has no program for this computer",
                value=", ".join(platforms) or "sources alone",
                expected=platform,
            )
        self.folder: str = extract(str(path), folder)
        self._by_name = {one.name: one for one in self.description.modelVariables if one.type == "Real"}

    def named(self, causality: str) -> list[str]:
        """The names of its real inputs or outputs."""
        return [name for name, one in self._by_name.items() if one.causality == causality]

    def start_of(self, channel: str) -> str | None:
        """The variable that sets a channel's initial value; None if there is none."""
        for pattern in _STARTS:
            one = self._by_name.get(pattern.format(channel))
            if one is not None and (one.causality == "parameter" or one.initial == "exact"):
                return str(one.name)
        return None

    def reference(self, name: str) -> int:
        """Its value reference."""
        return int(self._by_name[name].valueReference)

    def to_si(self, name: str, value: float) -> float:
        """A variable's value in SI; one without a unit is in SI already."""
        return float(self._unit(name).to_si(value))

    def from_si(self, name: str, value: float) -> float:
        """An SI value in a variable's unit."""
        return float(self._unit(name).from_si(value))

    def _unit(self, name: str) -> Any:
        one = self._by_name[name]
        declared = getattr(one.declaredType, "unit", None) if one.declaredType is not None else None
        return parse_unit(one.unit or declared or "1")


def simulate(job: Mapping[str, Any], folder: str, on_progress: Callable[[str], None]) -> dict[str, Any]:
    """The outputs of every record: by record, by sample, in the order of the FMU's outputs.

    Parameters
    ----------
    folder: where it is unpacked.
    on_progress: called with the number of each simulation before it, and their total.

    Raises
    ------
    RigctlError
        the FMU is not supported, none of its outputs is a channel, an input is unknown, or a step fails.
    """
    fmu = _Fmu(Path(job["fmu"]), folder)
    inputs = fmu.named("input")
    for name in inputs:
        if name not in job["inputs"]:
            raise RigctlError(
                "the FMU needs an input that the data do not have",
                value=name,
                expected=f"inputs among {', '.join(job['inputs'])}",
                nearest=nearest_name(name, job["inputs"]),
            )
    outputs = [name for name in job["outputs"] if name in fmu.named("output")]
    if not outputs:
        raise RigctlError(
            "no output of the FMU is a channel",
            value=", ".join(fmu.named("output")) or "none",
            expected=f"outputs among {', '.join(job['outputs'])}",
        )
    starts = {channel: fmu.start_of(channel) for channel in job["outputs"]}
    results = []
    for number, record in enumerate(job["records"], start=1):
        on_progress(f"{number} {len(job['records'])}")
        results.append(_record(fmu, job, record, inputs, outputs, starts))
    settable = [channel for channel, variable in starts.items() if variable is not None]
    return {"outputs": outputs, "records": results, "settable": settable}


def _record(
    fmu: _Fmu,
    job: Mapping[str, Any],
    record: Mapping[str, Any],
    inputs: Sequence[str],
    outputs: Sequence[str],
    starts: Mapping[str, str | None],
) -> list[list[float]]:
    """Simulate one record; communication points are its samples and its switches."""
    from fmpy.simulation import instantiate_fmu

    signal = _Signal(job["inputs"], record)
    written = [fmu.reference(name) for name in inputs]
    read = [fmu.reference(name) for name in outputs]
    try:
        slave = instantiate_fmu(fmu.folder, fmu.description, "CoSimulation")
    except Exception as problem:
        raise RigctlError(f"the FMU does not start: {problem}") from problem
    time = signal.begin
    values: list[list[float]] = []
    try:
        slave.setupExperiment(startTime=time, tolerance=1e-8)
        for channel, variable in starts.items():
            if variable is not None and channel in record["start"]:
                slave.setReal([fmu.reference(variable)], [fmu.from_si(variable, record["start"][channel])])
        _set(slave, fmu, written, inputs, signal.at(time))
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        points = sorted({*record["times"], *(at for at in signal.edges if at > time)})
        wanted = set(record["times"])
        for point in points:
            if point > time + _SAME:
                slave.doStep(currentCommunicationPoint=time, communicationStepSize=point - time)
                time = point
            if point in wanted:  # a sample at a switch shows the state before it
                row = slave.getReal(read)
                values.append(
                    [fmu.to_si(name, _finite(name, v)) for name, v in zip(outputs, row, strict=True)]
                )
            _set(slave, fmu, written, inputs, signal.at(time))
        slave.terminate()
    except Exception as problem:
        raise RigctlError(
            f"the FMU failed in record {record['label']} at {time:.4g} s: {problem}"
        ) from problem
    finally:
        slave.freeInstance()
    return values


def _finite(name: str, value: float) -> float:
    """The value if it is finite, since NaN stands for an output that the FMU lacks; else ValueError."""
    if not math.isfinite(value):
        raise ValueError(f"{name} is {value}")
    return value


def _set(
    slave: Any, fmu: _Fmu, written: Sequence[int], names: Sequence[str], si: Mapping[str, float]
) -> None:
    if written:
        slave.setReal(list(written), [fmu.from_si(name, si[name]) for name in names])


class _Signal:
    """The inputs of a record over time: held constant, or interpolated linearly."""

    def __init__(self, names: Sequence[str], record: Mapping[str, Any]) -> None:
        self._names = names
        self._times: list[float] = record["switch_times"]
        self._inputs: list[list[float]] = record["inputs"]
        self._along: list[int] = record["along"]
        self._knots: list[float] = record["knots"]
        self._lines: list[list[float]] = record["lines"]
        self.begin = self._times[0]
        self.edges = (*self._times, *self._knots)

    def at(self, time: float) -> dict[str, float]:
        """The inputs from a time on, by name, SI."""
        row = list(self._inputs[max(bisect_right(self._times, time + _SAME) - 1, 0)])
        for index, column in enumerate(self._along):
            row[column] = self._line(time, index)
        return dict(zip(self._names, row, strict=True))

    def _line(self, time: float, index: int) -> float:
        right = min(max(bisect_right(self._knots, time), 1), len(self._knots) - 1)
        left = right - 1
        span = self._knots[right] - self._knots[left]
        share = min(max((time - self._knots[left]) / span, 0.0), 1.0) if span > 0.0 else 0.0
        low, high = self._lines[left][index], self._lines[right][index]
        return low + share * (high - low)


def main(job: str, answer: str) -> None:
    """Read the job and write the answer, the results or the error; unpack beside it, and leave that there."""
    folder = Path(answer).with_name("unpacked")
    folder.mkdir()
    with os.fdopen(os.dup(1), "w", encoding="ascii") as progress, Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)  # an FMU may print what it likes, and is not read
        try:
            result = simulate(
                json.loads(Path(job).read_text("utf-8")),
                str(folder),
                lambda text: print(text, file=progress, flush=True),
            )
        except RigctlError as error:
            result = error.as_dict()
    Path(answer).write_text(json.dumps(result), "utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
