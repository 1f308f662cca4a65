"""The procedure that checks a schedule: pairs of records, with and without it, in random order."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rigctl.compensation.levers import Lever
from rigctl.compensation.measured import TakenMeasure
from rigctl.compensation.prediction import Predictor
from rigctl.compensation.result import CompensationRow, Schedule
from rigctl.dataset.run import Run
from rigctl.design.rig_file import rig_reference
from rigctl.errors import RigctlError
from rigctl.files.scalars import quoted
from rigctl.units import parse_quantity, show

#: operating points of the check, and pairs of records at each: the best order of eight pairs has probability
#: 2⁻⁸
_POINTS, _PAIRS = 4, 2
#: digits of a set-point that is set by hand
_DIGITS = 4
#: names of the sweeps that identify a record
PAIR, COMPENSATED, TARGET = "pair", "compensated", "target"


def argument_of(measure: TakenMeasure, predictor: Predictor) -> str:
    """The argument of the record's procedure that sets what is varied.

    Raises
    ------
    RigctlError
        no argument had the values that were set, or several had.
    """
    problem = predictor.fit.problem
    outputs = problem.measurements.outputs
    known: set[str] | None = None
    for k in predictor.fit.fitted:
        record = problem.records[k]
        arguments = measure.arguments.get((record.run, record.index))
        if arguments is None:
            continue
        value = predictor.vary.of(record, outputs)
        same = {name for name, text in arguments.items() if _is(text, value)}
        known = same if known is None else known & same
    if not known or len(known) > 1:
        raise RigctlError(
            f"no argument of {measure.file.name} sets '{predictor.vary.name}'"
            if not known
            else f"several arguments of {measure.file.name} could set '{predictor.vary.name}'",
            value=", ".join(sorted(known or ())) or "none",
            expected="a procedure of one record that the runs call, with an argument for the set-point",
        )
    return known.pop()


def _is(text: str, value: float) -> bool:
    try:
        return abs(parse_quantity(text).si - value) <= 1e-6 * max(abs(value), 1e-12)
    except RigctlError:  # a word, a list
        return False


def procedure_text(
    schedule: Schedule, measure: TakenMeasure, predictor: Predictor, runs: Sequence[Run], seed: int
) -> str:
    """Records with the scheduled set-point and with the fixed one, in pairs, their order random with `seed`.

    The operating points increase. Every record states its pair, and whether it is compensated.

    Raises
    ------
    RigctlError
        as `argument_of`.
    """
    argument = argument_of(measure, predictor)
    rng = np.random.default_rng(seed)
    rig = predictor.stage.rig
    lines = [
        f"# Checks that {schedule.vary} by a schedule over {schedule.over} keeps {schedule.quantity}",
        f"# at {show(schedule.target, schedule.unit)}: pairs of records, one with the scheduled set-point,",
        f"# one with {show(schedule.fixed, schedule.vary_unit)}, in an order drawn with seed {seed}. Then:",
        "#",
        "#   rigctl compensate RUN --judge",
        "",
        f"procedure: check of {schedule.quantity} compensated by {schedule.vary}",
    ]
    reference = rig_reference(runs, rig)
    lines += [f"rig: {reference}"] if reference else []
    lines += ["", "steps:"]
    pair = 0
    for row in _chosen(schedule.reached):
        lines += [f"  {line}" for line in _brought(predictor.over, row.over)]
        for _ in range(_PAIRS):
            pair += 1
            for compensated in (1, 0) if rng.integers(2) else (0, 1):
                value = row.vary if compensated else schedule.fixed
                lines += _record(schedule, argument, value, pair, compensated)
    return "\n".join(lines) + "\n"


def _chosen(rows: Sequence[CompensationRow]) -> list[CompensationRow]:
    """Some of the rows, including the first and the last."""
    at = np.unique(np.linspace(0, len(rows) - 1, min(_POINTS, len(rows))).round().astype(int))
    return [rows[int(k)] for k in at]


def _brought(over: Lever, value: float) -> list[str]:
    """The step that establishes an operating point; if no step can, a prompt to the operator."""
    text = show(value, over.unit, digits=_DIGITS)
    if over.role == "heat":
        return [f"- heat: {{to: {text}, within: 0.5 K, settle: 60 s, timeout: 4 h}}"]
    return [f"- prompt: Bring {over.name} to {text}, then confirm."]


def _record(schedule: Schedule, argument: str, value: float, pair: int, compensated: int) -> list[str]:
    text = show(value, schedule.vary_unit, digits=_DIGITS)
    target = f"{schedule.quantity}_{TARGET}: [{show(schedule.target, schedule.unit, digits=6)}]"
    return [
        f"  - for: {{{target}, {PAIR}: [{pair}], {COMPENSATED}: [{compensated}]}}",
        "    zip: true",
        "    do:",
        f"      - call: {{procedure: {quoted(schedule.called)}, with: {{{argument}: {text}}}}}",
    ]


def beside(schedule: Schedule, folder: Path) -> str:
    """The procedure as written into a folder: the called procedure is named relative to it, if possible."""
    try:
        near = os.path.relpath(schedule.called, folder.absolute())
    except ValueError:  # on another drive
        return schedule.procedure
    return schedule.procedure.replace(quoted(schedule.called), quoted(Path(near).as_posix()))
