"""Several runs over each other: one quantity over another, or over time, as a person picks them.

In: a few runs and the names of two quantities. Out: plain data for the page: curves, samples or one point
for each record, whichever fits the two quantities, and the `rigctl runs sql` command that lists the same.

Runs may have been stored in different units: all are drawn in the unit of the first run that has the
quantity, and one of another dimension is refused. All of it goes to a browser as JSON, so that the
numbers of runs, records and points are limited; what is left out is counted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from rigctl.command_line import command
from rigctl.errors import RigctlError, unknown_name
from rigctl.units import parse_unit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rigctl.dataset import Record, Run

#: runs over each other, records of one that are read, and curves that are drawn of all
_MOST_RUNS: Final = 8
_MOST_RECORDS: Final = 200
_MOST_CURVES: Final = 60
#: points of a curve, and of one run where samples are drawn as points
_POINTS: Final = 240
_MOST_POINTS: Final = 1500

_Quantities: TypeAlias = Mapping[str, Mapping[str, str]]


def overlay(runs: Sequence[Run], y: str = "", x: str = "") -> dict[str, Any]:
    """The curves or points of the runs' usable records.

    Two channels are drawn as points, one for each sample; a channel over time as a curve for each record,
    from its beginning. A value that a record has once, such as a measure or what its sweep set, is drawn as
    one point for each record, a channel beside it as its mean over the record.

    Parameters
    ----------
    y: the quantity; by default the first measure over what was varied first, otherwise the first channel.
    x: what it is drawn over; "" for the time in the record, or its number.

    Returns
    -------
    ``quantities`` with their units, those of the first run that has each, ``y`` and ``x``, ``kind`` (curves,
    samples or records), ``left_out``, the number of records that are not drawn, the ``command`` that lists
    the same in each run's own units, and ``series``: ``run``, ``x``, ``y``.

    Raises
    ------
    RigctlError
        too many runs, no such quantity, one of another dimension in another run, or nothing to draw.
    """
    if not 0 < len(runs) <= _MOST_RUNS:
        raise RigctlError("runs over each other", value=str(len(runs)), expected=f"1 to {_MOST_RUNS}")
    each = [_quantities(run) for run in runs]
    varied, measures, channels = (_of_first(each, kind) for kind in ("sweep", "measure", "channel"))
    quantities = {**varied, **measures, **channels}
    if not quantities:
        raise RigctlError("these runs have nothing that can be drawn")
    if not y:
        y, x = (*measures, *channels, *varied)[0], next(iter(varied), "") if measures else ""
    for name in (y, x):
        if name and name not in quantities:
            raise unknown_name("quantity", name, quantities)
        if name:
            _require_one_dimension(runs, each, name, quantities)
    of_samples = y in channels and (not x or x in channels)
    curves = of_samples and not x
    draw = _curves if curves else _samples if of_samples else _records
    series = draw(runs, y, x, quantities)
    records = sum(len(run.usable) for run in runs)
    drawn = sum(min(len(run.usable), _limit(runs, curves=curves)) for run in runs)
    return {
        "quantities": [{"name": name, "unit": unit} for name, unit in quantities.items()],
        "y": y,
        "x": x,
        "kind": "curves" if curves else "samples" if of_samples else "records",
        "left_out": records - drawn,
        "command": command(
            ("runs", "sql", _query(runs, [name for name in (x, y) if name], channels, curves=curves))
        ),
        "series": series,
    }


def _require_one_dimension(
    runs: Sequence[Run], each: Sequence[_Quantities], name: str, units: Mapping[str, str]
) -> None:
    common = parse_unit(units[name]).dimension
    for run, quantities in zip(runs, each, strict=True):
        own = {**quantities["sweep"], **quantities["measure"], **quantities["channel"]}.get(name)
        if own is not None and parse_unit(own).dimension != common:
            raise RigctlError(
                f"{name} is another quantity in {run.id}",
                value=own,
                expected=f"one that converts to {units[name]}, as in the other runs",
            )


def _query(runs: Sequence[Run], names: Sequence[str], channels: Mapping[str, str], *, curves: bool) -> str:
    """The SQL that lists what is drawn; a channel beside values of records by its mean."""
    of_samples = [name in channels for name in names]
    columns = [_quoted(name) for name in names]
    table, tail = "records", ""
    if all(of_samples):
        columns, table = [f"samples.{one}" for one in columns], "samples JOIN records USING (run, record)"
        columns = [*(["samples.time"] if curves else []), *columns]
    elif any(of_samples):
        means = ["avg(samples." if mean else "any_value(records." for mean in of_samples]
        columns = [f"{mean}{name}) AS {name}" for mean, name in zip(means, columns, strict=True)]
        table, tail = "records LEFT JOIN samples USING (run, record)", " GROUP BY run, record"
    ids = ", ".join(_quoted(run.id, "'") for run in runs)
    usable = "records.outcome = 'complete' AND records.excluded IS NULL"
    listed = ", ".join(["run", "record", *columns])
    return f"SELECT {listed} FROM {table} WHERE run IN ({ids}) AND {usable}{tail}"  # noqa: S608 - quoted


def _quoted(text: str, mark: str = '"') -> str:
    return mark + text.replace(mark, 2 * mark) + mark


def _quantities(run: Run) -> _Quantities:
    """The units of what a run has, by its kind: numbers of each record, those of its ``sweep`` and each
    ``measure``, and a ``channel`` of samples."""
    found: dict[str, dict[str, str]] = {"sweep": {}, "measure": {}, "channel": {}}
    for column in run.table("records").schema:
        kind = (column.metadata or {}).get(b"kind", b"").decode()
        if kind in ("sweep", "measure"):
            found[kind][column.name] = run.record_units.get(column.name, "1")
    if run.info["rows"]:
        found["channel"] = {name: run.layout.unit(name) for name in run.layout.channels}
    return found


def _of_first(each: Sequence[_Quantities], kind: str) -> dict[str, str]:
    """The units of all runs' quantities of a kind, each in the first run that has it."""
    found: dict[str, str] = {}
    for quantities in each:
        for name, unit in quantities[kind].items():
            found.setdefault(name, unit)
    return found


