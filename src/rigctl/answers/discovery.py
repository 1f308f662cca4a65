"""The search for a formula in words: where a term is missing, its curve, and the formulas for it.

In: a `Discovery`. Out: an `Answer` and its evidence. There are three kinds of result, in this order: no
search was made, and why; no term is significant; a term is, with the formulas that remain. A formula that
does not predict held-out conditions is shown, but marked as not accepted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rigctl.analysis.agreement.replicates import ReplicateTest
from rigctl.analysis.decision_levels import ALPHA, STAND_IN
from rigctl.answers.blocks import (
    Answer,
    Block,
    Column,
    Figure,
    Point,
    Points,
    Sentence,
    Sparkline,
    Table,
    counted,
)
from rigctl.answers.findings.verdict import doubt_text as doubtful
from rigctl.answers.notes import all_notes
from rigctl.discovery.curve import Curve
from rigctl.discovery.dimensions import Tier
from rigctl.discovery.gate import Gate
from rigctl.discovery.locate import Map
from rigctl.discovery.result import Discovery, FoundFormula, Where
from rigctl.model.measured.note import Note as MeasuredNote
from rigctl.model.measured.note import as_notes
from rigctl.units import show, significant
from rigctl.wording import chance, chance_text, share_text, strength

#: places that are listed, and formulas that the answer names
_PLACES, _FORMULAS = 6, 3
#: number of other locations that are named
_RIVALS = 5


def discovery_answer(discovery: Discovery) -> Answer:
    """The statement, the location, the size, and each formula in a line."""
    # A search is made only where the library has no answer. A closed gate is therefore an answer of its own,
    # with what to do instead.
    gate = discovery.gate
    files = [f"written to {one.file.as_posix()}" for one in discovery.formulas if one.file is not None]
    more = (
        *counted(len(discovery.located[:_PLACES]), "location"),
        *counted(len(discovery.curves[:1]), "curve"),
        *counted(len(discovery.formulas), "formula"),
        *counted(len(notes(discovery)), "note"),
    )
    return Answer(
        "good" if gate.reason == "adequate" else "warn",
        gate_head(gate) or "Discovery",
        statement(discovery) if gate.open else gate_sentence(gate),
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
        return [*all_notes(notes(discovery))]
    tested = (
        f"{searched.tests} terms were tested, equivalent to {searched.independent:.0f} independent tests; "
        f"{discovery.tried} formulas were tried"
    )
    return [
        *all_notes(notes(discovery)),
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
    return [
        Figure(f"curve-{number + 1}", caption, curve=Sparkline(tuple(curve.value.tolist()))),
        Table(columns, rows),
    ]


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
    yield Point(f"tier {one.tier.letter}: {tier_statement(one.tier)}")
    if one.passive:
        yield Point(f"it {one.passive}")
    if one.doubt:
        yield Point(f"not accepted: {doubt_text(one)}", "!")
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


_NO_SEARCH = "No search was made"
_HEADS: dict[str, str] = {
    "outside_library": "",
    "adequate": "There is nothing to discover",
    "doubt": f"{_NO_SEARCH}, because these data cannot tell whether anything is missing",
    "library_and_rest": f"{_NO_SEARCH} yet",
    "certain_besides": f"{_NO_SEARCH} yet",
}


def gate_head(gate: Gate) -> str:
    """A few words before the reason why no search was made; "" if one was."""
    return _HEADS.get(gate.cause, _NO_SEARCH)


def gate_sentence(gate: Gate) -> str:
    """Why a search is worthwhile, or why it is not."""
    diagnosis = gate.diagnosis
    match gate.cause:
        case "outside_library":
            return (
                "Something is missing, and no effect of the library explains it with certainty, in any shape "
                "of its law"
            )
        case "adequate" | "sensor":
            return diagnosis.statement
        case "below_noise":
            return diagnosis.before.statement
        case "doubt":
            return doubtful(diagnosis)
        case "replicates":
            return _irreproducible(gate.replicates)
    return _in_library(gate)


def _in_library(gate: Gate) -> str:
    """What to do where the library has the answer, or a part of it."""
    diagnosis, names = gate.diagnosis, " and ".join(gate.diagnosis.effects)
    if gate.cause == "certain_besides":
        first = diagnosis.certain_besides[0]
        return (
            f"{first} is missing with certainty (except for its law), and so is something else: add "
            f"{first} ('rigctl model add'), then search for the rest"
        )
    if gate.cause == "indistinguishable":
        others = sorted({name for group in diagnosis.classes for name in group} - set(diagnosis.effects))
        which = f" (or {', '.join(others)})" if others else ""
        return (
            f"{names}{which} of the library would explain it, and these data do not show which of these it "
            "is: 'rigctl diagnose' says what would distinguish them"
        )
    if gate.cause == "library_and_rest":
        return (
            f"{names} is certainly missing, but that is not all: add it ('rigctl diagnose … --apply'), then "
            "search for the rest"
        )
    return f"the library contains it, {names}: 'rigctl diagnose … --apply' adds it"


def _irreproducible(tested: ReplicateTest | None) -> str:
    assert tested is not None  # noqa: S101 - this test has closed the gate
    return (
        "differences between records of one condition account for "
        f"{100 * tested.share:.0f} % of what the model leaves ({chance_text(tested.p_value)}): something "
        "changes from record to record that no variable of the model describes. Find out what, or record it"
    )


def gate_statement(gate: Gate) -> str:
    """Head and sentence."""
    head, sentence = gate_head(gate), gate_sentence(gate)
    return f"{head}: {sentence}" if head else sentence


def statement(discovery: Discovery) -> str:
    """The result in words."""
    searched = discovery.searched
    if searched is None:
        return gate_statement(discovery.gate)
    return _found(discovery) if searched.sure else too_weak(searched)


def notes(discovery: Discovery) -> tuple[MeasuredNote, ...]:
    """Remarks on the data and the search."""
    return (*discovery.diagnosis.notes, *as_notes(_of_search(discovery)))


def _of_search(discovery: Discovery) -> Iterator[str]:
    """What limits a search that was made."""
    searched = discovery.searched
    if searched is None:
        return
    if len(set(discovery.diagnosis.before.linearisation.regions.groups)) < 2:
        yield (
            "All records are at one condition: the result holds there, and has not been tested at any other. "
            "Record at a second one"
        )
    if searched.hidden:
        names = ", ".join(one.name for one in searched.hidden[:4])
        more = f" and {len(searched.hidden) - 4} more" if len(searched.hidden) > 4 else ""
        yield (
            f"Not testable with these data: {names}{more}: a term there is equivalent to "
            "record-level variation or to a change of the fitted parameters"
        )


def tier_statement(tier: Tier) -> str:
    """The strength of a formula's claim."""
    if tier.letter == "A":
        size = f"{tier.coefficient:.3g} times {tier.group}" if tier.group else ""
        more = "".join(f", scale {value:.3g} times {group}" for value, group in tier.scales)
        size = size or f"the pure number {tier.coefficient:.3g}"
        return f"no dimensional constant of its own: {size}{more}"
    missing = "its size" if tier.lacking == "size" else "a scale of it"
    return f"the weaker claim: {missing} has a dimension that no group of the model's parameters has"


