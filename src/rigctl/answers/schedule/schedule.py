"""A set-point schedule and its check in words.

In: a `Schedule`, or the `Verdict` of its check. Out: an `Answer` with the set-points and where they end,
notes on what limits their use, and the sentence on the check. A schedule is as good as its model: the answer
says over which range it was measured, and the notes say where it does not agree or is extrapolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rigctl.answers.blocks import Answer, Block, Column, Next, Note, Points, Sentence, Table, counted
from rigctl.compensation.paired_test import LEVEL, Verdict
from rigctl.compensation.result import CompensationRow, RangeEnd, Schedule
from rigctl.units import parse_unit, show, with_uncertainty
from rigctl.wording import chance_text

#: an error that is smaller than this multiple of the scatter from record to record needs no schedule
_CLEAR = 2.0


def statement(schedule: Schedule) -> str:
    """What to set, what it avoids, and where the schedule ends."""
    first, last = schedule.reached[0], schedule.reached[-1]
    text = (
        f"To keep {schedule.quantity} at {show(schedule.target, schedule.unit)}, set {schedule.vary} "
        f"from {show(first.vary, schedule.vary_unit)} at {schedule.over} "
        f"{show(first.over, schedule.over_unit)} to "
        f"{show(last.vary, schedule.vary_unit)} at {show(last.over, schedule.over_unit)}; left at "
        f"{show(schedule.fixed, schedule.vary_unit)} it would be off by up to "
        f"{show(schedule.off_if_fixed, schedule.unit, difference=True)}"
    )
    if schedule.ends:
        end = end_text(schedule, schedule.ends[0])
        text += f". {end[0].upper()}{end[1:]}"
    return text


def end_text(schedule: Schedule, end: RangeEnd) -> str:
    """Where the rig's range is insufficient, and what becomes of the quantity there."""
    at = " and ".join(show(one, schedule.over_unit) for one in end.at)
    first, last = (show(one, schedule.over_unit) for one in (end.first, end.last))
    low, high = (show(one, schedule.unit) for one in end.becomes)
    where = first if first == last else f"{first} to {last}"
    become = low if low == high else f"{low} to {high}"
    return (
        f"it ends at {schedule.over} {at}; at {where} the rig does not go far enough: at {schedule.vary} "
        f"{show(end.bound, schedule.vary_unit)}, its {end.side}, {schedule.quantity} is {become}"
    )


def notes(schedule: Schedule) -> list[str]:
    """What limits the use of a schedule."""
    texts = []
    if schedule.disagreement is not None:
        texts.append(
            f"{schedule.model} does not agree with these data ({chance_text(schedule.disagreement)}): a "
            "schedule is as good as its model; 'rigctl diagnose' says what it lacks"
        )
    name, low, high, unit = schedule.valid[1]
    beyond = sum(not low <= row.vary <= high for row in schedule.reached)
    if beyond:
        texts.append(
            f"{beyond} of {len(schedule.rows)} set-points lie outside of what was "
            f"measured, {name} {show(low, unit)} to {show(high, unit)}: there the model is extrapolated"
        )
    off, scatter = schedule.off_if_fixed, schedule.scatter
    if off < _CLEAR * scatter:
        off_text, scatter_text = (show(one, schedule.unit, difference=True) for one in (off, scatter))
        texts.append(
            f"with {schedule.vary} left where it is, {schedule.quantity} would be off by no more than "
            f"{off_text}, and records scatter by {scatter_text}: there is little to compensate"
        )
    return texts


def summary(schedule: Schedule) -> str:
    """The statement, and a line for each operating point."""
    lines = [
        f"  {schedule.over} {show(row.over, schedule.over_unit)}: {schedule.vary} "
        f"{show(row.vary, schedule.vary_unit)}"
        for row in schedule.reached
    ]
    return "\n".join([statement(schedule), *lines])


def schedule_answer(schedule: Schedule, written: Sequence[Path] = ()) -> Answer:
    """The set-point at each operating point, its uncertainty, and the measured range; the files `written`."""
    reached = schedule.reached
    points = [
        f"{show(row.vary, schedule.vary_unit)} at {show(row.over, schedule.over_unit)}" for row in reached
    ]
    std = show(max(row.std for row in reached), schedule.vary_unit, difference=True, digits=2)
    scatter = show(schedule.scatter, schedule.unit, difference=True, digits=2)
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
    noted = notes(schedule)
    return Answer(
        "warn" if schedule.ends or noted else "good",
        "Schedule",
        statement(schedule),
        facts,
        remarks=(
            *(Note(end_text(schedule, end)) for end in schedule.ends[1:]),
            *map(Note, noted),
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


def check_text(verdict: Verdict) -> str:
    """The errors with the schedule and without, and how certain their ratio is."""
    error, plain = (show(one, verdict.unit, difference=True) for one in (verdict.with_it, verdict.without))
    off = f"{verdict.quantity} was off {show(verdict.target, verdict.unit)}"
    text = (
        f"{off} by {error} with the schedule and by {plain} without, in {verdict.pairs} pairs: a ratio of "
        f"{verdict.ratio:.2f}"
    )
    if math.isfinite(verdict.bound):
        return f"{text}, below {verdict.bound:.2f} with 95 % confidence"
    # If the schedule did nothing, each pair would favour it with probability 1/2: n pairs that all do have
    # the probability 2⁻ⁿ, which must fall below the level.
    fewest = math.ceil(math.log2(1.0 / LEVEL))
    return f"{text}, " + (
        f"so few pairs give no bound; {fewest} are the fewest" if verdict.pairs < fewest else "no bound"
    )


def check_block(verdict: Verdict) -> Sentence:
    """Whether the schedule is accepted, and why."""
    if verdict.accepted:
        return Sentence(check_text(verdict), "good", "Accepted", main=True)
    return Sentence(check_text(verdict), "warn", "Not accepted", main=True)
