"""Plots of measurements: a record, or a whole run, one panel for each kind of quantity.

In: a `RunData`. Out: `Plot`s, which know nothing of how they are drawn: interactive in a browser, or as
files. Signals are thinned to what a screen can show, with their peaks kept.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.answers.numbers import setting, symbol
from rigctl.dataset.history import EventEntry
from rigctl.report.decimation import changes, thin
from rigctl.report.plot import Look, Mark, Panel, Plot, Span, Trace
from rigctl.report.run_data import RecordData, RunData, Signal
from rigctl.units import DIMENSIONLESS, Dimension, parse_unit

#: panels from top to bottom; others come between these and the plain numbers
_ORDER = (("m", "position"), ("Pa", "pressure"), ("K", "temperature"), ("m^3/s", "flow"))
#: kinds of events that are marked in the overview
ALARMS = ("alarm", "fault", "gap")
#: more shaded records than this cannot be distinguished, and slow a browser down
_MOST_SPANS = 400
_MOST_MARKS = 40


def record_plot(
    run: RunData,
    record: RecordData,
    *,
    points: int,
    key: str,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> Plot:
    """A record over its own time: every signal of the run, at most about `points` samples of each.

    Parameters
    ----------
    key: the plot's id.
    ranges: of the panels by title, so that records can be compared; see `record_ranges`.
    """
    panels = _panels(run, record.rows, run.time[record.rows] - record.start, points, ranges or {})
    return Plot(key, record_label(record), "time in the record [s]", panels)


def overview_plot(run: RunData, *, points: int, key: str) -> Plot:
    """The whole run, records shaded and alarms marked."""
    all_rows = slice(0, len(run.time))
    time, shift = end_to_end(run)
    length = float(time[-1] - time[0]) if len(time) else 0.0
    scale, unit = _time_scale(length)
    panels = _panels(run, all_rows, time / scale, points, {})
    spans = tuple(
        Span(
            (record.start + shift[record.rows.start]) / scale, (record.end + shift[record.rows.start]) / scale
        )
        for record in run.records[:_MOST_SPANS]
        if record.rows.stop > record.rows.start
    )
    alarms = [event for event in run.events if event.kind in ALARMS][:_MOST_MARKS]
    marks = tuple(Mark(event.time / scale, _mark_label(event)) for event in alarms)
    title = "the records one after the other" if shift.any() else "time since the start"
    return Plot(key, f"The whole run {run.id}", f"{title} [{unit}]", panels, spans, marks)


def end_to_end(run: RunData) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times at which no record overlaps another, and the shift of each row; s.

    A logger that restarts its clock with every record gives them all the same times. Rows whose time goes
    back are shifted behind those before them; a run recorded by rigctl is unchanged.
    """
    shift = np.zeros(len(run.time))
    steps = np.diff(run.time)
    for row in np.flatnonzero(steps < 0.0):
        usual = np.abs(steps[row - 1]) if row else 0.0
        shift[row + 1 :] += usual - steps[row]
    return run.time + shift, shift


def record_ranges(run: RunData) -> dict[str, tuple[float, float]]:
    """The range of y over all records for every panel, with a margin, by the panel's title."""
    inside = np.zeros(len(run.time), dtype=bool)
    for record in run.records:
        inside[record.rows] = True
    ranges = {}
    for title, signals in _groups(run).items():
        values = np.concatenate([signal.values[inside] for signal in signals])
        values = values[np.isfinite(values)]
        if len(values):
            low, high = float(values.min()), float(values.max())
            margin = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
            ranges[title] = (low - margin, high + margin)
    return ranges


def record_label(record: RecordData) -> str:
    """The name of a record for readers, e.g. ``12 · stroke · oil 40 °C, supply 30 bar``."""
    sweep = sweep_label(record.sweep)
    return f"{record.index} · {record.name}" + (f" · {sweep}" if sweep else "")


def sweep_label(sweep: Mapping[str, tuple[float, str]]) -> str:
    """Sweep values in words: ``oil 40 °C, supply 30 bar``."""
    return ", ".join(
        f"{plain_name(name)} {setting(value)} {symbol(unit)}".rstrip()
        for name, (value, unit) in sweep.items()
    )


