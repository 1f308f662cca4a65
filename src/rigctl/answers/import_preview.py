"""What an import would read: a table of the columns, their curves, and the records."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rigctl.answers.blocks import Block, Column, Figure, Note, Points, Sparkline, Table
from rigctl.wording import number_of

if TYPE_CHECKING:
    from rigctl.dataset.importing.preview import ColumnPreview, Preview

#: characters of a curve, and largest number of records that are listed one by one
_WIDTH, _LISTED = 48, 20
_short = "{:.6g}".format


def preview_blocks(preview: Preview) -> list[Block]:
    """The columns, their curves and the records."""
    started = preview.started
    begins = "" if started is None else f"begins {started:%Y-%m-%d %H:%M:%S %Z}".rstrip()
    return [
        _columns(preview),
        *(_curve(column) for column in preview.columns if column.low is not None and column.is_sampled),
        Points.of("", [begins] if begins else []),
        *_records(preview),
    ]


def _columns(preview: Preview) -> Table:
    columns = (
        Column("theirs", "in the file", words=True),
        Column("ours", "read as", words=True),
        Column("values", "values"),
        Column("missing", "missing"),
        Column("low", "from", _short),
        Column("high", "to", _short),
    )
    return Table(columns, tuple(map(_row, preview.columns)))


def _row(column: ColumnPreview) -> dict[str, Any]:
    unit = "" if column.unit == "1" else f" [{column.unit}]"
    return {
        "theirs": f"{column.theirs} [{column.written}]" if column.written else column.theirs,
        "ours": f"time{unit}" if column.kind == "time" else f"{column.kind} {column.ours}{unit}",
        "values": column.values,
        "missing": column.missing or None,
        "low": column.low,
        "high": column.high,
    }


def _curve(column: ColumnPreview) -> Figure:
    """The time series of a column as two lines, with the values at the edges."""
    unit = "" if column.unit == "1" else f" {column.unit}"
    ends = (f"{column.high:.4g}", f"{column.low:.4g}")
    curve = Sparkline(
        tuple(value for pair in column.course.T.tolist() for value in pair if value == value),  # noqa: PLR0124
        column.low,
        column.high,
        ends,
        f"{column.ours}{unit}",
        lines=2,
        width=_WIDTH,
    )
    return Figure("", "", curve=curve)


def _records(preview: Preview) -> list[Block]:
    columns = (
        Column("number", "record"),
        Column("name", "name", words=True),
        Column("start", "start [s]", _short),
        Column("end", "end [s]", _short),
        Column("rows", "rows"),
    )
    rows = tuple(
        {"number": number, "name": record.name, "start": record.start, "end": record.end, "rows": record.rows}
        for number, record in enumerate(preview.records[:_LISTED])
    )
    more = len(preview.records) - _LISTED
    return [Table(columns, rows), *([Note(f"and {number_of(more, 'more record')}")] if more > 0 else [])]
