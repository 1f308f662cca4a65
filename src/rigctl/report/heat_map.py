"""Numbers as colours: on the page a table that a screen reader can read, in a file an image."""

from __future__ import annotations

import io
import math
import textwrap
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from rigctl.answers.numbers import prose
from rigctl.files.write import write_bytes
from rigctl.report.section import render

#: blue below, orange above: distinguishable for most colour-blind readers
_BELOW, _ABOVE = (47, 127, 193), (217, 122, 38)
#: characters of a title in one inch of a picture
_LETTERS = 12


@dataclass(frozen=True)
class HeatMap:
    """Values over two variables.

    Parameters
    ----------
    id, caption: as of a plot.
    row_title, column_title: what the rows and the columns are.
    rows, columns: their names.
    values: by row; NaN where there is none.
    strong: by row, whether a value is more than chance, and marked.
    limit: the value of the strongest colour.
    signed: False for a size, which has no sign: one colour, no plus sign.
    """

    id: str
    caption: str
    row_title: str
    column_title: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    strong: tuple[tuple[bool, ...], ...]
    limit: float
    signed: bool = True


@dataclass(frozen=True)
class _Cell:
    text: str
    side: str  #: its colour: that above or that below
    depth: str
    strong: bool


def heat_map_table(shown: HeatMap) -> Markup:
    """The map as a coloured table."""
    rows = [
        (
            name,
            [_cell(shown, value, strong) for value, strong in zip(values, marks, strict=True)],
        )
        for name, values, marks in zip(shown.rows, shown.values, shown.strong, strict=True)
    ]
    return render("heat_map.html", map=shown, rows=rows)


def _cell(shown: HeatMap, value: float, strong: bool) -> _Cell:
    """A cell, never too dark for its text."""
    if not math.isfinite(value):
        return _Cell("–", "above", "0", False)
    share = min(abs(value) / shown.limit, 1.0) if shown.limit else 0.0
    depth = 0.08 + 0.55 * share if strong else 0.05  # values within chance stay pale
    text = f"{value:+.1f}" if shown.signed else f"{value:.1f}"
    if not float(text):
        text = text.lstrip("+-")
    side = "above" if value > 0.0 or not shown.signed else "below"
    return _Cell(text.replace("-", "−"), side, f"{depth:.2f}", strong)


def write_heat_map(shown: HeatMap, folder: Path, form: str = "png") -> Path:
    """Draw a map into ``folder/<id>.<form>`` and return the path.

    Raises
    ------
    RigctlError
        the file cannot be written.
    """
    import numpy as np
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure

    path = folder / f"{shown.id}.{form}"
    colours = [tuple(c / 255 for c in _BELOW), (1.0, 1.0, 1.0), tuple(c / 255 for c in _ABOVE)]
    colours = colours if shown.signed else colours[1:]
    width = 1.6 + 0.9 * len(shown.columns)
    title = textwrap.wrap(prose(shown.caption), max(20, int(_LETTERS * width)))
    height = 1.2 + 0.2 * len(title) + 0.42 * len(shown.rows)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    values = np.array(shown.values, dtype=float)
    image = axes.imshow(
        values,
        cmap=LinearSegmentedColormap.from_list("error", colours),
        vmin=-shown.limit if shown.signed else 0.0,
        vmax=shown.limit,
        aspect="auto",
    )
    axes.set_xticks(range(len(shown.columns)), shown.columns, rotation=30, ha="right")
    axes.set_yticks(range(len(shown.rows)), shown.rows)
    axes.set_xlabel(shown.column_title)
    axes.set_ylabel(shown.row_title)
    for i, row in enumerate(shown.values):
        for j, value in enumerate(row):
            if math.isfinite(value):
                weight = "bold" if shown.strong[i][j] else "normal"
                mark = " *" if shown.strong[i][j] else ""
                text = f"{value:+.1f}" if shown.signed else f"{value:.1f}"
                axes.text(j, i, f"{text}{mark}", ha="center", va="center", fontsize=8, fontweight=weight)
    figure.colorbar(image, ax=axes, label="times the noise")
    figure.suptitle("\n".join(title), fontsize=10)
    content = io.BytesIO()
    figure.savefig(content, format=form, dpi=144, metadata={"Date": None} if form == "svg" else {})
    write_bytes(path, content.getvalue())
    return path
