"""The section on a set-point schedule: the set-points, and the quantity with and without it."""

from __future__ import annotations

import numpy as np

from rigctl.compensation.result import Row, Schedule
from rigctl.report.numbers import symbol
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit, show, with_uncertainty

#: standard deviations of the bands
_BAND = 1.96


def compensation_sections(found: Schedule) -> list[Section]:
    """The statement, the schedule as a picture and as a table, and what was measured."""
    plot = _plot(found)
    body = render(
        "compensation.html",
        found=found,
        plot=plot_slot(plot),
        rows=[_row(found, row) for row in found.rows],
        heads=[plain_name(name) for name in (found.over, found.vary, found.quantity)],
        fixed=show(found.fixed, found.vary_unit),
        off=show(found.off, found.unit, difference=True, digits=2),
        remarks=[f"{one[0].upper()}{one[1:]}" for one in (*found.ends[1:], *found.notes)],
        valid=[
            (plain_name(name), show(low, unit), show(high, unit)) for name, low, high, unit in found.valid
        ],
    )
    return [Section("schedule", "A set-point schedule", body, (plot,))]


def _row(found: Schedule, row: Row) -> dict[str, str]:
    shown = {"over": show(row.over, found.over_unit), "fixed": show(row.fixed, found.unit)}
    if not row.reached:
        return shown | {"vary": "out of reach", "kept": "", "scatter": ""}
    unit = parse_unit(found.vary_unit)
    return shown | {
        "vary": with_uncertainty(unit.from_si(row.vary), row.std / unit.factor, found.vary_unit),
        "kept": show(row.kept, found.unit),
        "scatter": f"± {show(row.scatter, found.unit, difference=True, digits=2)}",
    }


def _plot(found: Schedule) -> Plot:
    over, vary, kept = (parse_unit(unit) for unit in (found.over_unit, found.vary_unit, found.unit))
    x = np.array([over.from_si(row.over) for row in found.rows])
    wide = _BAND * np.array([row.std for row in found.rows]) / vary.factor
    set_point = np.array([vary.from_si(row.vary) for row in found.rows])
    scatter = _BAND * np.array([row.scatter for row in found.rows]) / kept.factor
    quantity = np.array([kept.from_si(row.kept) for row in found.rows])
    unchanged = np.array([kept.from_si(row.fixed) for row in found.rows])
    v, q = symbol(found.vary_unit), symbol(found.unit)
    upper = (
        Trace("set-point", x, set_point, Look.MARKED, 0, v),
        Trace("its 95 % band", x, set_point - wide, Look.LINE, 0, v, faint=True),
        Trace("", x, set_point + wide, Look.LINE, 0, v, faint=True, in_legend=False),
    )
    left = f"left at {show(found.fixed, found.vary_unit)}"
    lower = (
        Trace("with the schedule", x, quantity, Look.LINE, 0, q),
        Trace("19 of 20 records", x, quantity - scatter, Look.LINE, 0, q, faint=True),
        Trace("", x, quantity + scatter, Look.LINE, 0, q, faint=True, in_legend=False),
        Trace(left, x, unchanged, Look.LINE, 1, q),
    )
    return Plot(
        "schedule",
        f"{plain_name(found.vary)} over {plain_name(found.over)}, and {plain_name(found.quantity)} with it "
        "and without, as predicted by the model",
        f"{plain_name(found.over)} [{symbol(found.over_unit)}]",
        (
            Panel(f"{plain_name(found.vary)} [{v}]", upper, 1.2),
            Panel(f"{plain_name(found.quantity)} [{q}]", lower, 1.2),
        ),
    )
