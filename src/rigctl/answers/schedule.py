"""A set-point schedule and its check in words."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigctl.answers.blocks import Answer, Block, Column, Next, Note, Points, Sentence, Table, counted
from rigctl.compensation.paired_test import Verdict
from rigctl.compensation.result import CompensationRow, Schedule
from rigctl.units import parse_unit, show, with_uncertainty


def schedule_answer(schedule: Schedule, written: Sequence[Path] = ()) -> Answer:
    """The set-point at each operating point, its uncertainty, and the measured range; the files `written`."""
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
    checks = [path for path in written if path.suffix == ".yaml"]
    why = "records the check, in pairs with and without the schedule"
    more = counted(
        len(schedule.rows), "operating point with its prediction", "operating points with their predictions"
    )
    return Answer(
        "warn" if schedule.ends or schedule.notes else "good",
        "Schedule",
        schedule.statement,
        facts,
        remarks=(
            *map(Note, (*schedule.ends[1:], *schedule.notes)),
            *([Points.of("", [f"written: {path.as_posix()}" for path in written])] if written else []),
            *([Next(f"rigctl run {checks[0].as_posix()}", why)] if checks else []),
        ),
        more=tuple(more),
    )


def schedule_evidence(schedule: Schedule) -> tuple[Block, ...]:
    """Every operating point with its prediction."""
    columns = (
        Column("over", schedule.over),
        Column("vary", schedule.vary),
        Column("kept", schedule.quantity),
        Column("scatter", "scatter"),
        Column("fixed", f"at constant {show(schedule.fixed, schedule.vary_unit)}"),
    )
    off = show(schedule.off, schedule.unit, difference=True, digits=2)
    between = f"linear interpolation between two rows is off by at most {off}"
    return (
        Table(columns, tuple(_row(schedule, row) for row in schedule.rows)),
        *([Points.of("", [between])] if schedule.off else []),
    )


def _row(schedule: Schedule, row: CompensationRow) -> dict[str, str]:
    shown = {"over": show(row.over, schedule.over_unit), "fixed": show(row.fixed, schedule.unit)}
    if not row.reached:
        return shown | {"vary": "out of reach"}
    unit = parse_unit(schedule.vary_unit)
    return shown | {
        "vary": with_uncertainty(unit.from_si(row.vary), row.std / unit.factor, schedule.vary_unit),
        "kept": show(row.kept, schedule.unit),
        "scatter": f"± {show(row.scatter, schedule.unit, difference=True, digits=2)}",
    }


def check_block(verdict: Verdict) -> Sentence:
    """Whether the schedule is accepted, and why."""
    if verdict.accepted:
        return Sentence(verdict.statement, "good", "Accepted", main=True)
    return Sentence(verdict.statement, "warn", "Not accepted", main=True)
