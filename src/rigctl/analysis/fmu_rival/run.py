"""Hands records to the process that runs an FMU, and reads its answer."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.fmu_rival.archive import checked_platforms
from rigctl.child_process import module_command
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.json_values import parse_json
from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]

#: shift of an initial value for its derivative, in sigmas
_BESIDE: Final = 5.0
#: longest time of one simulation of a record by default, s
PATIENCE: Final = 60.0
#: interval at which the process is polled for its end, s
_LOOK: Final = 0.2


@dataclass(frozen=True)
class FmuOutputs:
    """The outputs of an FMU: for each record (samples, outputs) in SI, NaN in columns that it does not have.

    `settable` names the channels whose initial value could be set.
    """

    outputs: tuple[str, ...]
    records: tuple[Floats, ...]
    settable: frozenset[str]


def require_fmu(path: Path) -> None:
    """Refuse a file that is no FMU, before any work is done; what it describes is read by `run_fmu`.

    Raises
    ------
    RigctlError
        FMPy is not installed, or as `checked_platforms`.
    """
    if find_spec("fmpy") is None:
        raise RigctlError("running an FMU needs FMPy", hint="pip install 'rigctl[fmu]'")
    checked_platforms(path)


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
    require_fmu(path)
    problem = fitted.problem
    names = problem.measurements.outputs
    starts = [_first_readings(problem, index) for index in range(len(problem.records))]
    steps = [_BESIDE * problem.sigma[index][0] for index in range(len(problem.records))]
    tried = [
        [begin, *(begin + step * unit for unit in np.eye(len(names)))]
        for begin, step in zip(starts, steps, strict=True)
    ]
    reply = _simulated(path, fitted, tried, on_progress, patience)
    settable = frozenset(reply["settable"])
    columns = [column for column, name in enumerate(names) if name in settable]
    outputs = _outputs(reply, fitted, len(names) + 1)
    if columns:
        best = [
            [begin + _shift(problem, index, outputs[index], step, columns)]
            for index, (begin, step) in enumerate(zip(starts, steps, strict=True))
        ]
        outputs = _outputs(_simulated(path, fitted, best, on_progress, patience), fitted, 1)
    return FmuOutputs(tuple(reply["outputs"]), tuple(record[0] for record in outputs), settable)


def _first_readings(problem: Problem, index: int) -> Floats:
    """The first valid reading of each channel; NaN if there is none."""
    values, good = problem.records[index].values, problem.ok[index]
    return np.array(
        [values[np.argmax(good[:, k]), k] if good[:, k].any() else np.nan for k in range(good.shape[1])]
    )


def _shift(
    problem: Problem, index: int, runs: Sequence[Floats], step: Floats, columns: Sequence[int]
) -> Floats:
    """The least-squares change of a record's initial values, by finite differences between `runs`."""
    values = problem.records[index].values
    base, *beside = (np.where(np.isnan(outputs), values, outputs) for outputs in runs)
    residual = whitened_residual(problem, base, index)
    changes = [whitened_residual(problem, beside[k], index) - residual for k in columns]
    jacobian = np.stack([change / step[k] for change, k in zip(changes, columns, strict=True)], axis=1)
    shift = np.zeros(len(step))
    shift[list(columns)] = -np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    return shift


def _simulated(
    path: Path,
    fitted: FitResult,
    starts: Sequence[Sequence[Floats]],
    on_progress: Callable[[str], None],
    patience: float,
) -> dict[str, Any]:
    """The outputs of the process for every record from each of its initial values."""
    with TemporaryDirectory(prefix="rigctl-fmu-", ignore_cleanup_errors=True) as folder:
        job, answer = Path(folder) / "job.json", Path(folder) / "answer.json"
        job.write_text(json.dumps(_job(path, fitted, starts)), "utf-8")
        command = module_command("rigctl.analysis.fmu_rival.worker", str(job), str(answer))
        code = _watched(path, command, on_progress, patience)
        if not answer.exists():
            raise RigctlError(
                f"the FMU has crashed (exit code {code})",
                where=Location(path),
                exit_code=ExitCode.FAILED,
            )
        reply: dict[str, Any] = parse_json(answer.read_text("utf-8"))
    if "what" in reply:
        raise RigctlError(
            reply["what"],
            value=reply["value"],
            expected=reply["expected"],
            nearest=reply["nearest"],
            hint=reply["hint"],
            where=Location(path),
        )
    return reply


def _watched(path: Path, command: Sequence[str], on_progress: Callable[[str], None], patience: float) -> int:
    """Run the process to its end, which comes soon after an exception such as that of Ctrl-C; its exit code.

    Raises
    ------
    RigctlError
        a simulation takes longer than `patience` s.
    """
    with subprocess.Popen(  # noqa: S603 - the user has named this FMU to be run
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        lines: SimpleQueue[bytes] = SimpleQueue()
        reader = threading.Thread(target=_read_lines, args=(process, lines), daemon=True)
        reader.start()
        number, count, since = 0, 0, time.monotonic()
        try:
            while process.poll() is None:
                with suppress(Empty, ValueError):
                    number, count = map(int, lines.get(timeout=_LOOK).split())
                    since = time.monotonic()
                    on_progress(f"Running {path.name}: simulation {number} of {count}")
                allowed = patience if number else max(patience, PATIENCE)  # which includes the imports
                if time.monotonic() - since > allowed:
                    what = f"finished simulation {number} of {count}" if number else "been loaded"
                    raise RigctlError(
                        f"the FMU has not {what} in {allowed:g} s",
                        where=Location(path),
                        hint="'--rival-timeout' sets this time, e.g. '10 min'",
                        exit_code=ExitCode.FAILED,
                    )
        finally:
            process.kill()
            reader.join()
        return process.wait()


def _read_lines(process: subprocess.Popen[bytes], lines: SimpleQueue[bytes]) -> None:
    """Forward the progress lines of the process; in a thread, because reading a line blocks."""
    for line in process.stdout or ():
        lines.put(line)


def _outputs(reply: dict[str, Any], fitted: FitResult, runs: int) -> list[list[Floats]]:
    """By record and start (samples, outputs); NaN in columns that the FMU does not have."""
    names = fitted.problem.measurements.outputs
    columns = [names.index(name) for name in reply["outputs"]]
    answers = iter(reply["records"])
    result = []
    for record in fitted.problem.records:
        of_record = []
        for _ in range(runs):
            outputs = np.full((len(record.times), len(names)), np.nan)
            rows = np.asarray(next(answers), dtype=np.float64)
            outputs[:, columns] = rows.reshape(len(record.times), len(columns))
            of_record.append(outputs)
        result.append(of_record)
    return result


def _job(path: Path, fitted: FitResult, starts: Sequence[Sequence[Floats]]) -> dict[str, Any]:
    measurements = fitted.problem.measurements
    records = []
    for record, tried in zip(fitted.problem.records, starts, strict=True):
        facts = {
            "label": record.label,
            "times": record.times.tolist(),
            "switch_times": record.switch_times.tolist(),
            "inputs": record.inputs.tolist(),
            "along": list(record.along),
            "knots": record.knots.tolist(),
            "lines": record.lines.tolist(),
        }
        for begin in tried:
            first = zip(measurements.outputs, begin.tolist(), strict=True)
            records.append({**facts, "start": {name: value for name, value in first if np.isfinite(value)}})
    return {
        "fmu": str(path.resolve()),
        "inputs": list(measurements.inputs),
        "outputs": list(measurements.outputs),
        "records": records,
    }
