"""A designed experiment in words: the records, what they distinguish, and the rivals.

In: a `DesignResult`. Out: the answer, the tables of its evidence, and the page. Every probability is a
prediction under one rival, assumed to be right, so that a table has a row for each pair and direction.
"""

from __future__ import annotations

from functools import partial

from rigctl.analysis.decision_levels import ODDS
from rigctl.answers.blocks import (
    Answer,
    Bar,
    Bars,
    Block,
    Column,
    Figure,
    Note,
    Points,
    Sentence,
    Table,
    Tone,
    counted,
    nonempty,
)
from rigctl.answers.design.statement import (
    added,
    explanations_in_words,
    notes,
    settings,
    statement,
    title,
)
from rigctl.answers.numbers import probability
from rigctl.design.result import HALF, DesignResult, LargestDifference, ProposedRecord, SensorSet
from rigctl.planning.outline import clock_time
from rigctl.units import significant
from rigctl.wording import listed

#: how to read the tables
_READING = (
    "the weight of a rival is its probability among these, each fitted to all data so far; D: the expected "
    "log-likelihood ratio 2·ln L from the records, with the rival refitted, ± its standard deviation over "
    "the present uncertainty; P: the probability that a diagnosis distinguishes the two"
)
_two, _three = partial(significant, digits=2), partial(significant, digits=3)


def tone_of(result: DesignResult) -> Tone:
    """Whether the records answer the question."""
    return "good" if result.separable or (result.aim == "precision" and result.records) else "warn"


def design_answer(result: DesignResult) -> Answer:
    """The explanations that are left, the records, and what they hardly distinguish."""
    facts = [
        ("either" if not number else "or", text) for number, text in enumerate(explanations_in_words(result))
    ]
    if result.excluded:
        facts.append(("excluded", f"{listed(result.excluded)}, with odds of more than {ODDS} to 1"))
    facts += [(f"record {number}", in_words(one)) for number, one in enumerate(result.records, start=1)]
    probable = {one.name for one in result.rivals if one.weight > 1.0 / ODDS}
    # A pair is named as hardly distinguished only if the one assumed true is probable at all: a pair of
    # improbable rivals is of no interest, however alike the two are.
    alike = {
        frozenset((one.truth, one.rival)): f"{one.truth} and {one.rival}"
        for one in result.outlooks
        if one.after < HALF and one.truth in probable
    }
    if result.separable and alike:
        facts.append(("hardly", f"distinguished if one of them is right: {', '.join(alike.values())}"))
    more = (
        *(["the predicted power for each pair"] if result.outlooks else []),
        *counted(
            len(result.sharpened),
            "parameter that becomes more certain",
            "parameters that become more certain",
        ),
        *counted(len(result.sensors), "set of sensors", "sets of sensors"),
    )
    return Answer(tone_of(result), title(result), statement(result), nonempty(facts), more=more)


def in_words(one: ProposedRecord) -> str:
    """The settings, the steps, the duration, and where the rivals differ most."""
    text = f"{settings(one)}: {'; '.join(one.steps)}" if one.settings else "; ".join(one.steps)
    if one.duration:
        text += f"; {clock_time(one.duration)} of bench time"
    return text if one.widest is None else f"{text}. {_widest_text(one.widest)}"


def _widest_text(one: LargestDifference) -> str:
    differ = f"{one.first} and {one.second} differ most in {one.channel}"
    return f"{differ}, by up to {one.sigmas:.1f} times its noise"


def whole_design(result: DesignResult) -> list[Block]:
    """The statement, the rivals, the predictions for each pair, the records and the sensors."""
    steps = [
        f"{number}: {text}"
        for number, one in enumerate(result.records, start=1)
        for text in ("; ".join(one.steps), *([] if one.widest is None else [_widest_text(one.widest)]))
    ]
    return [
        Sentence(statement(result), tone_of(result), title(result), main=True),
        *rival_tables(result),
        *([_records(result)] if result.records else []),
        *([Points.of("", steps)] if steps else []),
        *sensor_tables(result),
        *map(Note, notes(result)),
    ]


