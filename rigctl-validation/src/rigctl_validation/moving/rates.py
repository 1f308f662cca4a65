"""Rates of the tier of moving twins, beside their targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence

from rigctl_validation.figures import Figures, Rate, rate_of
from rigctl_validation.moving.spoiled import ADEQUATE_IS_RIGHT
from rigctl_validation.moving.trial import MovingTrial
from rigctl_validation.moving.work import MovingOutcome
from rigctl_validation.moving_benches.slow_noise import COLOURS

_NAMED = ("missing_effect", "ambiguous")
_ALARMS = ("missing_effect", "ambiguous", "outside_library")
_QUIET = ("undecided", "refused")


def right(outcome: MovingOutcome) -> bool:
    """The hidden effect is named, alone or in a class, and nothing that is wrong beside it."""
    hidden = set(outcome.scenario.truth)
    return _named(outcome) and not wrong(outcome) and any(hidden & each for each in _classes(outcome))


def wrong(outcome: MovingOutcome) -> bool:
    """An effect is named that is neither hidden nor in a class with a hidden one, nor the noise's drift."""
    allowed = {*outcome.scenario.truth, *outcome.scenario.beside}
    return _named(outcome) and not all(allowed & each for each in _classes(outcome))


def green(outcome: MovingOutcome) -> bool:
    """The answer is that the data show nothing that the model lacks."""
    return outcome.verdict == "adequate"


def alarm(outcome: MovingOutcome) -> bool:
    """Nothing is hidden, and the answer is that something is missing; a failure counts as an alarm."""
    if outcome.failure:
        return True
    return outcome.verdict in _ALARMS and (not _named(outcome) or wrong(outcome))


def undecided(outcome: MovingOutcome) -> bool:
    """The answer is that these data cannot tell."""
    return outcome.verdict in _QUIET


def in_colour(outcome: MovingOutcome) -> bool:
    """A spoiled log has got a verdict."""
    quiet = (*_QUIET, "adequate") if outcome.scenario.spoiled in ADEQUATE_IS_RIGHT else _QUIET
    return outcome.verdict not in quiet


def moving_rates(outcomes: Iterable[MovingOutcome]) -> tuple[Rate, ...]:
    """The rates that have a target, then these by noise and statement, by motion and by bench."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    spoiled = [outcome for outcome in counted if outcome.scenario.spoiled]
    sound = [outcome for outcome in counted if not outcome.scenario.spoiled]
    nothing = [outcome for outcome in sound if not outcome.scenario.hidden]
    hidden = [outcome for outcome in sound if outcome.scenario.hidden]
    rates = [
        *_by_statement(hidden, nothing),
        rate_of("a verdict for a spoiled log", "all kinds", spoiled, in_colour, at_most=0.0),
        rate_of("failed", "all trials", counted, lambda outcome: bool(outcome.failure), at_most=0.0),
        *_coverage(sound),
        *_by_noise(hidden, nothing),
        *_parted(hidden, nothing, "motion", lambda trial: trial.motion),
        *_parted(hidden, nothing, "bench", lambda trial: trial.bench),
        *_by_fault(spoiled),
    ]
    return tuple(rate for rate in rates if rate.trials)


def moving_figures(outcomes: Sequence[MovingOutcome]) -> Figures:
    """All results of the tier that are printed."""
    rows: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        if outcome.scenario.hidden and outcome.counts:
            rows.setdefault(_row(outcome), Counter())[_answer(outcome)] += 1
    named = {row: dict(rows[row].most_common()) for row in sorted(rows)}
    return Figures(tuple(outcomes), moving_rates(outcomes), named)


def _named(outcome: MovingOutcome) -> bool:
    return outcome.verdict in _NAMED and bool(outcome.effects)


def _classes(outcome: MovingOutcome) -> Iterator[frozenset[str]]:
    yield from (outcome.named_class(effect) for effect in outcome.effects)


def _outside(outcome: MovingOutcome) -> bool:
    return outcome.verdict == "outside_library"


def _row(outcome: MovingOutcome) -> str:
    return f"{outcome.scenario.hidden} of {outcome.scenario.bench}"


def _answer(outcome: MovingOutcome) -> str:
    """The row's own name for the right answer, else the answer given."""
    if right(outcome):
        return _row(outcome)
    return " and ".join(outcome.effects) if _named(outcome) else str(outcome.verdict or "failed")