_DOUBTS = {
    "one_record": "there is no second record to test it on",
    "not_determined": "it is not determined without the records that could be left out",
    "not_predicted": "it does not predict the conditions left out",
}


def doubt_text(one: FoundFormula) -> str:
    """Why a formula is not accepted."""
    if one.doubt == "resembles":
        return f"it leaves {share_text(one.left)} of the misfit, and only resembles what is missing"
    return _DOUBTS[one.doubt] if one.doubt else ""


def too_weak(searched: Map) -> str:
    """That no term is certain, and how many records would be needed."""
    if not searched.located:
        return "Something is missing, but a term would not be visible in these data at any location"
    best = searched.located[0]
    if best.size > searched.needed:
        return (
            f"Not certain enough to discover: the best of {searched.tests} terms tested, {best.name}, is "
            f"{strength(best.size)}, but its residuals vary so much from record to record that "
            f"chance alone may explain it ({chance_text(best.p_value)}); record more conditions"
        )
    # The size of a term in σ grows with √n of independent records, so that the records needed grow with the
    # square of what is lacking.
    factor = max((searched.needed / best.size) ** 2 if best.size else math.inf, 1.1)
    more = f", or about {factor:.2g} times as many records like these" if factor < 100.0 else ""
    return (
        f"Too weak to discover: the best of {searched.tests} terms tested, {best.name}, is "
        f"{strength(best.size)} ({chance_text(best.p_value)}); {searched.needed:.1f} are needed{more}"
    )


def _found(discovery: Discovery) -> str:
    """Where a term is missing, and the formulas that remain."""
    where = f"A term is missing{_where(discovery.where)}"
    if not discovery.formulas:
        return (
            f"{where}; none of the {discovery.tried} formulas tried explains enough for its parameters, so "
            "the curve is all that these data show"
        )
    first, count = discovery.formulas[0], len(discovery.formulas)
    remain = "one remains" if count == 1 else f"{count} remain that these data do not distinguish, first"
    text = f"{where}; of {discovery.tried} formulas {remain}: {first.term}"
    if len({one.slot for one in discovery.where}) > 1:
        text += f" at {first.slot}"
    if first.alike:
        text += f" ({len(first.alike)} more are equivalent in these data)"
    # The nearest formula may still be a bad one: with so much left it is not named as what is missing,
    # whatever its rank.
    if first.left > STAND_IN:
        over = " and ".join(row[0] for row in first.valid)
        return (
            f"Something is missing that no formula describes: the nearest of {discovery.tried} acts at "
            f"{first.slot} over {over} and leaves {share_text(first.left)} of the misfit. What is missing "
            "may depend on time or on something that is not recorded, or act at several locations"
        )
    if first.doubt:
        text += f". {doubt_text(first).capitalize()}, and it should not be relied on"
    if first.p_value_after < ALPHA:
        text += ". The model with it still does not agree with the data: something else is missing"
    return text


def _where(where: Sequence[Where]) -> str:
    """The slot and the variables if they are certain; else the alternatives that these data do not
    distinguish."""
    slots = list(dict.fromkeys(one.slot for one in where))
    drivers = list(dict.fromkeys(" and ".join(one.over) for one in where))
    if len(slots) > 1 and len(drivers) > 1:
        return f", its location and variable uncertain ({_or([str(one) for one in where])})"
    at = f" at {slots[0]}" if len(slots) == 1 else f", its location uncertain ({_or(slots)}),"
    over = f" over {drivers[0]}" if len(drivers) == 1 else f", its variable uncertain ({_or(drivers)})"
    return at + over


def _or(names: Sequence[str]) -> str:
    """Some of several names, and the number of the rest."""
    shown, more = names[: _RIVALS + 1], len(names) - _RIVALS - 1
    return f"{', '.join(shown)} or {more} more" if more > 0 else " or ".join(shown)
