"""Resampling of channels with separate clocks to common times.

Measurements are interpolated linearly, commands are held until the next one. There are no values before the
first sample of a channel, after its last one, or in a gap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from rigctl.dataset.importing.cells.increasing import order_of, repeated
from rigctl.dataset.importing.columns import Assigned
from rigctl.dataset.importing.formats.table import GOES_BACK, KEPT_FAULTS, Fault, Labels, RowBlock
from rigctl.dataset.importing.options import TimePolicy
from rigctl.dataset.importing.splitting import stretches
from rigctl.errors import RigctlError, unknown_name
from rigctl.units import parse_quantity, read_si

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: a time step longer than the usual one by this factor is a gap
_GAP: Final = 5.0
#: more rows than this indicate a step in the wrong unit
_MOST_ROWS: Final = 50_000_000


@dataclass(frozen=True)
class _Series:
    """The samples of one column: increasing times, values, and their lines in the file.

    `back` and `back_lines` are the times that go back, and their lines; `again` are the lines of values left
    out because they repeat a time.
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    lines: NDArray[np.int64]
    back: NDArray[np.float64]
    back_lines: NDArray[np.int64]
    again: NDArray[np.int64]

    @property
    def step(self) -> float:
        """The median time step."""
        import numpy as np

        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else float("inf")


def resample(
    part: RowBlock, assigned: Sequence[Assigned], to: str, policy: TimePolicy = "refuse"
) -> tuple[RowBlock, list[str]]:
    """Return the rows of a whole file at common times, and remarks.

    Parameters
    ----------
    to: a time step, ``10 ms``, or the name of the column whose times are used.
    policy: with ``drop``, values of a channel whose time goes back are left out, otherwise they are faults;
        with ``spread``, equal times of a channel are spread, otherwise the first of their values is used.

    Raises
    ------
    RigctlError
        `to` is neither, or there would be too many rows.
    """
    import numpy as np

    times = [column for column in assigned if column.kind == "time"]
    if not times:
        raise RigctlError("nothing can be resampled without times", expected="a column 'time [s]'")
    time = times[0]
    scale = time.unit.factor if time.unit is not None else 1.0
    known = [column for column in assigned if column.kind in ("channel", "command")]
    leading = _leading(to, known)
    step = None if leading is not None else read_si(to, "s") / scale
    if step is not None and step <= 0.0:
        raise RigctlError("--resample: not a step of time", value=to, expected="more than 0 s")
    clocks = {column.name: column for column in assigned if column.kind == "clock"}
    pieces: list[dict[int, NDArray[np.float64]]] = []
    lines: list[NDArray[np.int64]] = []
    codes: list[NDArray[np.int64]] = []
    texts: list[str] = []
    usual: dict[str, float] = {}
    back: dict[int, float] = {}
    again: dict[str, list[int]] = {}
    for start, stop, text in stretches(part):
        series = {c.name: _series(part, slice(start, stop), c, time, clocks, policy) for c in known}
        usual |= {name: one.step for name, one in series.items() if len(one.times) > 1}
        back |= {
            line: moment * scale
            for one in series.values()
            for line, moment in zip(one.back_lines.tolist(), one.back.tolist(), strict=True)
        }
        for name, one in series.items():
            again.setdefault(name, []).extend(one.again.tolist())
        # Record by record: nothing is interpolated from one record into another.
        grid = series[leading.name].times if leading is not None else _grid(series, step or 0.0)
        piece = {c.index: _at(grid, series[c.name], hold=c.kind == "command") for c in known}
        piece[time.index] = grid
        piece |= {clock.index: np.full(len(grid), np.nan) for clock in clocks.values()}
        pieces.append(piece)
        lines.append(_lines_at(grid, series))
        codes.append(np.full(len(grid), len(texts), dtype=np.int64))
        texts.append(text or "0")
    if not pieces:  # no rows, only faults
        return part, []
    columns = {index: np.concatenate([piece[index] for piece in pieces]) for index in part.columns}
    named = part.labels is not None and part.labels.named
    drop = policy == "drop"
    faults = tuple(
        Fault(line, GOES_BACK, f"{moment:.9g} s", group=part.group, path=part.path)
        for line, moment in (() if drop else sorted(back.items())[:KEPT_FAULTS])
    )
    resampled = replace(
        part,
        faults=(*part.faults, *faults),
        more_faults=part.more_faults + (0 if drop else len(back) - len(faults)),
        columns=columns,
        lines=np.concatenate(lines) if lines else np.zeros(0, dtype=np.int64),
        labels=None if part.labels is None else Labels(np.concatenate(codes), tuple(texts), named),
    )
    slow = [f"{name} (usually every {usual[name] * scale:.4g} s)" for name in usual]
    where = f"those of {leading.name}" if leading is not None else f"every {to}"
    remarks = [f"brought to common times, {where}, interpolated between samples: {', '.join(slow)}"]
    if drop and back:
        remarks.append(
            f"{len(back)} rows whose time goes back were dropped, the first of them on line {min(back)}"
        )
    remarks += [repeated(name, len(rows), line=rows[0]) for name, rows in again.items() if rows]
    return resampled, remarks


