"""What is counted on real logs: verdicts that must never be given, and how far the errors fall."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from rigctl_validation.figures import Figures, Rate, rate_of
from rigctl_validation.real.logs import LOGS, RealLog
from rigctl_validation.real.work import RealOutcome

#: an improved model's error may be this much larger than that of the best known one
_WITHIN = 1.2
#: a wrong effect makes what is unseen worse by more than this share
_WORSE = 0.05
_NAMED = ("missing_effect", "ambiguous")
_LISTED = (
    "log",
    "verdict",
    "named",
    "added",
    "R²",
    "unseen",
    "before",
    "after",
    "known: base to best",
    "truth",
)


def green(outcome: RealOutcome) -> bool:
    """The answer is that the data show nothing that the base model lacks: it lacks something in every log."""
    return outcome.verdict == "adequate"


def wrong(outcome: RealOutcome) -> bool:
    """An effect is named that is no right answer, alone or in a class."""
    log = LOGS[outcome.scenario.log]
    return _named(outcome) and not all(
        log.is_right(outcome.named_class(effect)) for effect in outcome.effects
    )


def right(outcome: RealOutcome) -> bool:
    """Every effect that is named is a right answer, alone or in a class."""
    return _named(outcome) and not wrong(outcome)


def real_rates(outcomes: Iterable[RealOutcome]) -> tuple[Rate, ...]:
    """The rates that have a target: of all lengths, and of the whole logs."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    whole = [outcome for outcome in counted if not outcome.scenario.rows]
    return tuple(
        rate
        for rate in (
            rate_of("wrong green", "every length", counted, green, at_most=0.0),
            rate_of("wrong name", "every length", counted, wrong, at_most=0.0),
            rate_of("right, or its class", "whole logs", whole, right),
            rate_of("right, or its class", "every length", counted, right),
            rate_of("not decided", "every length", counted, lambda o: o.verdict == "undecided"),
            rate_of("what is unseen became worse", "every length", counted, _worse, at_most=0.0),
            rate_of("failed", "every length", counted, lambda o: bool(o.failure), at_most=0.0),
            *_reached(whole),
            *_opposite(counted),
        )
        if rate.trials
    )


def real_figures(outcomes: Sequence[RealOutcome]) -> Figures:
    """All results of the tier that are printed."""
    return Figures(tuple(outcomes), real_rates(outcomes), {}, tuple(_listing(outcomes)))


def _named(outcome: RealOutcome) -> bool:
    return outcome.verdict in _NAMED and bool(outcome.effects)


def _worse(outcome: RealOutcome) -> bool:
    """What was added made the simulation of an unseen part worse, or impossible."""
    found = outcome.improved
    if found is None or not found.added:
        return False
    return not all(found.after[part] <= (1.0 + _WORSE) * found.before[part] for part in found.before)


def _reached(whole: Sequence[RealOutcome]) -> Iterator[Rate]:
    """The share of unseen parts whose error is near that of the best known model."""
    parts = [
        after <= _WITHIN * LOGS[outcome.scenario.log].known[part][1]
        for outcome in whole
        if outcome.improved is not None
        for part, after in outcome.improved.after.items()
    ]
    name = "the best known error reached"
    yield Rate(name, f"unseen parts, within {_WITHIN - 1.0:.0%}", sum(parts), len(parts), at_least=1.0)


def _opposite(counted: Sequence[RealOutcome]) -> Iterator[Rate]:
    """Logs with opposite claims at different lengths: adequate at one, something missing at another."""
    claims: dict[str, set[bool]] = {}
    for outcome in counted:
        if outcome.verdict in ("adequate", *_NAMED, "outside_library"):
            claims.setdefault(outcome.scenario.log, set()).add(green(outcome))
    logs = {outcome.scenario.log for outcome in counted}
    yield Rate(
        "opposite claims",
        "logs, over their lengths",
        sum(len(c) > 1 for c in claims.values()),
        len(logs),
        at_most=0.0,
    )


def _listing(outcomes: Sequence[RealOutcome]) -> Iterator[tuple[str, ...]]:
    """A row for each trial and unseen part."""
    yield _LISTED
    for outcome in outcomes:
        log, found = LOGS[outcome.scenario.log], outcome.improved
        mark = " (wrong)" if green(outcome) or wrong(outcome) else ""
        verdict = (outcome.verdict or "failed").replace("_", " ") + mark
        named = ", ".join(_class_text(outcome, effect) for effect in outcome.effects)
        if found is None:
            yield (outcome.scenario.name, verdict, named, "", "", "", "", "", "", log.truth)
            continue
        r2 = ", ".join("–" if value is None else f"{value:.2f}" for value in found.r2.values())
        for k, part in enumerate(found.before):
            begin = (outcome.scenario.name, verdict, named, ", ".join(found.added), r2)
            yield (
                *(begin if k == 0 else ("",) * len(begin)),
                part,
                _error(found.before, part, log),
                _error(found.after, part, log),
                " to ".join(f"{value:g}" for value in log.known[part]) + f" {log.unit}",
                log.truth if k == 0 else "",
            )


def _class_text(outcome: RealOutcome, effect: str) -> str:
    others = sorted(outcome.named_class(effect) - {effect})
    return f"{effect} (or {', '.join(others)})" if others else effect


def _error(errors: Mapping[str, float], part: str, log: RealLog) -> str:
    value = errors[part]
    return f"{value:.3g} {log.unit}" if math.isfinite(value) else "–"
