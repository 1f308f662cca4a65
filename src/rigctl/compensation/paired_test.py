"""Whether a schedule works: records with and without it, in pairs in random order.

The error is the quantity less its target, the ratio that of the root mean squares with and without the
schedule. If the schedule's error is r times the other, ``|e_with|/r`` and ``|e_without|`` of a pair are
exchangeable: the largest r for which this is not rejected is the ratio's upper bound, exact for any
distribution of the errors because the order was randomised (R. A. Fisher, The Design of Experiments, 1935).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.compensation.check import COMPENSATED, PAIR, TARGET
from rigctl.dataset.run import Run
from rigctl.errors import RigctlError
from rigctl.json_values import finite_or_none
from rigctl.notebook import worded
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: one-sided level of the bound
LEVEL = 0.05
#: largest number of pairs for which all orders are enumerated; for more, number of random orders
_ALL, _DRAWN = 12, 20_000


@dataclass(frozen=True)
class Verdict:
    """The result of the pairs for a schedule.

    Attributes
    ----------
    quantity, target: SI, shown in `unit`.
    pairs: number of pairs.
    with_it, without: root mean square errors, SI.
    ratio: of the two; `bound` its upper bound at 95 %, infinite if there are too few pairs for one.
    accepted: the bound is below 1.
    """

    runs: tuple[str, ...]
    quantity: str
    target: float
    unit: str
    pairs: int
    with_it: float
    without: float
    ratio: float
    bound: float

    @property
    def accepted(self) -> bool:
        """Whether the schedule significantly reduces the error."""
        return self.bound < 1.0

    @property
    def statement(self) -> str:
        """The verdict in words."""
        return worded(self, "schedule.schedule.check_text")

    def document(self) -> dict[str, Any]:
        """The machine-readable answer; errors in the unit."""
        factor = parse_unit(self.unit).factor
        return {
            "runs": list(self.runs),
            "quantity": self.quantity,
            "target": parse_unit(self.unit).from_si(self.target),
            "unit": self.unit,
            "pairs": self.pairs,
            "error_with": self.with_it / factor,
            "error_without": self.without / factor,
            "ratio": self.ratio,
            "bound": finite_or_none(self.bound),
            "accepted": self.accepted,
            "statement": self.statement,
        }


def judge(runs: Sequence[Run]) -> Verdict:
    """Judge the recorded pairs of a check; a pair with a missing or excluded record does not count.

    Raises
    ------
    RigctlError
        these are not runs of such a check, or of different ones.
    """
    quantity, target, unit = _quantity_and_target(runs)
    errors: dict[tuple[str, float], dict[bool, float]] = {}
    for run in runs:
        for record in run.each(run.usable):
            value = record.measures.get(quantity, math.nan)
            if math.isfinite(value):
                pair = errors.setdefault((run.id, record.sweep[PAIR]), {})
                pair[bool(record.sweep[COMPENSATED])] = value - target
    complete = [one for one in errors.values() if len(one) == 2]
    if not complete:
        raise RigctlError("no pair of records is whole", value=", ".join(run.id for run in runs))
    with_it = np.array([one[True] for one in complete])
    without = np.array([one[False] for one in complete])
    mean = [float(np.sqrt(np.square(one).mean())) for one in (with_it, without)]
    return Verdict(
        runs=tuple(run.id for run in runs),
        quantity=quantity,
        target=target,
        unit=unit,
        pairs=len(complete),
        with_it=mean[0],
        without=mean[1],
        ratio=mean[0] / mean[1] if mean[1] > 0.0 else math.inf,
        bound=upper_bound(with_it, without),
    )


def upper_bound(with_it: Floats, without: Floats, level: float = LEVEL) -> float:
    """The largest ratio r of ``with_it`` to ``without`` that pairs of errors do not reject.

    p(r) is the share of all orders in which the ratio of ``|e_with|/r`` to ``|e_without|`` is at most the
    observed one; it decreases as r increases. Infinite if there are too few pairs to reject any.
    """
    # With n pairs the best of all 2ⁿ orders has probability 2⁻ⁿ: fewer than five can reject nothing at 5 %.
    a, b = np.abs(with_it), np.abs(without)
    if 0.5**a.size > level or not b.any():
        return math.inf
    if not a.any():
        return 0.0
    swaps = _orders(a.size)

    def rejected(r: float) -> bool:
        # Under the hypothesis that the ratio is r, the two of a pair may be exchanged: every exchange
        # replaces its a²/r² by b². p(r) is the share of exchanges whose sum is no larger than the observed
        # one.
        squares, others = np.square(a / r), np.square(b)
        mine = squares.sum() + swaps @ (others - squares)
        return float(np.mean(mine <= squares.sum() * (1.0 + 1e-12))) <= level

    # p falls with r from the observed ratio on: the bound by bisection of ln r.
    ratio = float(np.sqrt(np.square(a).sum() / np.square(b).sum()))
    low, high = math.log(ratio), math.log(ratio) + 1.0
    while not rejected(math.exp(high)):
        high += 1.0
        if high > low + 20.0:
            return math.inf
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if rejected(math.exp(middle)) else (middle, high)
    return math.exp(high)


def _orders(pairs: int) -> Floats:
    """(orders, pairs) 1 where the records of a pair are exchanged; all orders, or a random sample."""
    if pairs <= _ALL:
        return ((np.arange(2**pairs)[:, None] >> np.arange(pairs)) & 1).astype(float)
    drawn = np.random.default_rng(0).integers(0, 2, (_DRAWN, pairs)).astype(float)
    drawn[0] = 0.0  # the observed order
    return drawn


def _quantity_and_target(runs: Sequence[Run]) -> tuple[str, float, str]:
    """The quantity and its target, from the records' own sweeps."""
    targets: set[tuple[str, float, str]] = set()
    for run in runs:
        ending = f"_{TARGET}"
        names = [str(name) for name in run.records.columns if str(name).endswith(ending)]
        wanted = {PAIR, COMPENSATED} <= set(run.records.columns)
        if len(names) != 1 or not wanted or names[0].removesuffix(ending) not in run.records.columns:
            raise RigctlError(
                f"the run {run.id} is no check of a schedule",
                value=run.header.procedure.name,
                expected="a run of a procedure that 'rigctl compensate -o check.yaml' wrote",
            )
        unit = run.record_units.get(names[0], "1")
        values = {parse_unit(unit).to_si(float(one)) for one in run.records[names[0]].dropna()}
        targets |= {(names[0].removesuffix(ending), one, unit) for one in values}
    if len(targets) != 1:
        raise RigctlError(
            "the records are of no check, or of several", value=", ".join(run.id for run in runs)
        )
    return targets.pop()
