"""Rates of the tier of several devices: the same answers as on one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rigctl_validation.devices.trial import Reading
from rigctl_validation.devices.work import DevicesOutcome
from rigctl_validation.figures import Figures, Rate, rate_of

_SAY: dict[Reading, str] = {
    "one": "one device",
    "several": "several devices",
    "shifted": "one of several 12 ms too old",
}


def devices_rates(outcomes: Sequence[DevicesOutcome]) -> tuple[Rate, ...]:
    """How often several devices give the answer of one, and how often each answer is right."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    rates = [*_same(counted), *(rate for reading in _SAY for rate in _answers(counted, reading))]
    failed = rate_of("failed", "all trials", counted, lambda outcome: bool(outcome.failure), at_most=0.0)
    return tuple(rate for rate in (*rates, failed) if rate.trials)


def devices_figures(outcomes: Sequence[DevicesOutcome]) -> Figures:
    """All results of the tier that are printed: every trial is a row."""
    rows = [("campaign", "read by", "answer")]
    for outcome in outcomes:
        trial = outcome.scenario
        rows.append((trial.scenario.name, _SAY[trial.reading], _in_words(outcome)))
    return Figures(tuple(outcomes), devices_rates(outcomes), {}, tuple(rows))


def answer(outcome: DevicesOutcome) -> tuple[str | None, frozenset[frozenset[str]]]:
    """The verdict, and the effects that are named, each with those from which it is not distinguished."""
    return outcome.verdict, frozenset(map(outcome.named_class, outcome.effects))


def _same(counted: Sequence[DevicesOutcome]) -> Iterator[Rate]:
    """Of the campaigns with both readings: the verdict is the same, and a right answer stays right."""
    of_one = {o.scenario.scenario: o for o in counted if o.scenario.reading == "one"}
    pairs = [
        (of_one[o.scenario.scenario], o)
        for o in counted
        if o.scenario.reading == "several" and o.scenario.scenario in of_one
    ]
    of = "several devices and one"
    yield rate_of("same verdict", of, pairs, lambda pair: pair[0].verdict == pair[1].verdict)
    yield rate_of("same verdict and effects", of, pairs, lambda pair: answer(pair[0]) == answer(pair[1]))


def _answers(counted: Sequence[DevicesOutcome], reading: Reading) -> Iterator[Rate]:
    here = [outcome for outcome in counted if outcome.scenario.reading == reading]
    hidden = [outcome for outcome in here if outcome.scenario.truth]
    nothing = [outcome for outcome in here if not outcome.scenario.truth]
    said = _SAY[reading]
    yield rate_of("right, or its class", f"hidden, {said}", hidden, lambda outcome: outcome.right)
    yield rate_of("wrong name", f"hidden, {said}", hidden, lambda o: o.accepted and not o.right)
    yield rate_of("an effect is named", f"nothing hidden, {said}", nothing, lambda o: o.accepted, at_most=0.0)
    yield rate_of(
        "explained by a clock", f"nothing hidden, {said}", nothing, lambda o: o.explained_by == "clock"
    )


def _in_words(outcome: DevicesOutcome) -> str:
    if outcome.failure or outcome.untested:
        return outcome.failure or outcome.untested
    named = " and ".join(" or ".join(sorted(outcome.named_class(one))) for one in outcome.effects)
    by = f", by {outcome.explained_by}" if outcome.explained_by else ""
    return f"{outcome.verdict}{by}: {named}" if named else f"{outcome.verdict}{by}"
