"""The result of letting a bench learn, for a reader who has a minute."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigctl.answers.blocks import Answer, nonempty
from rigctl.answers.errors import error_text, held_out_text
from rigctl.answers.improvement import sizes_in
from rigctl.answers.numbers import plural
from rigctl.answers.systematic_error import falls
from rigctl.learning.ending import LearningEnd
from rigctl.learning.result import Learned
from rigctl.model.fit.fit import FitResult
from rigctl.planning.outline import clock_time


def learning_answer(
    learned: Learned, fits: Sequence[FitResult] = (), remaining: Sequence[Mapping[str, float]] = ()
) -> Answer:
    """The end of a learning loop, the added effects, the change of the error, and the tested predictions.

    Parameters
    ----------
    fits: of the original and the current model, on all measurements; without them the error is not stated.
    remaining: of each of them, as of `systematic.falls`.
    """
    good = learned.ended is LearningEnd.ADEQUATE
    predictions = [f"round {one.number}: {one.achieved.statement}" for one in learned.rounds if one.achieved]
    facts = [
        ("added", ", ".join(f"{name} (version {v})" for one in learned.rounds for name, v in one.added)),
        ("size", sizes_in(fits[-1].problem, learned.added) if fits else ""),
        ("error", error_text(falls(fits, remaining)) if fits else ""),
        ("held out", held_out_text(fits) if fits else ""),
        ("predicted", "; ".join(predictions[-1:])),
        (
            "took",
            f"{plural(len([one for one in learned.rounds if one.judged]), 'round')}, "
            f"{clock_time(learned.spent)} of bench time",
        ),
    ]
    if learned.sensor:
        facts.append(("sensor", f"of {' and '.join(learned.sensor)} would distinguish what is left"))
    return Answer(
        "good" if good else "warn", learned.ended.heading, learned.statement.rstrip("."), nonempty(facts)
    )
