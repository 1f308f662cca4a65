"""Several runs over each other: one quantity over another, or over time, as a person picks them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

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
#: columns of the table of records that are no quantity of the bench
_PLAIN: Final = frozenset(
    {"record", "name", "path", "rate", "start", "end", "outcome", "excluded", "rows", "session"}
)


def overlay(runs: Sequence[Run], y: str = "", x: str = "") -> dict[str, Any]:
    """The curves or points of the runs' usable records.

    Two channels are drawn as points, one for each sample; a channel over time as a curve for each record,
    from its beginning. A value that a record has once, such as a measure or what its sweep set, is drawn as
    one point for each record, a channel beside it as its mean over the record.

    Parameters
    ----------
    y: the quantity; by default the last value of the records over the first, otherwise the first channel.
    x: what it is drawn over; "" for the time in the record, or its number.

    Returns
    -------
    ``quantities`` with their units, ``y`` and ``x``, ``kind`` (curves or points), the ``table`` that has them,
    ``left_out``, the number of records that are not drawn, and ``series``: ``run``, ``x``, ``y``.

    Raises
    ------
    RigctlError
        too many runs, no such quantity, or nothing that can be drawn.
    """
    if not 0 < len(runs) <= _MOST_RUNS:
        raise RigctlError("runs over each other", value=str(len(runs)), expected=f"1 to {_MOST_RUNS}")
    channels = _channels(runs)
    values = {name: unit for run in runs for name, unit in _values(run).items() if name not in channels}
    quantities = {**values, **channels}
    if not quantities:
        raise RigctlError("these runs have nothing that can be drawn")
    if not y:
        y, x = (list(values)[-1], next(iter(values))) if len(values) > 1 else (next(iter(quantities)), "")
    for name in (y, x):
        if name and name not in quantities:
            raise unknown_name("quantity", name, quantities)
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
        "kind": "curves" if curves else "points",
        "table": "samples" if of_samples else "records",
        "left_out": records - drawn,
        "series": series,
    }


def _channels(runs: Sequence[Run]) -> dict[str, str]:
    """The channels of the runs with samples, and their units."""
    return {name: run.layout.unit(name) for run in runs if run.info["rows"] for name in run.layout.channels}


def _values(run: Run) -> dict[str, str]:
    """The numbers that each record of a run has once, and their units."""
    frame, units = run.records, run.record_units
    return {
        name: units.get(name, "1")
        for name in frame.columns
        if name not in _PLAIN and frame[name].dtype.kind in "fiu"
    }


def _limit(runs: Sequence[Run], *, curves: bool) -> int:
    return max(_MOST_CURVES // len(runs), 1) if curves else _MOST_RECORDS


def _shown(run: Run, record: Record, name: str) -> NDArray[np.float64]:
    """A channel of a record in its unit; NaN where the run has no such channel."""
    import numpy as np

    if name not in record.channels:
        return np.full(record.time.size, np.nan)
    unit = parse_unit(run.layout.unit(name))
    offset = 0.0 if name in run.layout.differences else unit.offset
    return (record.channels[name] - offset) / unit.factor


def _curves(runs: Sequence[Run], y: str, x: str, units: Mapping[str, str]) -> list[dict[str, Any]]:
    """A curve for each record, at times common to all."""
    import numpy as np

    most = _limit(runs, curves=True)
    read = [(run, record) for run in runs for record in run.each(run.usable[:most])]
    longest = max((float(record.time[-1] - record.time[0]) for _, record in read), default=0.0)
    grid = np.linspace(0.0, longest, _POINTS)
    series = []
    for run, record in read:
        values, time = _shown(run, record, y), record.time - record.time[0]
        known = np.isfinite(values)
        if known.any():
            at = np.interp(grid, time[known], values[known], left=np.nan, right=np.nan)
            series.append({"run": run.id, "record": record.index, "x": grid.tolist(), "y": _plain(at)})
    return series


def _samples(runs: Sequence[Run], y: str, x: str, units: Mapping[str, str]) -> list[dict[str, Any]]:
    """A point for each sample, of every so many where there are too many."""
    import numpy as np

    series = []
    for run in runs:
        read = list(run.each(run.usable[:_MOST_RECORDS]))
        pairs = [np.column_stack([_shown(run, record, x), _shown(run, record, y)]) for record in read]
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
    shown = [_shown(run, record, name) for record in run.each(usable)]
    return np.array(
        [values[np.isfinite(values)].mean() if np.isfinite(values).any() else np.nan for values in shown]
    )


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    return [float(f"{value:.6g}") if value == value else None for value in values.tolist()]  # noqa: PLR0124