def _limit(runs: Sequence[Run], *, curves: bool) -> int:
    return max(_MOST_CURVES // len(runs), 1) if curves else _MOST_RECORDS


def _shown(run: Run, record: Record, name: str, units: Mapping[str, str]) -> NDArray[np.float64]:
    """A channel of a record in the unit common to all runs; NaN where the run has no such channel."""
    import numpy as np

    if name not in record.channels:
        return np.full(record.time.size, np.nan)
    unit = parse_unit(units[name])
    offset = 0.0 if name in run.layout.differences else unit.offset
    return (record.channels[name] - offset) / unit.factor


def _curves(runs: Sequence[Run], y: str, x: str, units: Mapping[str, str]) -> list[dict[str, Any]]:
    """A curve for each record, at times common to all."""
    import numpy as np

    most = _limit(runs, curves=True)
    with_samples = [run for run in runs if run.info["rows"]]
    read = [(run, one) for run in with_samples for one in run.each(run.usable[:most]) if one.time.size]
    longest = max((float(record.time[-1] - record.time[0]) for _, record in read), default=0.0)
    grid = np.linspace(0.0, longest, _POINTS)
    series = []
    for run, record in read:
        values, time = _shown(run, record, y, units), record.time - record.time[0]
        known = np.isfinite(values)
        if known.any():
            at = np.interp(grid, time[known], values[known], left=np.nan, right=np.nan)
            series.append({"run": run.id, "record": record.index, "x": grid.tolist(), "y": _plain(at)})
    return series


def _samples(runs: Sequence[Run], y: str, x: str, units: Mapping[str, str]) -> list[dict[str, Any]]:
    """A point for each sample, of every so many where there are too many."""
    import numpy as np

    series = []
    for run in [run for run in runs if run.info["rows"]]:
        read = list(run.each(run.usable[:_MOST_RECORDS]))
        pairs = [np.column_stack([_shown(run, record, name, units) for name in (x, y)]) for record in read]
        points = np.concatenate(pairs) if pairs else np.empty((0, 2))
        points = points[:: max(-(-len(points) // _MOST_POINTS), 1)]
        series.append({"run": run.id, "x": _plain(points[:, 0]), "y": _plain(points[:, 1])})
    return series


def _records(runs: Sequence[Run], y: str, x: str, units: Mapping[str, str]) -> list[dict[str, Any]]:
    """A point for each record."""
    return [
        {"run": run.id, "x": _plain(_once(run, x, units)), "y": _plain(_once(run, y, units))} for run in runs
    ]


def _once(run: Run, name: str, units: Mapping[str, str]) -> NDArray[np.float64]:
    """A number for each record, in the unit of the first run that has it; the mean of a channel."""
    import numpy as np

    usable = run.usable[:_MOST_RECORDS]
    if not name:
        return np.array(usable, dtype=float)
    frame = run.records.set_index("record")
    if name in frame.columns:
        own, common = parse_unit(run.record_units.get(name, "1")), parse_unit(units[name])
        values = frame.loc[list(usable), name].to_numpy(dtype=float)
        return (values * own.factor + own.offset - common.offset) / common.factor
    if not run.info["rows"]:
        return np.full(len(usable), np.nan)
    shown = [_shown(run, record, name, units) for record in run.each(usable)]
    return np.array(
        [values[np.isfinite(values)].mean() if np.isfinite(values).any() else np.nan for values in shown]
    )


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    return [float(f"{value:.6g}") if value == value else None for value in values.tolist()]  # noqa: PLR0124
