"""The check of a schedule as a procedure: every record states its pair, and whether it is compensated."""

from __future__ import annotations

import os
from itertools import groupby
from pathlib import Path

from rigctl.compensation.check import COMPENSATED, PAIR, TARGET, Check, CheckRecord
from rigctl.compensation.result import Schedule
from rigctl.files.scalars import quoted
from rigctl.units import show

#: digits of a set-point that is set by hand
_DIGITS = 4


def check_procedure(schedule: Schedule, folder: Path | None = None) -> str:
    """The procedure; in a `folder`, the one that it calls is named relative to it, if possible."""
    check = schedule.check
    fixed = show(schedule.fixed, schedule.vary_unit)
    called = quoted(check.called if folder is None else _beside(check.called, folder))
    lines = [
        f"# Checks that {schedule.vary} by a schedule over {schedule.over} keeps {schedule.quantity}",
        f"# at {show(schedule.target, schedule.unit)}: pairs of records, one with the scheduled set-point,",
        f"# one with {fixed}, in an order drawn with seed {check.seed}. Then:",
        "#",
        "#   rigctl compensate RUN --judge",
        "",
        f"procedure: check of {schedule.quantity} compensated by {schedule.vary}",
        *([f"rig: {check.rig}"] if check.rig else []),
        "",
        "steps:",
    ]
    for point, records in groupby(check.records, lambda one: one.over):
        lines.append(f"  {_brought(schedule, check, point)}")
        for record in records:
            lines += _record(schedule, f"{{procedure: {called}, with: {{{check.argument}: ", record)
    return "\n".join(lines) + "\n"


def _beside(called: str, folder: Path) -> str:
    try:
        return Path(os.path.relpath(called, folder.absolute())).as_posix()
    except ValueError:  # on another drive
        return called


def _brought(schedule: Schedule, check: Check, point: float) -> str:
    """The step that establishes an operating point; if no step can, a prompt to the operator."""
    text = show(point, schedule.over_unit, digits=_DIGITS)
    if check.heated:
        return f"- heat: {{to: {text}, within: 0.5 K, settle: 60 s, timeout: 4 h}}"
    return f"- prompt: Bring {schedule.over} to {text}, then confirm."


def _record(schedule: Schedule, call: str, record: CheckRecord) -> list[str]:
    target = f"{schedule.quantity}_{TARGET}: [{show(schedule.target, schedule.unit, digits=6)}]"
    return [
        f"  - for: {{{target}, {PAIR}: [{record.pair}], {COMPENSATED}: [{int(record.compensated)}]}}",
        "    zip: true",
        "    do:",
        f"      - call: {call}{show(record.vary, schedule.vary_unit, digits=_DIGITS)}}}}}",
    ]
