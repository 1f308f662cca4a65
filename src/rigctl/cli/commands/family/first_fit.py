"""A draft model fitted once to the file from which it was drafted, and a plot of both.

In: a `Proposal` whose files are written, and the run that its log became. Out: a `FirstFit`: errors in
the units of the outputs, the share of the variance explained, and a figure. The fit is not kept: it shows
whether the drafted equations are worth editing, before the user has written any.

A fit that fails is a result too, with its reason, and measurements are plotted all the same: the files
are there to be corrected. An FMU is not simulated here, as a draft reads its description and no more.
Below `ENOUGH`, the user is told that this is no model yet, and which template would leave less.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.errors import RigctlError
from rigctl.units import parse_unit, significant

if TYPE_CHECKING:
    from rigctl.model.fit.fit import FitResult
    from rigctl.proposal.columns import Column, Table
    from rigctl.proposal.propose import Proposal
    from rigctl.report.plot import Panel, Trace


#: a first fit that explains less of an output is no model of it yet
ENOUGH = 0.9


@dataclass(frozen=True)
class FirstFit:
    """The result of the first fit.

    Attributes
    ----------
    rmse: of each output, in its unit; `span` is the output's range.
    explained: of each output, the share of its variance, R².
    problem: why there is no fit; "" if there is one.
    """

    plot: Path | None
    rmse: Mapping[str, float] = field(default_factory=dict)
    span: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    explained: Mapping[str, float] = field(default_factory=dict)
    problem: str = ""

    def lines(self) -> list[str]:
        """Lines for the terminal."""
        texts = [
            f"first fit: {name} within {f'{significant(value, 3)} {self.units[name]}'.strip()} (RMSE), "
            f"{value / self.span[name]:.1%} of its range; explains {self.explained[name]:.0%} of its variance"
            for name, value in self.rmse.items()
            if self.span[name] > 0.0
        ]
        texts += [
            f"Warning: the first fit explains only {share:.0%} of {name}. This is not yet a model of it; "
            "'--template' drafts the equations of a motor, heater, tank or flow"
            for name, share in self.explained.items()
            if share < ENOUGH
        ]
        texts += [f"no first fit: {self.problem}"] if self.problem else []
        return texts + ([f"drawn in {self.plot}"] if self.plot is not None else [])

    def other_template(self, proposal: Proposal) -> str | None:
        """A template that is worth the next try, where this one explains too little."""
        if proposal.suggestion is None or proposal.template is None:
            return None
        if not self.explained or min(self.explained.values()) >= ENOUGH:
            return None
        left = 1.0 - sum(self.explained.values()) / len(self.explained)
        return proposal.suggestion.better_than(proposal.template, left)

    def document(self) -> dict[str, Any]:
        """For programs."""
        outputs = {
            name: {
                "rmse": value,
                "unit": self.units[name],
                "range": self.span[name],
                "explained": self.explained[name],
            }
            for name, value in self.rmse.items()
        }
        return {"outputs": outputs, "problem": self.problem or None}


def first_fit(proposal: Proposal, root: Path, run: Path, *, fit: bool) -> FirstFit:
    """Fit the model to the run of its log, and plot both."""
    result, problem = None, "" if fit else "not asked for"
    if proposal.fmu is not None:
        problem = f"{proposal.fmu} is not run here; 'rigctl compare' does, below"
    if fit:
        try:
            result = _fitted(proposal, root, run)
        except RigctlError as error:
            problem = str(error)
    plot = _draw(proposal, root, result)
    if result is None:
        return FirstFit(plot, problem=problem)
    rmse, span, units, explained = {}, {}, {}, {}
    for index, name in enumerate(result.problem.measurements.outputs):
        column = proposal.table.column(name)
        errors, readings = _errors(result, index)
        if errors.size:
            between = parse_unit(column.interval)
            rmse[name] = between.from_si(float(np.sqrt(np.mean(errors**2))))
            span[name] = between.from_si(float(np.nanmax(column.values) - np.nanmin(column.values)))
            units[name] = column.interval if column.interval != "1" else ""
            explained[name] = 1.0 - float(np.mean(errors**2) / np.var(readings)) if np.ptp(readings) else 0.0
    return FirstFit(plot, rmse, span, units, explained)


def _errors(result: FitResult, index: int) -> tuple[np.ndarray, np.ndarray]:
    """The errors of an output, and its readings."""
    records = result.problem.measurements.records
    readings = np.concatenate([record.values[:, index] for record in records])
    errors = readings - np.concatenate([prediction[:, index] for prediction in result.outputs])
    here = np.isfinite(errors)
    return np.asarray(errors[here]), np.asarray(readings[here])


def _fitted(proposal: Proposal, root: Path, run: Path) -> FitResult:
    from rigctl.analysis.fitting import fit_to_data, read_runs
    from rigctl.cli.progress import progress_display
    from rigctl.dataset import open_run
    from rigctl.model import load_model

    with progress_display("Reading the records", "the files are there") as on_progress:
        model = load_model(root / proposal.model)
        data = read_runs(model, [open_run(run)], on_progress=on_progress)
        return fit_to_data(model, data, on_progress=on_progress)


def _draw(proposal: Proposal, root: Path, result: FitResult | None) -> Path | None:
    from rigctl.report.figure_files import write_figure
    from rigctl.report.plot import Plot

    table = proposal.table
    x, title = _axis(table)
    shown = [column for column in table.columns if column.role != "left out"]
    panels = tuple(_panel(column, table, x, result) for column in shown)
    if not panels:
        return None
    subtitle = "measured, and the draft after one fit" if result is not None else "measured"
    plot = Plot(f"{proposal.name}-first-look", f"{proposal.name}: {subtitle}", title, panels)
    folder = root / "figures"
    folder.mkdir(exist_ok=True)
    return write_figure(plot, folder)


def _axis(table: Table) -> tuple[np.ndarray, str]:
    """Time, records one after another; for a table its first input."""
    if table.times is None:
        column = next((c for c in table.columns if c.role == "input"), table.columns[0])
        return column.shown, f"{column.name} [{column.unit}]"
    x, offset = np.empty(table.times.size), 0.0
    for rows in table.pieces:
        times = table.times[rows]
        x[rows] = times - times[0] + offset
        offset = float(x[rows][-1])
    return x, "time [s]" if len(table.pieces) == 1 else "time [s], records one after the other"


def _panel(column: Column, table: Table, x: np.ndarray, result: FitResult | None) -> Panel:
    from rigctl.report.plot import Look, Panel, Trace

    points = table.times is None
    look = Look.POINTS if points else Look.STEP if column.stepped else Look.LINE
    measured = Trace("measured", x, column.shown, look, colour=0, unit=column.unit)
    return Panel(f"{column.name} [{column.unit}]", (measured, *_fit_traces(column, table, x, result)))


def _fit_traces(column: Column, table: Table, x: np.ndarray, result: FitResult | None) -> list[Trace]:
    from rigctl.report.plot import Look, Trace

    if result is None or column.name not in result.problem.measurements.outputs:
        return []
    index = result.problem.measurements.outputs.index(column.name)
    values = np.concatenate([prediction[:, index] for prediction in result.outputs])
    if values.size != x.size:  # rows were left out
        return []
    shown = (values - column.display.offset) / column.display.factor
    look = Look.MARKED if table.times is None else Look.LINE
    order = np.argsort(x, kind="stable") if table.times is None else np.arange(x.size)
    return [Trace("first fit", x[order], shown[order], look, colour=1, unit=column.unit)]
