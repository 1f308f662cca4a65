"""The section on a search for a formula: the location in the machine, the curve with its band, the
formulas."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from rigctl.answers.blocks import Figure, Note, Sentence
from rigctl.answers.discovery import discovery_answer, discovery_evidence
from rigctl.answers.numbers import symbol
from rigctl.discovery.curve import Curve
from rigctl.discovery.result import Discovery, FoundFormula
from rigctl.physics.family import ModelFamily, Slot
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

#: a signal's way through a bench, from left to right
_KINDS = (("command", "commands"), ("process", "the machine"), ("sensor", "readings"))
#: size of the drawing, px
_BOX, _GAP, _WIDTH, _HEAD = 20, 4, 250, 22
_SLOTS = "the filled part is the share of the misfit that a smooth term there would explain"
_READING = (
    "Δ: by how much the criterion of a formula is above that of the best. Held out: the error on conditions "
    "left out, in units of the noise, without it and with it. Tier A needs no dimensional constant of its "
    "own; tier B does, and is the weaker claim. Where the band of a curve is wide, the data do not determine "
    "it, or the fit absorbs it"
)
#: formulas that are drawn over the curve
_DRAWN = 4


def discovery_sections(discovery: Discovery) -> list[Section]:
    """The gate, the slots of the family, the curves, and the set of formulas."""
    plots = [_curve_plot(k, curve, discovery.formulas) for k, curve in enumerate(discovery.curves)]
    family = discovery.diagnosis.before.fit.problem.model.family
    shares: dict[str, float] = {}
    for one in discovery.located:
        for name in (one.slot.name, *one.alike):
            shares[name] = max(shares.get(name, 0.0), one.share)
    answer = discovery_answer(discovery)
    drawn = {plot.id: plot_slot(plot) for plot in plots}
    places = [Figure("slots", "where in the machine", _SLOTS)] if discovery.located else []
    if places:
        drawn["slots"] = _slots(family, shares)
    tables = [Note(_READING)] if discovery.formulas else []
    head = Sentence(answer.sentence, answer.tone, answer.title)
    body = page_blocks([head, *places, *discovery_evidence(discovery), *tables], drawn)
    return [Section("discovery", "A formula for what is missing", body, tuple(plots))]


def _curve_plot(number: int, curve: Curve, formulas: tuple[FoundFormula, ...]) -> Plot:
    unit, shown = curve.slot.unit, parse_unit(curve.shown)
    x = (curve.x - shown.offset) / shown.factor
    traces = [
        Trace("the term", x, curve.value, Look.LINE, 0, unit),
        Trace("95 % band", x, curve.low, Look.LINE, 0, unit, faint=True),
        Trace("95 % band, upper end", x, curve.high, Look.LINE, 0, unit, faint=True, in_legend=False),
    ]
    for colour, one in enumerate(formulas[:_DRAWN], start=1):
        (factor, *others) = one.fitted.formula.factors
        same = (one.slot, factor.argument.driver.name) == (curve.slot.name, curve.over)
        if not same or bool(others) != bool(curve.times):
            continue
        values = np.asarray(one.fitted.formula.size * factor.of(curve.x))
        traces.append(Trace(plain_name(one.name), x, values, Look.LINE, colour, unit))
    return Plot(
        f"curve-{number + 1}",
        f"The term at {plain_name(curve.slot.name)} over {plain_name(curve.over)}"
        + (f", times {curve.times}" if curve.times else "")
        + ", over the range of the data"
        + (", apart from a component that the fitted parameters absorb" if curve.free else ""),
        f"{plain_name(curve.over)} [{symbol(curve.shown)}]",
        (Panel(f"{plain_name(curve.slot.name)} [{symbol(unit)}]", tuple(traces), 2.0),),
    )


def _slots(family: ModelFamily, shares: dict[str, float]) -> Markup:
    """The equations as boxes, filled by the share of the misfit that a term there explains."""
    columns = [(heading, [slot for slot in family.slots if slot.kind == kind]) for kind, heading in _KINDS]
    columns = [(heading, slots) for heading, slots in columns if slots]
    boxes = [
        {
            "x": column * (_WIDTH + 3 * _GAP),
            "y": _HEAD + row * (_BOX + _GAP),
            "name": plain_name(slot.name),
            "meaning": slot.meaning,
            "share": _share(slot, shares),
        }
        for column, (_, slots) in enumerate(columns)
        for row, slot in enumerate(slots)
    ]
    rows = max(len(slots) for _, slots in columns)
    return render(
        "slots.html",
        boxes=boxes,
        headings=[(column * (_WIDTH + 3 * _GAP), heading) for column, (heading, _) in enumerate(columns)],
        box=_BOX,
        width=_WIDTH,
        whole=len(columns) * (_WIDTH + 3 * _GAP),
        height=_HEAD + rows * (_BOX + _GAP),
    )


def _share(slot: Slot, shares: dict[str, float]) -> float:
    return shares.get(slot.name, 0.0)
