"""Two campaigns compared: the difference at each common condition, and the scatter of repeats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from rigctl.errors import RigctlError
from rigctl.units import parse_unit, significant

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rigctl.dataset import Record, Run

#: points of a curve that is drawn
_POINTS: Final = 240
#: records of one campaign that are read
_MOST: Final = 400
Key = tuple[str, tuple[tuple[str, float], ...]]


def difference(first: Run, second: Run) -> dict[str, Any]:
    """The difference between two runs at their common conditions.

    Of each channel of a condition, over the time that both lasted, in the channel's unit: ``rms`` and
    ``bias`` of the second's mean curve minus the first's, and ``scatter``, the root mean square deviation of
    single records from the mean of their campaign; None where nothing was repeated.

    Raises
    ------
    RigctlError
        no condition or no channel is common to both.
    """
    groups = [_by_condition(run) for run in (first, second)]
    common = [key for key in groups[0] if key in groups[1]]
    channels = [name for name in first.layout.channels if name in second.layout.channels]
    if not common or not channels:
        what = "condition" if channels else "channel"
        raise RigctlError(f"no {what} is common to both runs", value=f"{first.id}, {second.id}")
    units = {**second.record_units, **first.record_units}
    shown = {name: _unit(first, name) for name in channels}
    return {
        "first": first.id,
        "second": second.id,
        "channels": {name: unit for name, (unit, _) in shown.items()},
        "conditions": [
            {
                "label": _label(key, units),
                "records": [len(group[key]) for group in groups],
                "channels": _compare([group[key] for group in groups], shown),
            }
            for key in common
        ],
        "only_first": len(groups[0]) - len(common),
        "only_second": len(groups[1]) - len(common),
    }


def _by_condition(run: Run) -> dict[Key, list[Record]]:
    groups: dict[Key, list[Record]] = {}
    for record in run.each(run.usable[:_MOST]):
        values = tuple(sorted((name, float(f"{value:.6g}")) for name, value in record.sweep.items()))
        groups.setdefault((record.name, values), []).append(record)
    return groups


def _unit(run: Run, name: str) -> tuple[str, float]:
    """Unit of a channel, and how many SI units one of it is."""
    text = run.layout.unit(name)
    return text, parse_unit(text).factor


def _label(key: Key, units: Mapping[str, str]) -> str:
    name, values = key
    parts = []
    for variable, value in values:
        unit = units.get(variable, "")
        number = parse_unit(unit).from_si(value) if unit else value
        parts.append(f"{variable} {significant(number)} {unit}".removesuffix(" 1").rstrip())
    return ", ".join([name, *parts])


def _compare(groups: Sequence[Sequence[Record]], channels: Mapping[str, tuple[str, float]]) -> dict[str, Any]:
    import numpy as np

    lasted = min(float(record.time[-1] - record.time[0]) for group in groups for record in group)
    grid = np.linspace(0.0, lasted, _POINTS)
    differences = {}
    for name, (unit, factor) in channels.items():
        offset = parse_unit(unit).offset
        curves = [np.array([_curve(record, name, grid) for record in group]) / factor for group in groups]
        means = [_mean(rows) for rows in curves]
        apart = means[1] - means[0]
        if not np.isfinite(apart).any():
            continue
        differences[name] = {
            "rms": float(np.sqrt(np.nanmean(apart**2))),
            "bias": float(np.nanmean(apart)),
            "scatter": _scatter(curves, means),
            "time": _short(grid),
            "curves": [_short(mean - offset / factor) for mean in means],
        }
    return differences


def _curve(record: Record, name: str, grid: NDArray[np.float64]) -> NDArray[np.float64]:
    import numpy as np

    return np.interp(grid, record.time - record.time[0], record.channels[name])


def _mean(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean over the records, ignoring missing values; NaN where all are missing."""
    import numpy as np

    valid = np.isfinite(rows)
    count = valid.sum(axis=0)
    total = np.where(valid, rows, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _scatter(curves: Sequence[NDArray[np.float64]], means: Sequence[NDArray[np.float64]]) -> float | None:
    import numpy as np

    squares, dof = 0.0, 0
    for rows, mean in zip(curves, means, strict=True):
        if len(rows) > 1:
            squares += float(np.nansum((rows - mean) ** 2)) / rows.shape[1]
            dof += len(rows) - 1
    return float(np.sqrt(squares / dof)) if dof else None


def _short(values: NDArray[np.float64]) -> list[float | None]:
    return [float(f"{value:.5g}") if value == value else None for value in values.tolist()]  # noqa: PLR0124
