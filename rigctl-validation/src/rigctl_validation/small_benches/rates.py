"""Rates of the tier of small benches, beside their targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence

from rigctl_validation.figures import Figures, Rate, rate_of
from rigctl_validation.small_benches.work import BenchOutcome

#: least λ of effects that must be found
_PLAIN = 30.0


def bench_rates(outcomes: Iterable[BenchOutcome]) -> tuple[Rate, ...]:
    """The rates that have a target, then these rates by bench and by how the data were taken."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    nothing = [outcome for outcome in counted if not outcome.scenario.size]
    hidden = [outcome for outcome in counted if outcome.scenario.size >= _PLAIN]
    rates = [
        rate_of("false alarm", "nothing hidden", nothing, alarm, at_most=0.05),
        rate_of("right, or its class", f"λ >= {_PLAIN:g}", hidden, found_right, at_least=0.95),
        rate_of("wrong", "all trials", counted, wrong, at_most=0.01),
        rate_of("something is missing, not what", f"λ >= {_PLAIN:g}", hidden, outside),
        rate_of("called adequate", f"λ >= {_PLAIN:g}", hidden, lambda o: o.verdict == "adequate"),
        rate_of("failed", "all trials", counted, lambda o: bool(o.failure)),
        *_parted("false alarm", nothing, alarm),
        *_parted("right, or its class", hidden, found_right),
    ]
    return tuple(rate for rate in rates if rate.trials)


def bench_figures(outcomes: Sequence[BenchOutcome]) -> Figures:
    """All results of the tier that are printed."""
    rows: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        if outcome.scenario.size and outcome.counts:
            rows.setdefault(outcome.scenario.bench, Counter())[_answer(outcome)] += 1
    named = {bench: dict(rows[bench].most_common()) for bench in sorted(rows)}
    return Figures(tuple(outcomes), bench_rates(outcomes), named)


def _answer(outcome: BenchOutcome) -> str:
    """The bench's name for the right answer, else the answer given."""
    if outcome.right:
        return outcome.scenario.bench
    return " and ".join(outcome.effects) if outcome.accepted else str(outcome.verdict or "failed")


def alarm(outcome: BenchOutcome) -> bool:
    """The verdict on a bench that hides nothing is not `adequate`; a failure counts as an alarm."""
    return outcome.verdict != "adequate"


def found_right(outcome: BenchOutcome) -> bool:
    """The hidden effect is named, alone or in a class with others."""
    return outcome.right


def wrong(outcome: BenchOutcome) -> bool:
    """An effect is named that is neither hidden nor in a class with a hidden one."""
    return outcome.accepted and not outcome.right


def outside(outcome: BenchOutcome) -> bool:
    """Nothing is named, and the answer is that something is missing."""
    return outcome.verdict == "outside_library"


def _parted(
    name: str, among: Sequence[BenchOutcome], happened: Callable[[BenchOutcome], bool]
) -> Iterator[Rate]:
    """The rate by bench, by sampling, by whether the optional input was recorded, and by noise."""
    parts: tuple[tuple[str, Callable[[BenchOutcome], str]], ...] = (
        ("bench", lambda o: o.scenario.bench),
        ("sampling", lambda o: o.scenario.sampling),
        ("optional input", lambda o: "recorded" if o.scenario.recorded else "not recorded"),
        ("noise", lambda o: o.scenario.noise),
    )
    for by, part in parts:
        for value in sorted({part(outcome) for outcome in among}):
            yield rate_of(name, f"{by}: {value}", [o for o in among if part(o) == value], happened)
