"""The result of letting a bench learn, for a reader who has a minute.

In: a `Learned`, whose rounds each have a prediction and what was achieved. Out: an `Answer`, blocks below
it, and rows and bars for the page. The heading follows from how the loop ended, and the sentence from the
result that ended it (a diagnosis, a design, a run), so that the loop has no wording of its own for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import assert_never

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.answers.blocks import Answer, Bar, Bars, Block, Column, Next, Points, Sentence, Table, nonempty
from rigctl.answers.design.statement import WITHOUT_EFFECT
from rigctl.answers.errors import error_text, held_out_text
from rigctl.answers.findings.systematic_error import falls
from rigctl.answers.findings.verdict import doubt_text
from rigctl.answers.improvement import sizes_in
from rigctl.answers.numbers import MISSING, plural, probability
from rigctl.command_line import command
from rigctl.design.refusals import NothingToSet
from rigctl.design.result import NONE, DesignResult
from rigctl.errors import RigctlError
from rigctl.learning.ending import LearningEnd
from rigctl.learning.result import Learned, Round, RoundOutcome
from rigctl.model.fit.fit import FitResult
from rigctl.planning.outline import clock_time
from rigctl.runner.session import RunResult
from rigctl.units import significant

_HEADINGS = {
    LearningEnd.ADEQUATE: "Learnt",
    LearningEnd.NOT_SEPARABLE: "Not distinguishable on this bench",
    LearningEnd.OUTSIDE_LIBRARY: "Outside the library",
    LearningEnd.NOT_DECIDED: "Not decided",
    LearningEnd.BUDGET: "Out of time",
    LearningEnd.ROUNDS: "Out of rounds",
    LearningEnd.DECLINED: "Declined",
    LearningEnd.STOPPED: "Stopped",
}


def heading(learned: Learned) -> str:
    """The ending as a short heading."""
    return _HEADINGS[learned.ended]


def statement(learned: Learned) -> str:
    """Why there was no further round."""
    because = learned.because
    match because:
        case Diagnosis() if learned.ended is LearningEnd.NOT_DECIDED:
            return f"these data cannot tell whether anything is missing: {doubt_text(because)}"
        case Diagnosis() | DesignResult():
            return because.statement
        case Round():
            return _of_round(learned.ended, because)
        case RunResult():
            where = f"{because.folder.name} " if because.folder is not None else ""
            return f"the run {where}{because.status}: {because.reason}"
        case NothingToSet() if because.sensors:
            return f"{because.what}. {because.hint}"
        case RigctlError():
            return because.what
        case _:
            assert_never(because)


def _of_round(ended: LearningEnd, last: Round) -> str:
    """Why a round was the last one."""
    if ended is LearningEnd.DECLINED:
        return f"the proposal is kept in {last.procedure}"
    if ended is LearningEnd.ROUNDS:
        return f"{last.number} rounds were allowed"
    if ended is LearningEnd.BUDGET and last.judged:
        return "the budget is used up"
    if ended is LearningEnd.BUDGET:
        return f"round {last.number} failed, and the budget does not allow it again"
    return outcome(last)


def outcome(one: Round) -> str:
    """What came of a round's prediction, as it was recorded if the round was read; "" if nothing did."""
    # A round is an experiment on the design itself: its predicted gain is stated beside what the data then
    # gave. That comparison holds only if the data still point to one of the explanations it was designed for.
    predicted, achieved = one.predicted, one.achieved
    if achieved is None:
        return ""
    if achieved.recorded or predicted is None:
        return achieved.recorded
    precise = predicted.aim == "precision"
    if not achieved.kept:
        names = [name for rival in predicted.rivals for name in rival.split(" + ")]
        what = " and ".join(names) if precise else "every rival's prediction"
        named = " + ".join(one.effects) or "none of them"
        return f"the bench behaved differently from {what}: the data point to {named}"
    if precise:
        return ", ".join(
            f"{each['parameter']} is known to within ± {achieved.sizes[each['parameter']]:.3g} "
            f"{each['unit']} (95 %), expected ± {each['after']:.3g}, before ± {each['before']:.3g}"
            for each in predicted.sharpened
            if each["parameter"] in achieved.sizes
        )
    if achieved.winner not in predicted.rivals:
        return f"{achieved.winner} is named now, which the data allowed but the round was not designed for"
    return _gain_text(achieved)


def _gain_text(achieved: RoundOutcome) -> str:
    """Whether the winner is distinguished, and by how much its smallest margin increased."""
    gains, winner = achieved.gains, WITHOUT_EFFECT if achieved.winner == NONE else achieved.winner
    text = f"{winner} is {'' if achieved.distinguished else 'not '}distinguished"
    if not gains:
        return text
    rival = min(gains, key=lambda name: gains[name])
    expected = f"(expected: {achieved.expected[rival]:.3g})"
    return f"{text}: its margin over {rival} increased by {gains[rival]:.3g} {expected}"


def round_text(one: Round) -> str:
    """What came out of a round, in one line."""
    if not one.judged:
        return "proposed, and declined" if one.answer == "no" else "not carried out"
    named = f" ({' + '.join(one.effects)})" if one.effects else ""
    text = f"{one.verdict.replace('_', ' ')}{named}"
    if one.added:
        text += f", added {', '.join(name for name, _ in one.added)}"
    return text if one.achieved is None else f"{text}; {outcome(one)}"


