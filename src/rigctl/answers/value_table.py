"""A table of single values beside the models' values."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.single_values.rows import TableRow, shows_unfitted
from rigctl.answers.blocks import Column, Table
from rigctl.units import significant

#: standard deviations beyond which a value is marked
_FAR = 3.0
_five, _two = partial(significant, digits=5), partial(significant, digits=2)
_signed = "{:+.1f}".format
_per_cent = "{:+.2f} %".format


def value_tables(models: Sequence[ModelComparison]) -> list[Table]:
    """A table for each quantity, row by row; none for time series."""
    return [_table(models, quantity) for quantity in dict.fromkeys(row.quantity for row in models[0].rows)]


def _table(models: Sequence[ModelComparison], quantity: str) -> Table:
    by_model = [[row for row in model.rows if row.quantity == quantity] for model in models]
    rows = by_model[0]
    beside = list(dict.fromkeys(name for row in rows for name in row.beside))
    single = "model" if rows[0].unfitted is None else "model, fitted"
    columns = [
        Column("at", "at"),
        Column("measured", f"{quantity} [{rows[0].unit}]", _five),
        Column("noise", "noise", _two),
    ]
    for number, model in enumerate(models):
        columns += [
            Column(f"predicted {number}", model.name if len(models) > 1 else single, _five),
            Column(f"error {number}", "model − measured", _per_cent),
            Column(f"z {number}", "/ noise", _signed, beyond=_FAR),
        ]
    if len(models) == 1 and shows_unfitted(rows):
        columns += [
            Column("unfitted", "as in its file", _five),
            Column("z unfitted", "/ noise", _signed, beyond=_FAR),
        ]
    columns += [Column(f"beside {name}", name.removeprefix(f"{quantity}_"), _five) for name in beside]
    return Table(tuple(columns), tuple(map(_row, zip(*by_model, strict=True))))


def _row(of_models: Sequence[TableRow]) -> dict[str, Any]:
    """The same value in the comparison of each model."""
    row = of_models[0]
    cells: dict[str, Any] = {
        "at": row.condition if row.fitted else f"{row.condition} (held out)",
        "measured": row.measured,
        "noise": row.noise,
        "unfitted": row.unfitted,
        "z unfitted": row.z_unfitted,
        **{f"beside {name}": value for name, value in row.beside.items()},
    }
    for number, one in enumerate(of_models):
        share = 100.0 * one.share(one.predicted) if one.measured else None
        cells |= {f"predicted {number}": one.predicted, f"error {number}": share, f"z {number}": one.z}
    return cells
