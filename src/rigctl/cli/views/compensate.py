"""How a schedule and its check are printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from rigctl.answers.blocks import Answer, counted
from rigctl.cli.blocks import show_answer
from rigctl.cli.next_command import show_next
from rigctl.cli.tables import console, table
from rigctl.compensation.paired_test import Verdict
from rigctl.compensation.result import Schedule
from rigctl.units import parse_unit, show, with_uncertainty

_POINTS = "operating points with their predictions"


def show_schedule(schedule: Schedule, written: Sequence[Path], *, verbose: bool = False) -> None:
    """Show the set-points, their uncertainty and the measured range; with `verbose` also the table."""
    out = console()
    more = [] if verbose else [*counted(len(schedule.rows), "operating point with its prediction", _POINTS)]
    show_answer(replace(schedule_answer(schedule), more=tuple(more)))
    if verbose:
        out.print(_rows(schedule))
        if schedule.off:
            off = show(schedule.off, schedule.unit, difference=True, digits=2)
            out.print(f"  linear interpolation between two rows is off by at most {off}", soft_wrap=True)
    for note in (*schedule.ends[1:], *schedule.notes):
        out.print(f"  [dim]{escape(note)}[/]", soft_wrap=True)
    for path in written:
        out.print(f"  written: {escape(path.as_posix())}", soft_wrap=True)
    checks = [path for path in written if path.suffix == ".yaml"]
    if checks:
        show_next(
            f"rigctl run {checks[0].as_posix()}",
            "records the check, in pairs with and without the schedule",
        )


def schedule_answer(schedule: Schedule) -> Answer:
    """The set-point at each operating point, its uncertainty, and the measured range."""
    reached = schedule.reached
    points = [
        f"{show(row.vary, schedule.vary_unit)} at {show(row.over, schedule.over_unit)}" for row in reached
    ]
    std = show(max(row.std for row in reached), schedule.vary_unit, difference=True, digits=2)
    scatter = show(max(row.scatter for row in reached), schedule.unit, difference=True, digits=2)
    box = ", ".join(f"{name} {show(low, u)} to {show(high, u)}" for name, low, high, u in schedule.valid)
    facts = (
        ("set", ", ".join(points)),
        (
            "how sure",
            f"± {std} from the fit; {schedule.quantity} scatters by ± {scatter} from record to record",
        ),
        ("measured", f"over {box}"),
    )
    return Answer("warn" if schedule.notes else "good", "Schedule", schedule.statement, facts)


def _rows(schedule: Schedule) -> Table:
    heading = f"at constant {show(schedule.fixed, schedule.vary_unit)}"
    grid = table(schedule.over, schedule.vary, schedule.quantity, "scatter", heading)
    for column in grid.columns:
        column.justify = "right"
    unit = parse_unit(schedule.vary_unit)
    for row in schedule.rows:
        unchanged = show(row.fixed, schedule.unit)
        at = show(row.over, schedule.over_unit)
        if not row.reached:
            grid.add_row(at, "out of reach", "", "", unchanged)
            continue
        grid.add_row(
            at,
            with_uncertainty(unit.from_si(row.vary), row.std / unit.factor, schedule.vary_unit),
            show(row.kept, schedule.unit),
            f"± {show(row.scatter, schedule.unit, difference=True, digits=2)}",
            unchanged,
        )
    return grid


def show_verdict(verdict: Verdict) -> None:
    """Show whether the schedule is accepted, and why."""
    head = "[bold green]Accepted[/]" if verdict.accepted else "[bold yellow]Not accepted[/]"
    console().print(f"{head}: {escape(verdict.statement)}.", soft_wrap=True)
