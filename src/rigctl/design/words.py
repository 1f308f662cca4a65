"""A designed experiment in words: what it tells apart, how surely, and why each record is taken."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.design.result import DesignResult, Outlook, ProposedRecord
from rigctl.planning.outline import clock_time

#: below this probability a set is no answer
HALF = 0.5


def share(probability: float) -> str:
    """A probability in per cent; never surer than 99 %."""
    if probability > 0.99:
        return "over 99 %"
    return f"{100.0 * probability:.0f} %" if probability >= 0.01 else "under 1 %"


def statement(found: DesignResult) -> str:
    """The answer in a sentence or two."""
    if found.aim == "precision":
        return _precision(found)
    question = _question(found)
    if not found.records:
        return f"Not to be told apart on this bench: no record that it can make differs for {question}"
    count = len(found.records)
    what = f"{count} record{'' if count == 1 else 's'} of {clock_time(found.duration)} of the rig's time"
    if found.after < HALF:
        return (
            f"Not to be told apart on this bench: the best {what} would do it for {question} "
            f"with a probability of {share(found.after)}"
        )
    verb = "shows" if count == 1 else "show"
    told = f"{verb} {question}" if found.aim == "detection" else f"{verb[:0]}tell {question} apart"
    if count == 1 and found.aim != "detection":
        told = f"tells {question} apart"
    return f"{what} {told} with a probability of {share(found.after)}, now {share(found.before)}"


def _question(found: DesignResult) -> str:
    if found.aim == "detection":
        return " or ".join(dict.fromkeys(one.truth for one in found.outlooks)) + " at its usual size"
    names = list(dict.fromkeys(name for pair in found.separates for name in pair))
    return _listed(names)


def _precision(found: DesignResult) -> str:
    name = " and ".join(found.rivals[0].effects)
    if not found.records:
        return f"{name} is what is missing, and no record that this bench can make tells its size better"
    gains = ", ".join(
        f"{one.name.partition('.')[2]} ± {one.before:.3g} {one.unit} becomes ± {one.after:.3g} {one.unit}"
        for one in found.sharpened
    )
    count = len(found.records)
    return (
        f"{name} is what is missing; {count} record{'' if count == 1 else 's'} of "
        f"{clock_time(found.duration)} of the rig's time would tell its size better: {gains} (95 %)"
    )


def header(found: DesignResult) -> list[str]:
    """What stands above the procedure."""
    runs = ", ".join(found.runs)
    lines = [
        "Written by 'rigctl design'.",
        f"{found.statement}.",
        f"Designed for the model '{found.model}' on {runs}.",
    ]
    return lines + [outlook_text(one) for one in found.outlooks]


def outlook_text(one: Outlook) -> str:
    """What is promised of one pair."""
    return (
        f"Were {one.truth} right, it would be told from {one.rival} with {share(one.after)}: "
        f"expected gain D = {one.separation:.3g} ± {one.spread:.2g}."
    )


def reason(found: DesignResult, number: int) -> list[str]:
    """What stands above a record of the procedure."""
    one = found.records[number]
    if found.aim == "precision":
        return [f"Record {number + 1}: {one.why}."]
    return [
        f"Record {number + 1}: {one.why}.",
        f"The probability goes from {share(one.before)} to {share(one.after)}; "
        f"{clock_time(one.duration)} of the rig's time.",
    ]


def reason_of_record(record: ProposedRecord) -> str:
    """What a record adds, beside a repeat of what was done."""
    return (
        f"D grows by {record.separation:.3g}, by a repeat of a record taken already by {record.of_repeat:.3g}"
    )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
