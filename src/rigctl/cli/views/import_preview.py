"""A preview of an import, as a table and plots in the terminal, or as a figure in a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.markup import escape

from rigctl.cli.tables import console, table
from rigctl.report.braille import draw_curve

if TYPE_CHECKING:
    from rigctl.dataset.importing.preview import ColumnPreview, Preview

#: width of a plot in characters, and largest number of records that are listed one by one
_WIDTH: Final = 48
_LISTED: Final = 20


def show_preview(preview: Preview) -> None:
    """Print the columns, their plots and the records."""
    out = console()
    grid = table("in the file", "read as", "values", "missing", "from", "to")
    for column in preview.columns:
        theirs = f"{column.theirs} [{column.written}]" if column.written else column.theirs
        unit = "" if column.unit == "1" else f" [{column.unit}]"
        grid.add_row(
            escape(theirs),
            escape(f"{column.kind} {column.ours}{unit}" if column.kind != "time" else f"time{unit}"),
            str(column.values),
            str(column.missing) if column.missing else "",
            "" if column.low is None else f"{column.low:.6g}",
            "" if column.high is None else f"{column.high:.6g}",
        )
    out.print(grid)
    for column in preview.columns:
        if column.kind in ("channel", "command"):
            _show_course(column)
    if preview.started is not None:
        out.print(f"  begins {preview.started:%Y-%m-%d %H:%M:%S %Z}".rstrip())
    if preview.records:
        listed = table("record", "name", escape("start [s]"), escape("end [s]"), "rows")
        for number, record in enumerate(preview.records[:_LISTED]):
            listed.add_row(
                str(number), escape(record.name), f"{record.start:.6g}", f"{record.end:.6g}", str(record.rows)
            )
        out.print(listed)
        if len(preview.records) > _LISTED:
            out.print(f"  and {len(preview.records) - _LISTED} more records")


def _show_course(column: ColumnPreview) -> None:
    """Show the time series of a column as two lines of braille, with the values at the edges."""
    if column.low is None or column.high is None:
        return
    values = [value for pair in column.course.T.tolist() for value in pair if value == value]  # noqa: PLR0124
    lines = draw_curve(values, width=_WIDTH, height=2, low=column.low, high=column.high)
    out = console()
    unit = "" if column.unit == "1" else f" {column.unit}"
    for line, edge in zip(lines, (column.high, column.low), strict=True):
        out.print(
            f"  {edge:>10.4g} {line}" + (f"  {escape(column.ours)}{unit}" if edge == column.high else "")
        )
    out.print()


def write_preview(preview: Preview, path: Path) -> Path:
    """Draw the course of every channel and command into a PNG or SVG file.

    Raises
    ------
    RigctlError
        the file's ending is another one, there is nothing to draw, or it cannot be written.
    """
    from rigctl.answers.numbers import symbol
    from rigctl.dataset.outputs import is_figure, require_output
    from rigctl.errors import RigctlError
    from rigctl.report.figure_files import write_figure
    from rigctl.report.plot import Look, Panel, Plot, Trace

    form = path.suffix.lower().removeprefix(".")
    if form not in ("png", "svg"):
        raise RigctlError(
            "unknown kind of figure", value=path.name, expected="a name that ends in .png or .svg"
        )
    require_output(path, replaces=is_figure, option="")
    drawn = [column for column in preview.columns if column.kind in ("channel", "command") and column.values]
    if not drawn:
        raise RigctlError("there is nothing to draw", expected="samples of a channel or of a command")
    x = np.repeat(preview.times, 2)
    panels = []
    for number, column in enumerate(drawn):
        look = Look.STEP if column.kind == "command" else Look.LINE
        trace = Trace(column.ours, x, column.course.T.reshape(-1), look, number, symbol(column.unit))
        panels.append(Panel(f"{column.ours.replace('_', ' ')}\n[{symbol(column.unit)}]", (trace,)))
    plot = Plot(path.stem, "What would be read", "time [s]" if preview.elapsed else "row", tuple(panels))
    return write_figure(plot, path.parent, form)
