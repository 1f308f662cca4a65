"""The check of a schedule: pairs of records, with and without it, in random order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rigctl.compensation.measured import TakenMeasure
from rigctl.compensation.prediction import Predictor
from rigctl.dataset.run import Run
from rigctl.design.rig_file import rig_reference
from rigctl.errors import RigctlError
from rigctl.units import parse_quantity

if TYPE_CHECKING:
    from rigctl.compensation.result import CompensationRow

#: operating points of the check, and pairs of records at each: the best order of eight pairs has probability
#: 2⁻⁸
_POINTS, _PAIRS = 4, 2
#: names of the sweeps that identify a record
PAIR, COMPENSATED, TARGET = "pair", "compensated", "target"


@dataclass(frozen=True)
class CheckRecord:
    """A record of a check, SI: the operating point, the set-point, and the pair to which it belongs."""

    over: float
    vary: float
    pair: int
    compensated: bool


@dataclass(frozen=True)
class Check:
    """How a schedule is checked.

    Attributes
    ----------
    called: path of the procedure that makes one record, and its `argument` for the set-point.
    rig: by which the procedure refers to its rig file; "" leaves it to the command.
    heated: a heater establishes the operating points; else the operator does.
    seed: of the order of the records in each pair.
    """

    called: str
    argument: str
    rig: str
    heated: bool
    seed: int
    records: tuple[CheckRecord, ...]


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


def check_of(
    rows: Sequence[CompensationRow],
    fixed: float,
    measure: TakenMeasure,
    predictor: Predictor,
    runs: Sequence[Run],
    seed: int,
) -> Check:
    """Records with the scheduled set-point and with the fixed one, in pairs, their order random with `seed`.

    The operating points increase, from the first row to the last.

    Raises
    ------
    RigctlError
        as `argument_of`.
    """
    # Pairs of neighbouring records, one with the scheduled set-point and one with the fixed one, in random
    # order: what drifts during the check is then the same in both on average, and the test needs no more than
    # this.
    argument = argument_of(measure, predictor)
    rng = np.random.default_rng(seed)
    records: list[CheckRecord] = []
    reached = [row for row in rows if row.reached]
    at = np.linspace(0, len(reached) - 1, min(_POINTS, len(reached))).round()
    for row in (reached[int(k)] for k in np.unique(at)):
        for _ in range(_PAIRS):
            pair = 1 + len(records) // 2
            for compensated in (True, False) if rng.integers(2) else (False, True):
                value = row.vary if compensated else fixed
                records.append(CheckRecord(row.over, value, pair, compensated))
    return Check(
        called=measure.file.absolute().as_posix(),
        argument=argument,
        rig=rig_reference(runs, predictor.stage.rig),
        heated=predictor.over.role == "heat",
        seed=seed,
        records=tuple(records),
    )
