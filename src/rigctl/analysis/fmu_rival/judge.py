"""Which of an FMU and a fitted model is nearer to the measurements, and whether these records can tell.

An FMU is not tested for adequacy: its unknowns (initial states, switch times) cannot be fitted as a model's
can, and a right FMU that starts one standard deviation of the noise beside the truth would be rejected.

For the same reason a record counts only if the two differ by more than a fit can absorb. With k free values
in a record, its own and its part of the shared ones, a fit lowers χ² by k ± √(2k) although nothing is better.

Where only the white floor of a channel's noise is known, χ² is in units of what the better of the two leaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison_result import in_unit
from rigctl.analysis.decision_levels import ALPHA, QUANTILE
from rigctl.analysis.fitting import noise_in
from rigctl.analysis.fmu_rival.run import FmuOutputs, run_fmu
from rigctl.errors import RigctlError
from rigctl.foreign.process import PATIENCE
from rigctl.json_values import finite_or_none
from rigctl.model.fit.errors import ChannelError, channel_errors, whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.clocks import clocks_of
from rigctl.model.measured.standing import with_what_is_left
from rigctl.notebook import worded

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FmuRival:
    """An FMU compared with a model, on the records that no fit saw if there are any.

    Attributes
    ----------
    name: of the file; `model` that of the model.
    channels: the FMU's errors, by channel; `beside` those of the model on the same readings.
    units: of the channels, as they are shown.
    records: number of records compared. In `nearer` of them the FMU is nearer, in `further` the model; in the
        others the difference is no more than a fit absorbs.
    p_value: of the two-sided sign test on these two numbers.
    held_out: the records are those that no fit saw.
    missing: channels that the FMU does not have; `own_initial_values` those whose initial value cannot be
        set, so that every record starts from the FMU's own.
    """

    name: str
    model: str
    channels: dict[str, ChannelError]
    beside: dict[str, ChannelError]
    units: dict[str, str]
    records: int
    nearer: int
    further: int
    p_value: float
    held_out: bool
    missing: tuple[str, ...]
    own_initial_values: tuple[str, ...]

    @property
    def decided(self) -> bool:
        """Whether these records show which of the two is nearer."""
        return self.p_value < ALPHA

    @property
    def statement(self) -> str:
        """One plain sentence."""
        return worded(self, "fmu_rival.statement")

    def document(self) -> dict[str, Any]:
        """Its part of the machine-readable answer."""
        return {
            "fmu": self.name,
            "model": self.model,
            "channels": {
                name: {
                    **in_unit(error, self.units[name]),
                    "nrmse": error.nrmse,
                    "r2": finite_or_none(error.r2),
                }
                for name, error in self.channels.items()
            },
            "records": self.records,
            "nearer": self.nearer,
            "further": self.further,
            "p_value": self.p_value,
            "held_out": self.held_out,
            "missing": list(self.missing),
            "begins_elsewhere": list(self.own_initial_values),
            "statement": self.statement,
        }


def judge_fmu(
    path: Path,
    fitted: FitResult,
    model: str,
    on_progress: Callable[[str], None] = lambda text: None,
    patience: float = PATIENCE,
) -> FmuRival:
    """Run an FMU on the records of a fit, and decide which of the two is nearer to the measurements.

    Parameters
    ----------
    on_progress: called with a description of the current simulation.
    patience: longest time of one simulation of a record, s.

    Raises
    ------
    RigctlError
        the data are a table without time, or as `run_fmu`.
    """
    problem = fitted.problem
    if problem.measurements.table:
        raise RigctlError("an FMU needs records over time", value="a table")
    clocks = clocks_of(problem.measurements)
    if clocks:
        raise RigctlError(
            "an FMU is simulated at the times that the records say, and a clock of the rig file may be off",
            value=clocks[0].clock,
            hint="Compare it with a rig file without clocks",
        )
    # The sign test counts records, not readings: what both models lack makes the readings of a record
    # dependent.
    simulated = run_fmu(path, fitted, on_progress, patience)
    indices = fitted.held_out or fitted.fitted
    theirs, ours = _alike(fitted, simulated)
    names = [name for name in problem.measurements.outputs if name in simulated.outputs]
    problem = _in_scale_of_better(fitted, theirs, ours, indices)
    differences = [_difference(fitted, problem, theirs, ours, index) for index in indices]
    nearer, further = (sum(sign == wanted for sign in differences) for wanted in (-1, 1))
    fmu_errors, model_errors = (
        channel_errors(problem, theirs, indices),
        channel_errors(problem, ours, indices),
    )
    return FmuRival(
        name=path.name,
        model=model,
        channels={name: error for name, error in fmu_errors.items() if name in names},
        beside={name: error for name, error in model_errors.items() if name in names},
        units=dict(zip(problem.measurements.outputs, problem.measurements.units, strict=True)),
        records=len(indices),
        nearer=nearer,
        further=further,
        p_value=sign_test(nearer, nearer + further),
        held_out=bool(fitted.held_out),
        missing=tuple(name for name in problem.measurements.outputs if name not in simulated.outputs),
        own_initial_values=tuple(name for name in names if name not in simulated.settable),
    )


def sign_test(nearer: int, count: int) -> float:
    """Two-sided p-value of `nearer` successes in `count` throws of a fair coin; 1 for none."""
    fewer = min(nearer, count - nearer)
    tail = sum(math.comb(count, k) for k in range(fewer + 1))
    return min(1.0, 2.0 * tail / 2**count) if count else 1.0


def _alike(fitted: FitResult, simulated: FmuOutputs) -> tuple[Sequence[Floats], Sequence[Floats]]:
    """Outputs of the FMU and of the fit; channels that the FMU lacks get no error, and so do not count."""
    theirs, ours = [], []
    for record, fmu_values, model_values in zip(
        fitted.problem.records, simulated.records, fitted.outputs, strict=True
    ):
        absent = np.isnan(fmu_values)
        theirs.append(np.where(absent, record.values, fmu_values))
        ours.append(np.where(absent, record.values, model_values))
    return theirs, ours


def _in_scale_of_better(
    fitted: FitResult, theirs: Sequence[Floats], ours: Sequence[Floats], indices: Sequence[int]
) -> Problem:
    """The problem with what the better of the two leaves of a channel as the scale of its errors."""
    problem = fitted.problem

    def squares(outputs: Sequence[Floats]) -> Floats:
        errors = [
            np.where(problem.ok[k], outputs[k] - problem.records[k].values, 0.0) / problem.sigma[k]
            for k in indices
        ]
        return np.asarray(np.square(np.concatenate(errors)).sum(axis=0))

    nearer = squares(theirs) < squares(ours)
    better = [np.where(nearer, one, other) for one, other in zip(theirs, ours, strict=True)]
    noise = with_what_is_left(noise_in(fitted), problem.measurements, better, indices)
    return problem if noise is None else problem.for_model(problem.model, noise.model, noise.ok)


def _difference(
    fitted: FitResult, problem: Problem, theirs: Sequence[Floats], ours: Sequence[Floats], index: int
) -> int:
    """-1 if the FMU is nearer in a record, 1 if the model is, 0 if a fit could cause the difference."""
    fmu_chi2, model_chi2 = (
        float(np.square(whitened_residual(problem, outputs[index], index)).sum())
        for outputs in (theirs, ours)
    )
    free = float(len(problem.local_unknowns()[index]))
    if fitted.solution is not None and index in fitted.fitted:
        free += len(problem.shared) / len(fitted.fitted)
    allowance = free + QUANTILE * math.sqrt(2.0 * free)
    return 0 if abs(fmu_chi2 - model_chi2) <= allowance else int(math.copysign(1.0, fmu_chi2 - model_chi2))
