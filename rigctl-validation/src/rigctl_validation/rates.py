"""Rates of the benchmark with their Wilson bounds, pooled over effects, beside their targets."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from rigctl_validation.amplitude import CLOSE
from rigctl_validation.figures import Figures, Rate, rate_of
from rigctl_validation.outcome import Outcome

#: separation below which a class must be reported, and above which one effect
SEPARABLE = 2.33
#: a rival with a larger cosine than this limits the power of any method
NEAR_TWIN = 0.85
#: least λ of two effects that are to be found together
TOGETHER = 10.0
#: entry of the confusion matrix if no effect was named
NOTHING_NAMED = "none"


def rates(outcomes: Iterable[Outcome]) -> tuple[Rate, ...]:
    """All rates that have a target, then false alarms by noise and the cost of wrong shapes."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    nothing = _of(counted, lambda o: o.scenario.kind == "nothing")
    one = _of(counted, lambda o: o.scenario.kind == "one")
    results = [
        *_false_alarms(nothing),
        *_first(_of(one, lambda o: o.scenario.shape != "wrong"), "hidden effect found as first"),
        *_accepted(counted),
        *_together(counted),
        *_removed(counted),
        *_coverage(counted),
        *_classes(one),
        *_first(_of(one, lambda o: o.scenario.shape == "wrong"), "the same, wrong shape", targets=False),
    ]
    return tuple(rate for rate in results if rate.trials)


def confusion(outcomes: Iterable[Outcome]) -> dict[str, dict[str, int]]:
    """By hidden effect (rows), how often each was ranked first; a verdict of `adequate` counts as none."""
    rows: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        if outcome.scenario.kind == "one" and outcome.counts:
            named = outcome.first if outcome.verdict != "adequate" else None
            rows.setdefault(outcome.scenario.truth[0], Counter())[named or NOTHING_NAMED] += 1
    return {truth: dict(rows[truth].most_common()) for truth in sorted(rows)}


def figures(outcomes: Sequence[Outcome]) -> Figures:
    """All results that are printed for trials on the separate bench."""
    return Figures(tuple(outcomes), rates(outcomes), confusion(outcomes))


def _of(outcomes: Sequence[Outcome], wanted: Callable[[Outcome], bool]) -> list[Outcome]:
    return [outcome for outcome in outcomes if wanted(outcome)]


def _false_alarms(nothing: Sequence[Outcome]) -> list[Rate]:
    name = "false alarm, nothing hidden"

    def alarm(outcome: Outcome) -> bool:
        return outcome.verdict != "adequate"

    estimated = _of(nothing, lambda o: not o.scenario.noise_known)
    results = [
        rate_of(name, "noise known", _of(nothing, lambda o: o.scenario.noise_known), alarm, at_most=0.02),
        rate_of(name, "noise estimated", estimated, alarm, at_most=0.05),
    ]
    for noise in dict.fromkeys(sorted(outcome.scenario.noise for outcome in estimated)):
        among = [outcome for outcome in estimated if outcome.scenario.noise == noise]
        results.append(rate_of(name, f"noise estimated: {noise.replace('_', ' ')}", among, alarm))
    return results


def _distinct(outcome: Outcome) -> bool:
    return outcome.rival_cosine is not None and outcome.rival_cosine < NEAR_TWIN


def _first(one: Sequence[Outcome], name: str, *, targets: bool = True) -> list[Rate]:
    results = []
    for low, high, target in ((0.0, 8.0, 0.85), (8.0, 20.0, 0.97), (20.0, math.inf, 0.99)):
        sized = [outcome for outcome in one if low <= outcome.scenario.hidden[0].size < high]
        sizes = sorted({outcome.scenario.hidden[0].size for outcome in sized})
        of = "λ = " + ", ".join(f"{size:g}" for size in sizes)
        distinct = _of(sized, _distinct)
        wanted = target if targets else None
        results += [
            rate_of(name, f"{of}, all cos < {NEAR_TWIN:g}", distinct, _found_first, at_least=wanted),
            rate_of(name, of, sized, _found_first),
        ]
    return results


def _found_first(outcome: Outcome) -> bool:
    return outcome.verdict not in (None, "adequate") and outcome.first in outcome.scenario.truth


def _accepted(outcomes: Sequence[Outcome]) -> list[Rate]:
    among = _of(outcomes, lambda o: o.scenario.kind in ("one", "two"))

    def wrong(outcome: Outcome) -> bool:
        return outcome.accepted and not outcome.right

    shaped = [o for o in among if o.scenario.shape != "wrong"]
    far = [o for o in among if o.scenario.shape == "wrong"]
    return [
        rate_of("accepted and wrong", "one or two hidden", shaped, wrong, at_most=0.01),
        rate_of("accepted and wrong", "wrong shape", far, wrong),
    ]


def _together(outcomes: Sequence[Outcome]) -> list[Rate]:
    two = _of(
        outcomes, lambda o: o.scenario.kind == "two" and min(w.size for w in o.scenario.hidden) >= TOGETHER
    )
    beside = _of(two, lambda o: min(o.beside, default=math.inf) >= (1.0 - CLOSE) * TOGETHER)
    name = "two hidden effects exactly"
    return [
        rate_of(name, "λ >= 10 each", two, lambda o: o.exact, at_least=0.95),
        rate_of(name, "λ >= 10 each, also beside the other", beside, lambda o: o.exact),
        rate_of(name, f"all cos < {NEAR_TWIN:g}", _of(two, _distinct), lambda o: o.exact),
    ]


def _removed(outcomes: Sequence[Outcome]) -> list[Rate]:
    removed = _of(outcomes, lambda o: o.scenario.kind == "removed")
    name = "outside_library, truth removed from it"

    def outside(outcome: Outcome) -> bool:
        return outcome.verdict == "outside_library"

    return [
        rate_of(name, f"best rival's cos < {NEAR_TWIN:g}", _of(removed, _distinct), outside, at_least=0.95),
        rate_of(name, "all", removed, outside),
    ]


def _coverage(outcomes: Sequence[Outcome]) -> list[Rate]:
    results = []
    for shape, low, high in (("same", 0.90, 0.98), ("other", None, None)):
        intervals = [i for o in outcomes if o.scenario.shape == shape for i in o.intervals]
        count = sum(interval.covers for interval in intervals)
        of = f"{'the library’s own' if shape == 'same' else 'other'} shape"
        results.append(Rate("95 % interval covers the truth", of, count, len(intervals), low, high))
    return results


def _classes(one: Sequence[Outcome]) -> list[Rate]:
    judged = _of(one, lambda o: o.right and o.separation is not None)
    near = _of(judged, lambda o: o.separation is not None and o.separation < SEPARABLE)
    apart = _of(judged, lambda o: o.separation is not None and o.separation >= SEPARABLE)

    def several(outcome: Outcome) -> bool:
        return len(outcome.named_class(outcome.scenario.truth[0])) > 1

    return [
        rate_of("reports the class", f"d < {SEPARABLE}", near, several, at_least=1.0),
        rate_of("class of one", f"d >= {SEPARABLE}", apart, lambda o: not several(o), at_least=1.0),
    ]
