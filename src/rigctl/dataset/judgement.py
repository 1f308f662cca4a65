"""Whether the device under test has passed: the measures of a run that have limits, judged together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from rigctl.dataset.history import History, TakenMeasure
from rigctl.units import show

PASS: Final = "pass"  # noqa: S105 - no word of entry
FAIL: Final = "fail"
INCOMPLETE: Final = "incomplete"  #: the run did not come to its end, and what it came to has passed
NONE: Final = "none"  #: nothing has limits


@dataclass(frozen=True)
class Judged:
    """One measure with limits, and the record that it was taken in; None for one of the run itself."""

    taken: TakenMeasure
    record: str | None

    @property
    def passed(self) -> bool:
        """Whether it lies within its limits."""
        return self.taken.value.passed

    @property
    def where(self) -> str:
        """The record as a person names it: ``record 3 'stroke'``; "" for the run."""
        return "" if self.record is None else f"record {self.taken.record} '{self.record}'"

    def sentence(self) -> str:
        """The value and its limits: ``travel is 80 mm, expected at least 90 mm``."""
        value = self.taken.value
        found = "has no value" if value.value != value.value else f"is {self._shown(value.value)}"
        return f"{value.name} {found}, expected {self._limits()}"

    def _limits(self) -> str:
        low, high = self.taken.value.low, self.taken.value.high
        if low is not None and high is not None:
            return f"{self._shown(low)} to {self._shown(high)}"
        return f"at least {self._shown(low)}" if low is not None else f"at most {self._shown(high or 0.0)}"

    def _shown(self, si: float) -> str:
        return show(si, self.taken.value.unit, difference=self.taken.value.difference)


@dataclass(frozen=True)
class Judgement:
    """What a run says of its device: ``pass`` only where it came to its end and every limit was kept."""

    result: str
    measures: Sequence[Judged]

    @property
    def missed(self) -> list[Judged]:
        """The measures outside their limits."""
        return [measure for measure in self.measures if not measure.passed]

    def to_json(self) -> dict[str, Any]:
        """The result and its counts, for ``run.json``."""
        missed = len(self.missed)
        return {"result": self.result, "passed": len(self.measures) - missed, "missed": missed}


def judge(history: History) -> Judgement:
    """Judge a run by its log.

    Of a step that was carried out again, after a loss of samples or in a later session, the last value
    counts; each round of a loop counts by itself.
    """
    latest: dict[tuple[str, str], TakenMeasure] = {}
    for taken in history.taken:
        if taken.value.judged:
            # logs of earlier versions do not say which step took a value: each is one of its own
            key = taken.value.path or f"{taken.record} {taken.time}"
            latest[key, taken.value.name] = taken
    measures = [
        Judged(taken, None if taken.record < 0 else history.records[taken.record].name)
        for taken in sorted(latest.values(), key=lambda one: one.time)
    ]
    return Judgement(_result(history, measures), measures)


def _result(history: History, measures: Sequence[Judged]) -> str:
    if any(not measure.passed for measure in measures):
        return FAIL
    if history.damaged_lines:
        return INCOMPLETE  # what they said may have been a miss
    if history.status != "finished":
        return INCOMPLETE
    return PASS if measures else NONE
