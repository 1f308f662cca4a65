"""The search for a formula in words: where a term is missing, its curve, and the formulas for it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rigctl.answers.blocks import Answer, Block, Column, Figure, Point, Points, Sentence, Table, counted
from rigctl.answers.notes import all_notes
from rigctl.discovery.curve import Curve
from rigctl.discovery.result import Discovery, FoundFormula
from rigctl.units import show, significant
from rigctl.wording import chance, chance_text, strength

#: places that are listed, and formulas that the answer names
_PLACES, _FORMULAS = 6, 3


def discovery_answer(discovery: Discovery) -> Answer:
    """The statement, the location, the size, and each formula in a line."""
    gate = discovery.gate
    files = [f"written to {one.file.as_posix()}" for one in discovery.formulas if one.file is not None]
    more = (
        *counted(len(discovery.located[:_PLACES]), "location"),
        *counted(len(discovery.curves[:1]), "curve"),
        *counted(len(discovery.formulas), "formula"),
        *counted(len(discovery.notes), "note"),
    )
    return Answer(
        "good" if gate.reason == "adequate" else "warn",
        gate.head or "Discovery",
        discovery.statement if gate.open else gate.sentence,
        tuple(_facts(discovery)),
        remarks=(Points.of("", files),) if files else (),
        more=more,
    )


def _facts(discovery: Discovery) -> Iterator[tuple[str, str]]:
    """The share of the misfit that a term at the best location explains, and each formula with its check."""
    if discovery.located:
        best = discovery.located[0]
        yield "misfit", f"{100 * best.share:.0f} % of it, {strength(best.size)} ({chance_text(best.p_value)})"
    for one in discovery.formulas[:_FORMULAS]:
        held_out = f", error held out {_held_out(one)}" if _held_out(one) else ""
        accepted = "accepted" if one.accepted else "not accepted"
        sizes = ", ".join(f"{name} {value}" for name, value in one.parameters.items())
        yield "formula", f"{written(one)}: {sizes}{held_out}; {accepted}"


def discovery_evidence(discovery: Discovery) -> list[Block]:
    """The locations, the curve with its band, and each formula."""
    searched = discovery.searched
    if searched is None:
        return [*all_notes(discovery.notes)]
    tested = (
        f"{searched.tests} terms were tested, equivalent to {searched.independent:.0f} independent tests; "
        f"{discovery.tried} formulas were tried"
    )
    return [
        *all_notes(discovery.notes),
        *([_places(discovery)] if discovery.located else []),
        Sentence(tested),
        *(block for number, one in enumerate(discovery.curves) for block in _curve(one, number)),
        *([_formulas(discovery)] if discovery.formulas else []),
        *(Points(one.name, tuple(_formula(one)), code=written(one)) for one in discovery.formulas),
    ]


def _places(discovery: Discovery) -> Table:
    columns = (
        Column("slot", "a term at"),
        Column("over", "over", words=True),
        Column("share", "misfit", lambda share: f"{100 * share:.0f} %", full=1.0),
        Column("size", "sigma", "{:.1f}".format),
        Column("p", "family-wise p", chance),
        Column("alike", "equivalent at", words=True),
    )
    rows = tuple(
        {
            "slot": one.slot.name,
            "over": " and ".join(driver.name for driver in one.over),
            "share": one.share,
            "size": one.size,
            "p": one.p_value,
            "alike": ", ".join(one.alike),
        }
        for one in discovery.located[:_PLACES]
    )
    return Table(columns, rows)


def _curve(curve: Curve, number: int) -> list[Block]:
    """The term over its variable, with its band at some points."""
    unit = curve.slot.unit
    columns = (
        Column("at", curve.over),
        Column("term", "term"),
        Column("band", "95 % band"),
    )
    rows = tuple(
        {
            "at": show(float(curve.x[index]), curve.shown),
            "term": show(float(curve.value[index]), unit, difference=True),
            "band": " to ".join(
                show(float(end[index]), unit, difference=True) for end in (curve.low, curve.high)
            ),
        }
        for index in range(0, curve.x.size, (curve.x.size - 1) // 4)
    )
    absorbed = (
        ", apart from a component that the fitted parameters absorb: these data do not determine its size"
        if curve.free
        else ""
    )
    times = f" (times {curve.times})" if curve.times else ""
    caption = f"the term at {curve.slot.name} over {curve.over}{times}{absorbed}"
    return [Figure(f"curve-{number + 1}", caption, curve=tuple(curve.value.tolist())), Table(columns, rows)]


def _formulas(discovery: Discovery) -> Table:
    columns = (
        Column("name", "formula"),
        Column("delta", "Δ", "{:.1f}".format),
        Column("tier", "tier", words=True),
        Column("held_out", "held out", words=True),
        Column("accepted", "accepted", words=True),
        Column("parameters", "parameters", words=True),
    )
    rows = tuple(
        {
            "name": one.name,
            "delta": one.delta,
            "tier": one.tier.letter,
            "held_out": _held_out(one),
            "accepted": "yes" if one.accepted else "no",
            "parameters": ", ".join(f"{name} {value}" for name, value in one.parameters.items()),
        }
        for one in discovery.formulas
    )
    return Table(columns, rows)


def _formula(one: FoundFormula) -> Iterator[Point]:
    yield Point(f"tier {one.tier.letter}: {one.tier.statement}")
    if one.passive:
        yield Point(f"it {one.passive}")
    if one.doubt:
        yield Point(f"not accepted: {one.doubt}", "!")
    yield Point(f"fitted over {one.valid_text}; not tested outside this range")
    if one.alike:
        yield Point(f"equivalent in these data: {', '.join(one.alike)}")


def _held_out(one: FoundFormula) -> str:
    check = one.check
    if check is None or not math.isfinite(check.before):
        return ""
    return f"{significant(check.before)} to {significant(check.after)}"


def written(one: FoundFormula) -> str:
    """The slot with the formula: ``friction + size*…``; ``orifice*(1 + size*…)`` where terms are factors."""
    if one.fitted.formula.slot.combine == "product":
        return f"{one.slot}*({one.term})"
    return f"{one.slot} + {one.term}"