def design_page(result: DesignResult) -> list[Block]:
    """The statement, the rivals, why each record is taken, with what each rival predicts, and the sensors."""
    whys = [f"{in_words(one)}. {added(result, one)}" for one in result.records]
    return [
        Sentence(statement(result), tone_of(result), title(result)),
        *_chances(result),
        Note(_READING),
        *rival_tables(result),
        *([Points.of("records", whys)] if whys else []),
        *(
            Figure(f"next-{number}", record_caption(one, number))
            for number, one in enumerate(result.records, start=1)
        ),
        *sensor_tables(result),
        Figure("sensors", "what the sensors distinguish, over their price"),
        *map(Note, notes(result)),
    ]


def record_caption(one: ProposedRecord, number: int) -> str:
    """What the figure of a record shows."""
    at = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in one.settings.items())
    return f"Record {number}{at and f', at {at}'}: what each rival predicts"


def _chances(result: DesignResult) -> list[Block]:
    """The probability so far, and after each record."""
    if result.aim == "precision" or not result.records:
        return []
    shown = [Bar("now", result.before, probability(result.before), "", 7)]
    shown += [
        Bar(f"with record {number}", one.after, probability(one.after))
        for number, one in enumerate(result.records, start=1)
    ]
    return [Bars("Probability that a diagnosis names the right rival alone", tuple(shown))]


def rival_tables(result: DesignResult) -> list[Block]:
    """The rivals with their weights, the predictions for each pair, and what becomes more certain."""
    blocks: list[Block] = [_rivals(result)]
    if result.outlooks:
        blocks.append(_outlooks(result))
    if result.sharpened:
        blocks.append(_sharpened(result))
    return blocks


def _rivals(result: DesignResult) -> Table:
    columns = (
        Column("rival", "rival"),
        Column("weight", "weight", lambda weight: f"{100.0 * weight:.1f} %", full=1.0),
        Column("chi2", "chi²/dof", "{:.3f}".format),
        Column("parameters", "parameters", words=True),
    )
    rows = tuple(
        {
            "rival": one.name,
            "weight": one.weight,
            "chi2": one.chi2_reduced,
            "parameters": ", ".join(
                f"{name.partition('.')[2]} {value}" for name, value in one.parameters.items()
            ),
        }
        for one in result.rivals
    )
    return Table(columns, rows)


def _outlooks(result: DesignResult) -> Table:
    columns = (
        Column("truth", "if this is right"),
        Column("rival", "rival", words=True),
        Column("margin", "margin so far", "{:+.1f}".format),
        Column("separation", "D", _three),
        Column("spread", "±", _two),
        Column("before", "P now", probability),
        Column("after", "P after", probability),
    )
    return Table(columns, tuple(map(vars, result.outlooks)))


def _sharpened(result: DesignResult) -> Table:
    columns = (
        Column("name", "parameter"),
        Column("before", "± now (95 %)", _three),
        Column("after", "± after (95 %)", _three),
        Column("unit", "unit", words=True, unit=True),
    )
    return Table(columns, tuple(map(vars, result.sharpened)))


def _records(result: DesignResult) -> Table:
    precise = result.aim == "precision"
    columns = (
        Column("record", "record"),
        Column("at", "at", words=True),
        Column("separation", "ln ratio" if precise else "D", _three),
        Column("of_repeat", "of a repeat", _two),
        Column("before", "P before", probability),
        Column("after", "P after", probability),
        Column("duration", "bench time", clock_time),
    )
    rows = tuple(
        {
            "record": number,
            "at": settings(one),
            "separation": one.separation,
            "of_repeat": one.of_repeat,
            "before": None if precise else one.before,
            "after": None if precise else one.after,
            "duration": one.duration or None,
        }
        for number, one in enumerate(result.records, start=1)
    )
    return Table(columns, rows)


def sensor_tables(result: DesignResult) -> list[Block]:
    """The sensors that the bench could have, and what they would distinguish."""
    columns = (
        Column("sensors", "sensors"),
        Column("price", "price"),
        Column("pairs", "pairs"),
        Column("separation", "D", _three),
        Column("probability", "P", probability),
    )
    rows = tuple(
        {
            "sensors": " and ".join(one.channels),
            "price": price_text(one),
            "pairs": f"{one.distinguished} of {one.of}",
            "separation": one.separation,
            "probability": one.probability,
        }
        for one in result.sensors
    )
    return [Table(columns, rows, "sensors that the bench could have")] if rows else []


def price_text(one: SensorSet) -> str:
    """The price of a set of sensors, as stated in the rig file."""
    return "–" if one.price is None else f"{one.price:g} {one.currency}".strip()
