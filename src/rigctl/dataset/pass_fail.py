"""Pass or fail of the device under test, from all measures of a run that have limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.history import History, TakenMeasure
from rigctl.json_values import parse_json
from rigctl.plan.measured import MeasuredValue
from rigctl.units import show

if TYPE_CHECKING:
    from rigctl.dataset.run import Run

PASS: Final = "pass"  # noqa: S105 - not a password
FAIL: Final = "fail"
INCOMPLETE: Final = "incomplete"  #: the run was not completed, and no measure failed
NONE: Final = "none"  #: no measure has limits


@dataclass(frozen=True)
class Judged:
    """One measure with limits, and its record; None for a measure of the run itself."""

    taken: TakenMeasure
    record: str | None

    @property
    def passed(self) -> bool:
        """Whether it is within its limits."""
        return self.taken.value.passed

    @property
    def where(self) -> str:
        """The record for messages: ``record 3 'stroke'``; "" for the run."""
        return "" if self.record is None else f"record {self.taken.record} '{self.record}'"

    def sentence(self) -> str:
        """The value and its limits: ``travel is 80 mm, expected at least 90 mm``."""
        value = self.taken.value
        statement = "has no value" if math.isnan(value.value) else f"is {self._shown(value.value)}"
        without = f" without {100.0 * value.missing:.2g} % of the readings" if value.missing else ""
        return f"{value.name} {statement}{without}, expected {self._limits()}"

    def _limits(self) -> str:
        low, high = self.taken.value.low, self.taken.value.high
        if low is not None and high is not None:
            return f"{self._shown(low)} to {self._shown(high)}"
        return f"at least {self._shown(low)}" if low is not None else f"at most {self._shown(high or 0.0)}"

    def _shown(self, si: float) -> str:
        return show(si, self.taken.value.unit, difference=self.taken.value.difference)


@dataclass(frozen=True)
class Judgement:
    """The judgement of a run: ``pass`` only if it was completed and all values are within limits."""

    result: str
    measures: Sequence[Judged]

    @property
    def missed(self) -> list[Judged]:
        """The measures outside their limits."""
        return [measure for measure in self.measures if not measure.passed]

    def to_json(self) -> dict[str, Any]:
        """Return the result and its counts, for ``run.json``."""
        missed = len(self.missed)
        return {"result": self.result, "passed": len(self.measures) - missed, "missed": missed}


def judge(history: History) -> Judgement:
    """Judge a run from its log.

    If a step was repeated, after a loss of samples or in a later session, its last value counts; each
    iteration of a loop counts separately.
    """
    names = [record.name for record in history.records]
    complete = history.status == "finished" and not history.damaged_lines
    return _judgement(history.taken, names, complete=complete)


def judge_run(run: Run) -> Judgement:
    """Judge a closed run from its events, also in storage."""
    complete = run.info["status"] == "finished" and not run.info.get("damaged_lines")
    return _judgement(taken_in(run), run.records["name"].tolist(), complete=complete)


def taken_in(run: Run) -> list[TakenMeasure]:
    """Return every value measured in a run, in order of time, from its events."""
    events = run.table("events")
    columns = (events[name].to_pylist() for name in ("kind", "time", "path", "data"))
    measures = []
    with run.event_data():
        for kind, time, path, data in zip(*columns, strict=True):
            if kind == "measure":
                measures.append(_taken(float(time), path or "", parse_json(data)))
    return measures


def _taken(time: float, path: str, fields: Mapping[str, Any]) -> TakenMeasure:
    facts = {key: fields[key] for key in ("name", "unit", "low", "high", "passed", "difference")}
    value = math.nan if fields["value"] is None else float(fields["value"])
    later = {"typed": fields.get("typed", False), "missing": float(fields.get("missing", 0.0))}
    measured = MeasuredValue(value=value, **facts, **later, path=path)
    return TakenMeasure(time, int(fields["record"]), measured)


def _judgement(taken: Iterable[TakenMeasure], names: Sequence[str], *, complete: bool) -> Judgement:
    """Judge the newest value of each step; `complete`: the run was completed and its log is undamaged."""
    latest: dict[tuple[str, str], TakenMeasure] = {}
    for one in taken:
        if one.value.judged:
            # logs of earlier versions do not name the step of a value: each counts separately
            key = one.value.path or f"{one.record} {one.time}"
            latest[key, one.value.name] = one
    measures = [
        Judged(one, None if one.record < 0 else names[one.record])
        for one in sorted(latest.values(), key=lambda one: one.time)
    ]
    if any(not measure.passed for measure in measures):
        return Judgement(FAIL, measures)
    if not complete:
        return Judgement(INCOMPLETE, measures)
    return Judgement(PASS if measures else NONE, measures)