def summary(learned: Learned) -> str:
    """One line for each round, and how it ended."""
    lines = [f"round {one.number}: {round_text(one)}" for one in learned.rounds]
    return "\n".join([*lines, statement(learned)])


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
    predictions = [f"round {one.number}: {outcome(one)}" for one in learned.rounds if one.achieved]
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
    said = statement(learned).rstrip(".")
    return Answer("good" if good else "warn", heading(learned), said, nonempty(facts))


def learned_blocks(learned: Learned, folder: Path, page: Path) -> list[Block]:
    """How it ended, what was predicted and achieved, what it cost, and the next command."""
    good = learned.ended is LearningEnd.ADEQUATE
    ended = Sentence(learned.statement, "good" if good else "warn", heading(learned), main=True)
    compared = [one for one in learned.rounds if one.predicted and one.predicted.aim != "precision"]
    # Rounds that distinguish rivals are rows of a table; those for precision have no rival, and get a line
    # each.
    lines = [
        f"round {one.number}: {outcome(one)}"
        for one in learned.rounds
        if one.achieved and one not in compared
    ]
    lines += [
        f"added {', '.join(learned.added) or 'nothing'}; {learned.model} is at version {learned.version}",
        f"{clock_time(learned.spent)} of bench time; the page: {page.as_posix()}",
    ]
    if learned.sensor:
        lines.append(f"with {' and '.join(learned.sensor)} measured too, they would be distinguished")
    return [ended, _comparison(compared), Points.of("", lines), *_next(learned, folder)]


def round_blocks(one: Round) -> list[Block]:
    """A judged round."""
    judged = Sentence(round_text(one), head=f"Round {one.number}", main=True)
    return [judged, Points.of("", [one.statement] if one.statement else [])]


def _comparison(rounds: Sequence[Round]) -> Table:
    columns = (
        Column("round", "round"),
        Column("predicted", "D predicted"),
        Column("achieved", "D achieved"),
        Column("probability", "P predicted"),
        Column("distinguished", "distinguished", words=True),
    )
    rows = []
    for one in rounds:
        if one.predicted is None or one.achieved is None:
            continue
        gained = min(one.achieved.gains.values(), default=None)
        expected = min(one.achieved.expected.values(), default=one.predicted.separation)
        rows.append(
            {
                "round": one.number,
                "predicted": significant(expected, 3),
                "achieved": MISSING if gained is None else significant(gained, 3),
                "probability": probability(one.predicted.probability),
                "distinguished": "yes" if one.achieved.distinguished else "no",
            }
        )
    return Table(columns, tuple(rows))


def _next(learned: Learned, folder: Path) -> list[Block]:
    """The command that goes on from the ending."""
    runs = [one.run for one in learned.rounds if one.run]
    resume = "rigctl learn --resume"
    if learned.ended is LearningEnd.OUTSIDE_LIBRARY and runs:
        discover = command(["discover", *runs, "--model", learned.model])
        return [Next(discover, "looks for a formula where no effect of the library fits")]
    after = {
        LearningEnd.BUDGET: Next(f"{resume} --budget 1h", "continues with more bench time"),
        LearningEnd.ROUNDS: Next(f"{resume} --max-rounds 10", "continues with more rounds"),
        LearningEnd.DECLINED: Next(resume, f"asks again; the proposal is kept in {folder.as_posix()}"),
        LearningEnd.STOPPED: Next(resume, "continues the run that did not finish"),
    }
    return [after[learned.ended]] if learned.ended in after else []


def round_row(one: Round) -> dict[str, object]:
    """A round as a row of the page's table."""
    return {
        "number": one.number,
        "run": one.run or ("declined" if one.answer == "no" else "not measured"),
        "measured": "; ".join(one.predicted.records) if one.predicted else "the procedure",
        "duration": clock_time(one.duration) if one.duration else MISSING,
        "verdict": _plain(one.verdict) or MISSING,
        "classes": [", ".join(map(_plain, names)) for names in one.classes],
        "added": ", ".join(f"{_plain(name)} (version {version})" for name, version in one.added),
        "chi2": one.chi2,
        "statement": one.statement,
        "achieved": outcome(one),
    }


def gain_bars(learned: Learned) -> list[Block]:
    """The predicted growth of the winner's margin in each designed round, beside the achieved one."""
    shown: list[Bar] = []
    largest = 1.0
    for predicted, achieved in learned.predictions:
        sizes = [*achieved.gains.values(), *achieved.expected.values(), predicted.separation]
        largest = max(largest, *map(abs, sizes))
    for one in learned.rounds:
        if one.predicted is None or one.achieved is None:
            continue
        label = f"round {one.number}, P {probability(one.predicted.probability)}"
        for rival, gain in one.achieved.gains.items():
            expected = one.achieved.expected[rival]
            against = f"{_plain(one.achieved.winner)} over {_plain(rival)}"
            shown.append(Bar(label, expected / largest, significant(expected, 3), f"predicted: {against}", 7))
            shown.append(Bar("achieved", max(gain, 0.0) / largest, significant(gain, 3), "", 0))
    title = "Growth of the log-likelihood ratio 2·ln L: predicted and achieved"
    return [Bars(title, tuple(shown))]


def _plain(name: str) -> str:
    return name.replace("_", " ")