def plain_name(name: str) -> str:
    """A channel's name as prose: ``oil_temperature`` is oil temperature."""
    return name.replace("_", " ")


def _mark_label(event: EventEntry) -> str:
    return event.message or str(event.data.get("name") or event.data.get("limit") or event.kind)


def _time_scale(length: float) -> tuple[float, str]:
    """Seconds of one unit of the time axis, and its name."""
    if length < 300.0:
        return 1.0, "s"
    return (60.0, "min") if length < 3.0 * 3600.0 else (3600.0, "h")


def _groups(run: RunData) -> dict[str, list[Signal]]:
    """Signals that share a panel, by the panel's title, from top to bottom."""
    groups: dict[str, list[Signal]] = {}
    for signal in sorted(run.signals.values(), key=_rank):
        groups.setdefault(_title(signal), []).append(signal)
    return groups


def _rank(signal: Signal) -> tuple[int, bool]:
    kinds = [parse_unit(unit).dimension for unit, _ in _ORDER]
    if signal.dimension in kinds:
        return (kinds.index(signal.dimension), signal.command)
    return (len(kinds) + (signal.dimension == DIMENSIONLESS), signal.command)


def _title(signal: Signal) -> str:
    if signal.command and signal.dimension == DIMENSIONLESS:
        return "commands"
    name = quantity_name(signal.dimension) or plain_name(signal.name)
    return f"{name} [{symbol(signal.unit)}]" if symbol(signal.unit) else name


def quantity_name(dimension: Dimension) -> str | None:
    """The name of a quantity of this dimension on an axis; None if there is none."""
    return next((name for unit, name in _ORDER if parse_unit(unit).dimension == dimension), None)


def _panels(
    run: RunData,
    rows: slice,
    time: NDArray[np.float64],
    points: int,
    ranges: Mapping[str, tuple[float, float]],
) -> tuple[Panel, ...]:
    panels = []
    colours = {name: number for number, name in enumerate(run.signals)}
    for title, signals in _groups(run).items():
        traces = tuple(_trace(signal, rows, time, points, colours[signal.name]) for signal in signals)
        if title == "commands":
            panels.append(_commands_panel(run, title, signals, traces))
        else:
            panels.append(Panel(title, traces, range=ranges.get(title)))
    return tuple(panels)


def _trace(signal: Signal, rows: slice, time: NDArray[np.float64], points: int, colour: int) -> Trace:
    values = signal.values[rows]
    indices = changes(values) if signal.command else thin(values, points)
    if signal.command and len(indices) > points:
        indices = thin(values, points)
    look = Look.STEP if signal.command else Look.LINE
    # shared if no rows were left out, so that a page contains these times once
    x = time if len(indices) == len(time) else time[indices]
    faint = signal.command and signal.dimension != DIMENSIONLESS
    name = plain_name(signal.name) + (" (set)" if faint else "")
    return Trace(name, x, values[indices], look, colour, symbol(signal.unit), faint)


def _commands_panel(run: RunData, title: str, signals: Sequence[Signal], traces: tuple[Trace, ...]) -> Panel:
    """A low panel of switches and valves, with the names of a valve's positions if all are known."""
    values = [signal.values[np.isfinite(signal.values)] for signal in signals]
    low = min((float(v.min()) for v in values if len(v)), default=0.0)
    high = max((float(v.max()) for v in values if len(v)), default=1.0)
    if low < -1.0 or high > 1.0 or not math.isfinite(high - low):
        return Panel(title, traces, height=0.6)
    valve = run.rig is not None and any(
        run.rig.actuators[signal.name].kind == "directional_valve"
        for signal in signals
        if signal.name in run.rig.actuators
    )
    ticks = ((-1.0, "retract"), (0.0, "off"), (1.0, "extend" if len(signals) == 1 else "extend, on"))
    if not valve:
        ticks = ((-1.0, "−1"), (0.0, "0"), (1.0, "1"))
    shown = tuple(tick for tick in ticks if low <= tick[0] <= high)
    return Panel(title, traces, 0.6, (min(low, 0.0) - 0.25, max(high, 1.0) + 0.25), shown)
