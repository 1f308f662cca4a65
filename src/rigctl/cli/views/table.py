"""How a table of single values is printed beside a model."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.markup import escape

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.single_values.rows import TableRow, shows_unfitted
from rigctl.cli.tables import console, table
from rigctl.units import significant

#: standard deviations beyond which a value is marked
_FAR = 3.0


def show_rows(model: ModelComparison) -> None:
    """Every value with the model's, row by row, one table for each quantity."""
    for quantity in dict.fromkeys(row.quantity for row in model.rows):
        _show_quantity([row for row in model.rows if row.quantity == quantity])


def _show_quantity(rows: Sequence[TableRow]) -> None:
    unit = rows[0].unit
    beside = list(dict.fromkeys(name for row in rows for name in row.beside))
    fitted = shows_unfitted(rows)
    heads = [
        "at",
        escape(f"{rows[0].quantity} [{unit}]"),
        "noise",
        "model" if rows[0].unfitted is None else "model, fitted",
    ]
    heads += ["model − measured", "/ noise", *(["as in its file", "/ noise"] if fitted else [])]
    heads += [escape(name.removeprefix(f"{rows[0].quantity}_")) for name in beside]
    grid = table(*heads)
    for column in grid.columns[1:]:
        column.justify = "right"
    for row in rows:
        cells = [
            escape(row.condition if row.fitted else f"{row.condition} (held out)"),
            significant(row.measured, 5),
            significant(row.noise, 2),
            significant(row.predicted, 5),
            f"{100 * row.share(row.predicted):+.2f} %" if row.measured else "",
            _ratio(row.z),
        ]
        if fitted:
            unfitted = math.nan if row.unfitted is None else row.unfitted
            cells += [significant(unfitted, 5), _ratio(row.z_unfitted or 0.0)]
        grid.add_row(
            *cells, *(significant(row.beside[name], 5) if name in row.beside else "" for name in beside)
        )
    console().print(grid)


def _ratio(z: float) -> str:
    text = f"{z:+.1f}"
    return f"[bold red]{text}[/]" if abs(z) > _FAR else text
