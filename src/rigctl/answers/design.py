"""A designed experiment in words: the records, what they distinguish, and the rivals."""

from __future__ import annotations

from functools import partial

from rigctl.analysis.decision_levels import ODDS
from rigctl.answers.blocks import (
    Answer,
    Block,
    Column,
    Note,
    Points,
    Sentence,
    Table,
    Tone,
    counted,
    nonempty,
)
from rigctl.design.result import DesignResult, ProposedRecord, SensorSet
from rigctl.design.text import explanations_in_words, share, title
from rigctl.planning.outline import clock_time
from rigctl.units import significant

#: a probability from which two count as distinguished
_LIKELY = 0.5
_two, _three = partial(significant, digits=2), partial(significant, digits=3)


def tone_of(result: DesignResult) -> Tone:
    """Whether the records answer the question."""
    return "good" if result.separable or (result.aim == "precision" and result.records) else "warn"


def design_answer(result: DesignResult) -> Answer:
    """The explanations that are left, the records, and what they hardly distinguish."""
    facts = [
        ("either" if not number else "or", text) for number, text in enumerate(explanations_in_words(result))
    ]
    facts += [(f"record {number}", in_words(one)) for number, one in enumerate(result.records, start=1)]
    probable = {one.name for one in result.rivals if one.weight > 1.0 / ODDS}
    alike = {
        frozenset((one.truth, one.rival)): f"{one.truth} and {one.rival}"
        for one in result.outlooks
        if one.after < _LIKELY and one.truth in probable
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
    return Answer(tone_of(result), title(result), result.statement, nonempty(facts), more=more)


def in_words(one: ProposedRecord) -> str:
    """The settings, the steps, the duration, and where the rivals differ most."""
    settings = ", ".join(f"{name} {value}" for name, value in one.settings.items())
    text = f"{settings}: {'; '.join(one.steps)}" if settings else "; ".join(one.steps)
    if one.duration:
        text += f"; {clock_time(one.duration)} of bench time"
    return text if one.widest is None else f"{text}. {one.widest.statement}"


def whole_design(result: DesignResult) -> list[Block]:
    """The statement, the rivals, the predictions for each pair, the records and the sensors."""
    steps = [
        f"{number}: {text}"
        for number, one in enumerate(result.records, start=1)
        for text in ("; ".join(one.steps), *([] if one.widest is None else [one.widest.statement]))
    ]
    return [
        Sentence(result.statement, tone_of(result), title(result), main=True),
        *rival_tables(result),
        *([_records(result)] if result.records else []),
        *([Points.of("", steps)] if steps else []),
        *sensor_tables(result),
        *map(Note, result.notes),
    ]


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
        Column("before", "P now", share),
        Column("after", "P after", share),
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
        Column("before", "P before", share),
        Column("after", "P after", share),
        Column("duration", "bench time", clock_time),
    )
    rows = tuple(
        {
            "record": number,
            "at": ", ".join(f"{name} {value}" for name, value in one.settings.items()),
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
        Column("probability", "P", share),
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
