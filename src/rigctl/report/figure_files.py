"""Plots as files, for papers and slides."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.answers.numbers import prose
from rigctl.dataset.outputs import is_figure, require_output
from rigctl.errors import RigctlError
from rigctl.files.write import write_bytes
from rigctl.report import colours
from rigctl.report.plot import Look, Panel, Plot, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMATS: Final = ("png", "svg")
#: columns and characters of a legend, so that it is no wider than the picture
_LEGEND_COLUMNS, _LEGEND_LETTERS = 4, 100
_MARKERS = ("o", "s", "D", "^", "P", "v", "X", "*")
_STYLE: Final[dict[Any, Any]] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "font.size": 9,
    "svg.fonttype": "none",  # text stays text, so that it can be searched and edited
    "svg.hashsalt": "rigctl",  # equal plots give equal files
    "axes.formatter.useoffset": False,
    "text.parse_math": False,  # a dollar in a name is a dollar
    "path.simplify": True,
}


def require_figure(path: Path) -> str:
    """The format of a figure that is to be written to `path`: its ending.

    Raises
    ------
    RigctlError
        the file has another ending, or an existing file is not a figure.
    """
    form = path.suffix.lstrip(".").casefold()
    if form not in FORMATS:
        raise RigctlError(
            "not a format of figures",
            value=path.name,
            expected=f"a name ending in {' or '.join(f'.{each}' for each in FORMATS)}",
        )
    require_output(path, replaces=is_figure, option="")
    return form


def write_figure(plot: Plot, folder: Path, form: str = "png") -> Path:
    """Draw a plot into ``folder/<id>.<form>`` and return the path.

    Raises
    ------
    RigctlError
        the file cannot be written.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    path = folder / f"{plot.id}.{form}"
    heights = [panel.height for panel in plot.panels]
    with rc_context(_STYLE):
        figure = Figure(figsize=(7.2, max(1.5 * sum(heights), 2.8) + 0.9), layout="constrained")
        grid = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
        for panel, axes in zip(plot.panels, grid[:, 0], strict=True):
            _draw(panel, axes)
            for span in plot.spans:
                axes.axvspan(
                    span.start, span.end, color=colours.SPAN, alpha=colours.SPAN_OPACITY, linewidth=0
                )
            for mark in plot.marks:
                axes.axvline(mark.x, color=colours.MARK, linestyle="--", linewidth=1)
        grid[-1, 0].set_xlabel(plot.x_title)
        if plot.log_x:
            grid[-1, 0].set_xscale("log")
            grid[-1, 0].xaxis.set_major_formatter("{x:g}")
        figure.suptitle(prose(plot.caption), fontsize=10)
        content = io.BytesIO()
        # a date would make equal plots differ; PNG files hold none
        metadata = {"Date": None} if form == "svg" else {}
        figure.savefig(content, format=form, dpi=144, metadata=metadata)
    write_bytes(path, content.getvalue())
    return path


def _draw(panel: Panel, axes: Axes) -> None:
    for trace in panel.traces:
        _draw_trace(trace, axes)
    axes.set_ylabel(panel.title)
    if panel.range is not None:
        axes.set_ylim(*panel.range)
    if panel.ticks is not None:
        axes.set_yticks([value for value, _ in panel.ticks], [name for _, name in panel.ticks])
    labels = [trace.name for trace in panel.traces if trace.in_legend]
    if len(labels) > 1:
        # above the axes, where it hides nothing
        axes.legend(
            frameon=False,
            fontsize=8,
            ncols=max(1, min(_LEGEND_COLUMNS, _LEGEND_LETTERS // max(map(len, labels)))),
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderaxespad=0.1,
        )


def _draw_trace(trace: Trace, axes: Axes) -> None:
    marked = trace.look in (Look.POINTS, Look.MARKED)
    axes.plot(
        trace.x,
        trace.y,
        color=colours.SERIES[trace.colour % len(colours.SERIES)],
        linestyle="none" if trace.look is Look.POINTS else ":" if trace.faint else "-",
        linewidth=0.9 if trace.faint else 1.3,
        marker=_MARKERS[trace.colour % len(_MARKERS)] if marked else None,
        markersize=4.5,
        drawstyle="steps-post" if trace.look is Look.STEP else "default",
        label=trace.name if trace.in_legend else "_hidden",
    )