def _leading(to: str, known: Sequence[Assigned]) -> Assigned | None:
    """Return the column whose times are used; None if `to` is a step."""
    match = next((column for column in known if to in (column.name, column.heading.name)), None)
    if match is not None:
        return match
    try:
        parse_quantity(to)
    except RigctlError:
        raise unknown_name("column to resample by", to, [column.name for column in known]) from None
    return None


def _series(
    part: RowBlock,
    rows: slice,
    column: Assigned,
    time: Assigned,
    clocks: Mapping[str, Assigned],
    policy: TimePolicy,
) -> _Series:
    import numpy as np

    clock = clocks.get(column.name)
    times = part.columns[(clock or time).index][rows]
    if clock is not None and clock.unit is not None and time.unit is not None:
        times = times * (clock.unit.factor / time.unit.factor)
    values, lines = part.columns[column.index][rows], part.lines[rows]
    good = ~(np.isnan(times) | np.isnan(values))
    times, values, lines = times[good], values[good], lines[good]
    order = order_of(times, policy)
    times, on, back = order.times, order.rising, order.back
    return _Series(times[on], values[on], lines[on], times[back], lines[back], lines[~on & ~back])


def _grid(series: Mapping[str, _Series], step: float) -> NDArray[np.float64]:
    """Return multiples of a step, from the first sample of any column to the last."""
    import numpy as np

    ends = [(one.times[0], one.times[-1]) for one in series.values() if len(one.times)]
    if not ends:
        return np.zeros(0)
    first = np.ceil(min(start for start, _ in ends) / step - 1e-9)
    last = np.floor(max(stop for _, stop in ends) / step + 1e-9)
    if last - first > _MOST_ROWS:
        raise RigctlError(
            "--resample: too many rows", value=f"{last - first:.0f}", expected=f"at most {_MOST_ROWS}"
        )
    return np.asarray(np.arange(first, last + 1.0) * step)


def _at(grid: NDArray[np.float64], series: _Series, *, hold: bool) -> NDArray[np.float64]:
    """Return the values of a column at other times."""
    import numpy as np

    if not len(series.times):
        return np.full(len(grid), np.nan)
    before = np.searchsorted(series.times, grid, side="right") - 1
    if hold:
        return np.where(before >= 0, series.values[np.maximum(before, 0)], np.nan)
    values = np.interp(grid, series.times, series.values, left=np.nan, right=np.nan)
    inside = (before >= 0) & (before < len(series.times) - 1)
    at = np.minimum(np.maximum(before, 0), max(len(series.times) - 2, 0))
    if len(series.times) > 1:
        wide = (series.times[at + 1] - series.times[at]) > _GAP * series.step
        values = np.where(inside & wide & (grid > series.times[at]), np.nan, values)
    return np.asarray(values)


def _lines_at(grid: NDArray[np.float64], series: Mapping[str, _Series]) -> NDArray[np.int64]:
    """Return the line of the last sample before each time, in the column with the most samples."""
    import numpy as np

    best = max(series.values(), key=lambda one: len(one.times))
    if not len(best.times):
        return np.zeros(len(grid), dtype=np.int64)
    return best.lines[np.maximum(np.searchsorted(best.times, grid, side="right") - 1, 0)]
