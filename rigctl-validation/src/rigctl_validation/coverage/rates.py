"""Rates of the tier of coverage, beside their targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from rigctl_validation.coverage.misread import WRITTEN, Written
from rigctl_validation.coverage.trial import CoverageTrial
from rigctl_validation.coverage.work import CoverageOutcome
from rigctl_validation.figures import Figures, Rate, rate_of

_LOW, _HIGH = 0.93, 0.97


def coverage_rates(outcomes: Sequence[CoverageOutcome]) -> tuple[Rate, ...]:
    """The rates that have a target, then these by kind of calibration, by guess and by bench."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    nothing = [outcome for outcome in counted if not outcome.scenario.hidden]
    hidden = [outcome for outcome in counted if outcome.scenario.hidden]
    rates = [
        *_every_coverage(nothing, "values of the bench, nothing hidden"),
        *_every_coverage(hidden, "size of the hidden effect"),
        rate_of("an effect is said to be missing", "nothing hidden", nothing, _alarm, at_most=0.01),
        rate_of("adequate", "nothing hidden", nothing, lambda outcome: outcome.verdict == "adequate"),
        rate_of("a sensor is said to be wrong by more", "nothing hidden", nothing, _beyond, at_most=0.05),
        rate_of("right, or its class", "hidden", hidden, lambda outcome: outcome.right),
        rate_of("wrong name", "hidden", hidden, _wrong, at_most=0.02),
        rate_of("explained by the stated calibrations", "hidden", hidden, _by_sensors),
        rate_of("adequate without a word of sensors", "hidden", hidden, _green, at_most=0.01),
        rate_of("failed", "all trials", counted, lambda outcome: bool(outcome.failure), at_most=0.0),
        *_parted(nothing, hidden),
    ]
    return tuple(rate for rate in rates if rate.trials)


def coverage_figures(outcomes: Sequence[CoverageOutcome]) -> Figures:
    """All results of the tier that are printed."""
    rows: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        if outcome.scenario.hidden and outcome.counts:
            row = f"{outcome.scenario.hidden} of {outcome.scenario.bench}"
            rows.setdefault(row, Counter())[row if outcome.right else _answer(outcome)] += 1
    named = {row: dict(rows[row].most_common()) for row in sorted(rows)}
    return Figures(tuple(outcomes), coverage_rates(outcomes), named)


def _answer(outcome: CoverageOutcome) -> str:
    if outcome.accepted:
        return " and ".join(outcome.effects)
    return outcome.explained_by or str(outcome.verdict or "failed")


def _alarm(outcome: CoverageOutcome) -> bool:
    """A sensor within its calibration, or a guess within its range, is taken for something missing."""
    if outcome.failure or outcome.accepted:
        return True
    return outcome.verdict == "outside_library" and not outcome.explained_by


def _beyond(outcome: CoverageOutcome) -> bool:
    """A sensor is said to be wrong by more than is stated, which 5 % of the errors drawn are."""
    return outcome.verdict == "outside_library" and bool(outcome.explained_by)


def _wrong(outcome: CoverageOutcome) -> bool:
    return outcome.accepted and not outcome.right


def _by_sensors(outcome: CoverageOutcome) -> bool:
    return bool(outcome.explained_by)


def _green(outcome: CoverageOutcome) -> bool:
    return outcome.verdict == "adequate" and not outcome.explained_by


def _every_coverage(among: Sequence[CoverageOutcome], of: str) -> Iterator[Rate]:
    """Where a kind is stated, each part may take all of the uncertainty, and intervals are wider.

    With an uncertainty alone they are those of exact sensors, unless errors of sensors are the answer.
    """
    of_each: dict[Written, list[CoverageOutcome]] = {
        written: [outcome for outcome in among if outcome.scenario.written == written] for written in WRITTEN
    }
    yield _covered(of_each["parts"], f"{of}, parts stated", _LOW, _HIGH)
    yield _covered(of_each["kind"], f"{of}, kind stated", _LOW)
    yield _covered(of_each["uncertainty"], f"{of}, uncertainty alone")


def _covered(
    among: Sequence[CoverageOutcome], of: str, low: float | None = None, high: float | None = None
) -> Rate:
    # that of the guess itself is its stated range where the data do not show it, and always right
    intervals = [
        one
        for outcome in among
        for one in outcome.intervals
        if one.parameter != outcome.scenario.misread.guess
    ]
    covers = sum(one.covers for one in intervals)
    return Rate("95 % interval covers the truth", of, covers, len(intervals), low, high)


def _parted(nothing: Sequence[CoverageOutcome], hidden: Sequence[CoverageOutcome]) -> Iterator[Rate]:
    parts: tuple[tuple[str, Callable[[CoverageTrial], str]], ...] = (
        ("calibration", lambda trial: trial.kind),
        ("stated", lambda trial: trial.written),
        ("model", lambda trial: "with a guess" if trial.assumed else "without a guess"),
        ("bench", lambda trial: trial.bench),
    )
    for by, part in parts:
        for value in dict.fromkeys(sorted(part(outcome.scenario) for outcome in (*nothing, *hidden))):
            here = [outcome for outcome in nothing if part(outcome.scenario) == value]
            there = [outcome for outcome in hidden if part(outcome.scenario) == value]
            of = f"{by}: {value}"
            yield _covered(here, of)
            yield rate_of("an effect is said to be missing", of, here, _alarm)
            yield rate_of("right, or its class", of, there, lambda outcome: outcome.right)
