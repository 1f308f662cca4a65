"""A draft model fitted once to the file from which it was drafted, and a plot of both."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
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


@dataclass(frozen=True)
class FirstFit:
    """The result of the first fit.

    Attributes
    ----------
    rmse: of each output, in its unit; `span` is the output's range.
    problem: why there is no fit; "" if there is one.
    """

    plot: Path | None
    rmse: Mapping[str, float] = field(default_factory=dict)
    span: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    problem: str = ""

    def lines(self) -> list[str]:
        """Lines for the terminal."""
        texts = [
            f"first fit: {name} within {f'{significant(value, 3)} {self.units[name]}'.strip()} (RMSE), "
            f"{value / self.span[name]:.1%} of its range"
            for name, value in self.rmse.items()
            if self.span[name] > 0.0
        ]
        texts += [f"no first fit: {self.problem}"] if self.problem else []
        return texts + ([f"drawn in {self.plot}"] if self.plot is not None else [])

    def document(self) -> dict[str, Any]:
        """For programs."""
        outputs = {
            name: {"rmse": value, "unit": self.units[name], "range": self.span[name]}
            for name, value in self.rmse.items()
        }
        return {"outputs": outputs, "problem": self.problem or None}


def first_fit(proposal: Proposal, root: Path, columns: Sequence[str], *, fit: bool) -> FirstFit:
    """Import the file outside the project's runs, fit the model, and plot; the run is not kept."""
    result, problem = None, "" if fit else "not asked for"
    if fit:
        try:
            result = _fitted(proposal, root, columns)
        except RigctlError as error:
            problem = str(error)
    plot = _draw(proposal, root, result)
    if result is None:
        return FirstFit(plot, problem=problem)
    rmse, span, units = {}, {}, {}
    for index, name in enumerate(result.problem.measurements.outputs):
        column = proposal.table.column(name)
        errors = _errors(result, index)
        if errors.size:
            between = parse_unit(column.interval)
            rmse[name] = between.from_si(float(np.sqrt(np.mean(errors**2))))
            span[name] = between.from_si(float(np.nanmax(column.values) - np.nanmin(column.values)))
            units[name] = column.interval if column.interval != "1" else ""
    return FirstFit(plot, rmse, span, units)


def _errors(result: FitResult, index: int) -> np.ndarray:
    records = result.problem.measurements.records
    errors = [
        record.values[:, index] - prediction[:, index]
        for record, prediction in zip(records, result.outputs, strict=True)
    ]
    together = np.concatenate(errors)
    return np.asarray(together[np.isfinite(together)])


def _fitted(proposal: Proposal, root: Path, columns: Sequence[str]) -> FitResult:
    from rigctl.analysis.fitting import fit_to_data, read_runs
    from rigctl.cli.progress import progress_display
    from rigctl.dataset import open_run
    from rigctl.dataset.importing import Options, import_file
    from rigctl.model import load_model
    from rigctl.rig import load_rig

    table = proposal.table
    if table.path is None:
        raise RigctlError("there are no data")
    rig = load_rig(root / proposal.rig)
    with (
        tempfile.TemporaryDirectory(prefix="rigctl-") as folder,
        progress_display("the files are there") as on_progress,
    ):
        options = Options(times="drop" if table.copies else "refuse")
        done = import_file(table.path, rig, Path(folder), columns=columns, options=options)
        model = load_model(root / proposal.model)
        data = read_runs(model, [open_run(done.path)], on_progress=on_progress)
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
