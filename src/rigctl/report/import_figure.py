"""What an import would read as a figure in a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rigctl.answers.numbers import symbol
from rigctl.errors import RigctlError
from rigctl.report.figure_files import require_figure, write_figure
from rigctl.report.plot import Look, Panel, Plot, Trace

if TYPE_CHECKING:
    from rigctl.dataset.importing.preview import Preview


def write_preview(preview: Preview, path: Path) -> Path:
    """Draw the course of every channel and command into a PNG or SVG file.

    Raises
    ------
    RigctlError
        the file's ending is another one, there is nothing to draw, or it cannot be written.
    """
    form = require_figure(path)
    drawn = [column for column in preview.columns if column.is_sampled and column.values]
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