def _by_statement(hidden: Sequence[MovingOutcome], nothing: Sequence[MovingOutcome]) -> Iterator[Rate]:
    """The answers where the rig file says nothing of the noise, which have targets, and where it does."""
    for statement in ("unstated", "stated", "wrongly stated"):
        least, names, greens, alarms = (0.85, 0.02, 0.01, 0.02) if statement == "unstated" else (None,) * 4
        here = [o for o in hidden if _stated(o.scenario) == statement]
        there = [o for o in nothing if _stated(o.scenario) == statement]
        yield rate_of("right, or its class", f"hidden, noise {statement}", here, right, at_least=least)
        yield rate_of("wrong name", f"hidden, noise {statement}", here, wrong, at_most=names)
        yield rate_of("wrong green", f"hidden, noise {statement}", here, green, at_most=greens)
        yield rate_of("false alarm", f"nothing hidden, noise {statement}", there, alarm, at_most=alarms)
        yield rate_of("not decided", f"hidden, noise {statement}", here, undecided)
        yield rate_of("not decided", f"nothing hidden, noise {statement}", there, undecided)
        yield rate_of("something is missing, not what", f"hidden, noise {statement}", here, _outside)


def _coverage(sound: Sequence[MovingOutcome]) -> Iterator[Rate]:
    """Of the hidden effect's size where it is named; of the bench's own values where nothing is hidden."""
    name = "95 % interval covers the truth"
    for of, sizes, low, high in (
        ("size of the hidden effect", True, 0.93, 0.97),
        ("values of the bench, nothing hidden", False, 0.93, 0.97),
    ):
        among = [i for o in sound for i in o.intervals if bool(i.effect) == sizes]
        yield Rate(name, of, sum(i.covers for i in among), len(among), low, high)
        for colour in COLOURS:
            part = [
                i
                for o in sound
                if o.scenario.colour == colour
                for i in o.intervals
                if bool(i.effect) == sizes
            ]
            yield Rate(name, f"{of}, {colour} noise", sum(i.covers for i in part), len(part))


def _by_noise(hidden: Sequence[MovingOutcome], nothing: Sequence[MovingOutcome]) -> Iterator[Rate]:
    """Every answer for each colour of the noise and each statement of it."""
    for colour in COLOURS:
        for statement in ("unstated", "stated", "wrongly stated"):
            of = f"{colour} noise, {statement}"
            here = [o for o in hidden if (o.scenario.colour, _stated(o.scenario)) == (colour, statement)]
            there = [o for o in nothing if (o.scenario.colour, _stated(o.scenario)) == (colour, statement)]
            yield from _answers(here, there, of)


def _stated(trial: MovingTrial) -> str:
    return trial.statement if trial.statement in ("unstated", "stated") else "wrongly stated"


def _parted(
    hidden: Sequence[MovingOutcome],
    nothing: Sequence[MovingOutcome],
    by: str,
    part: Callable[[MovingTrial], str],
) -> Iterator[Rate]:
    for value in dict.fromkeys(sorted(part(outcome.scenario) for outcome in (*hidden, *nothing))):
        here = [outcome for outcome in hidden if part(outcome.scenario) == value]
        there = [outcome for outcome in nothing if part(outcome.scenario) == value]
        yield from _answers(here, there, f"{by}: {value}")


def _answers(hidden: Sequence[MovingOutcome], nothing: Sequence[MovingOutcome], of: str) -> Iterator[Rate]:
    yield rate_of("right, or its class", of, hidden, right)
    yield rate_of("wrong name", of, hidden, wrong)
    yield rate_of("wrong green", of, hidden, green)
    yield rate_of("not decided, something hidden", of, hidden, undecided)
    yield rate_of("false alarm", of, nothing, alarm)
    yield rate_of("not decided, nothing hidden", of, nothing, undecided)


def _by_fault(spoiled: Sequence[MovingOutcome]) -> Iterator[Rate]:
    for kind in dict.fromkeys(sorted(outcome.scenario.spoiled for outcome in spoiled)):
        among = [outcome for outcome in spoiled if outcome.scenario.spoiled == kind]
        yield rate_of("a verdict for a spoiled log", kind, among, in_colour)
