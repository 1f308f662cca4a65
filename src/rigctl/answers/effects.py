"""The library of effects, one effect with its signature, and the trial of a user's own.

In: effects and families as declared, and what a simulation of the standard record has shown of one. Out:
blocks for a terminal or a page. Bounds that are merely usual are in brackets, since a diagnosis also
searches beyond those, and never beyond physical ones.

A signature is a small curve of the change of each reading, on an axis that holds zero: whether an effect
raises a reading or lowers it, and when, is what tells it from others. With a rig its size is given in
noises of the channel, which says whether that bench could see it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from rigctl.answers.blocks import Block, Column, Figure, Point, Points, Sentence, Sparkline, Table
from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.equations import term_texts
from rigctl.effects.measured_curve import MeasuredCurve
from rigctl.model.effect_preview import Trial
from rigctl.model.signature import Signature
from rigctl.model.signature_document import changes, shown_change
from rigctl.rig.rig import Rig
from rigctl.units import show, significant

#: number of similar effects that are named
_FEW = 3
#: lines and characters of a signature's curve, and the share of its axis below which an end is rounding
_LINES, _WIDTH, _FLAT = 4, 60, 1e-3
_five = partial(significant, digits=5)
_words = partial(Column, words=True)


def library_tables(effects: Sequence[Effect]) -> list[Block]:
    """A table of effects for each family."""
    columns = (
        _words("name", "effect"),
        _words("kind", "kind"),
        _words("where", "acts at"),
        _words("parameters", "parameters"),
        _words("summary", ""),
    )
    rows: dict[str, list[Mapping[str, Any]]] = {}
    for effect in effects:
        rows.setdefault(effect.family, []).append(
            {
                "name": effect.name,
                "kind": effect.kind,
                "where": "base physics" if effect.base else ", ".join(effect.slots),
                "parameters": ", ".join(parameter.name for parameter in effect.parameters),
                "summary": effect.summary,
            }
        )
    return [Table(columns, tuple(of_family), family) for family, of_family in rows.items()]


def offer_tables(documents: Sequence[Mapping[str, Any]]) -> list[Block]:
    """Where generic effects act, and why others do not."""
    columns = (
        _words("slot", "slot"),
        Column("unit", "unit", words=True, unit=True),
        _words("effects", "generic effects there", lambda names: ", ".join(names) or "none"),
        _words("why_not", "others not, because"),
    )
    families = dict.fromkeys(document["family"] for document in documents)
    return [
        Table(columns, tuple(document for document in documents if document["family"] == family))
        for family in families
    ]


def slot_tables(families: Sequence[Mapping[str, Any]]) -> list[Block]:
    """Where effects can act, and which names their terms may use."""
    unit = Column("unit", "unit", words=True, unit=True)
    slots = (
        _words("name", "slot"),
        unit,
        _words("combine", ""),
        _words("meaning", "meaning"),
        _words("local", "its own variables", _local),
    )
    variables = (_words("name", "variable"), unit, _words("meaning", "meaning"))
    return [
        table
        for family in families
        for table in (
            Table(slots, tuple(family["slots"]), family["family"]),
            Table(variables, tuple(family["variables"])),
        )
    ]


def _local(variables: Sequence[Mapping[str, str]]) -> str:
    return ", ".join(f"{each['name']} [{each['unit']}]" for each in variables)


def effect_blocks(effect: Effect) -> list[Block]:
    """The declaration of an effect."""
    family = effect.model_family
    # Terms are printed from the formulas that are compiled, not from the declared text of the equation: the
    # two stand one below the other.
    terms = []
    for slot, term, _ in term_texts(effect, family):
        declared = family.slot(slot)
        how = "multiplies" if declared.combine == "product" else "adds"
        terms.append(f"{how} at {slot} [{declared.shown_unit}]: {term}")
    removed = ", ".join(f"{name} = {value:g}" for name, value in effect.base.items())
    known = (
        ("looks like", effect.looks_like),
        ("confused with", ", ".join(effect.confused_with)),
        ("instead of", ", ".join(effect.instead_of)),
        ("needs", effect.needs),
        ("valid over", "; ".join(map(str, effect.valid))),
        ("provenance", str(effect.provenance or "")),
        ("source", effect.source),
    )
    return [
        Sentence(
            effect.summary.rstrip("."), head=f"{effect.name} ({effect.family}, {effect.kind})", main=True
        ),
        Points.of("", [effect.equation, *terms]),
        *([] if effect.curve is None else [_points(effect.curve)]),
        Points.of("", [f"base physics, in every model; removed by {removed} (SI)"] if removed else []),
        _parameters(effect),
        Points.of("", [f"{title}: {text}" for title, text in known if text]),
    ]


def _points(curve: MeasuredCurve) -> Table:
    """The points of a measured curve with their band."""
    document = curve.document()
    headings = {"x": f"{curve.of} [{document['over']}]", "y": f"value [{document['unit']}]"}
    if document["low"]:
        headings |= {"low": "lowest", "high": "highest"}
    columns = tuple(Column(key, heading, _five) for key, heading in headings.items())
    values = zip(*(document[key] for key in headings), strict=True)
    return Table(columns, tuple(dict(zip(headings, row, strict=True)) for row in values))


def _parameters(effect: Effect) -> Table:
    columns = (
        _words("name", "parameter"),
        _words("null", "null"),
        _words("start", "start"),
        _words("bounds", "bounds"),
        _words("sign", "sign"),
        _words("meaning", "meaning"),
    )
    rows = [
        {
            "name": parameter.name,
            "null": "shape" if parameter.null is None else _shown(parameter, parameter.null),
            "start": _shown(parameter, parameter.start),
            "bounds": _bounds(parameter),
            "sign": {1: "positive", -1: "negative", 0: "" if parameter.shape else "either"}[parameter.sign],
            "meaning": parameter.meaning,
        }
        for parameter in effect.parameters
    ]
    rows += [
        {"name": way.name, "bounds": f"in {way.unit}", "meaning": f"sets {way.parameter}: {way.meaning}"}
        for way in (effect.other_ways if effect.parameters else ())
    ]
    return Table(columns, tuple(rows))


def _bounds(parameter: EffectParameter) -> str:
    """Lower and upper bound of a parameter; a bound that is merely usual is in brackets."""
    ends = zip((parameter.low, parameter.high), parameter.usual, strict=True)
    return " to ".join(f"({_shown(parameter, e)})" if usual else _shown(parameter, e) for e, usual in ends)


def _shown(parameter: EffectParameter, si: float) -> str:
    return show(si, parameter.unit, difference=parameter.difference)


def signature_blocks(signature: Signature, rig: Rig | None) -> list[Block]:
    """A small plot of the change of each reading by the effect."""
    record = f"Standard record: {signature.record.description.rstrip('.')}"
    blocks: list[Block] = [Sentence(f"What it changes at its typical size. {record}")]
    for index, name in enumerate(signature.output_names):
        blocks += _change(signature, index, rig) if changes(signature, index) else _unchanged(name)
    if signature.silent:
        blocks.append(Sentence("Alone it has no influence on any reading; try it --with another effect"))
    return blocks


def _unchanged(name: str) -> list[Block]:
    return [Points.of("", [f"{name}: no change"])]


def _change(signature: Signature, index: int, rig: Rig | None) -> list[Block]:
    """The largest change of a reading, and its curve on an axis that holds zero."""
    change, unit = shown_change(signature, index, rig)
    peak = int(np.argmax(np.abs(change)))
    low, high = min(float(change.min()), 0.0), max(float(change.max()), 0.0)
    size = f"{significant(change[peak], 3, sign=True)} {unit} at {signature.times[peak]:g} s"
    text = f"{signature.output_names[index]}: largest {size}{_in_noise(signature, index, rig)}"
    # values that are negligible in the picture are rounding errors of the integration
    top, bottom = (significant(end if abs(end) > _FLAT * (high - low) else 0.0, 3) for end in (high, low))
    curve = Sparkline(tuple(change.tolist()), low, high, (top, bottom), lines=_LINES, width=_WIDTH)
    return [Points.of("", [text]), Figure("", "", curve=curve)]


def _in_noise(signature: Signature, index: int, rig: Rig | None) -> str:
    noise = rig.channels[signature.output_names[index]].noise_level if rig is not None else 0.0
    if not noise:
        return ""
    return f", {significant(np.abs(signature.difference[:, index]).max() / noise, 2)} times the noise"


def trial_blocks(trial: Trial, rig: Rig | None) -> list[Block]:
    """The verdict of a check."""
    effect, signature = trial.effect, trial.seen
    family = effect.model_family
    # Faults have been raised as errors before: here is only an effect without any.
    lines = []
    for slot in effect.slots:
        how = "a factor" if family.slot(slot).combine == "product" else f"a term in {family.slot(slot).unit}"
        lines.append(f"{slot}: {how}, exactly off at its null value, smooth along the standard record")
    for index, name in enumerate(signature.output_names):
        if changes(signature, index):
            change, unit = shown_change(signature, index, rig)
            largest = significant(float(np.abs(change).max()), 3)
            lines.append(f"changes {name} by up to {largest} {unit}{_in_noise(signature, index, rig)}")
    alike = ", ".join(f"{each.name} ({each.likeness:.3f})" for each in trial.alike[:_FEW])
    if alike:
        lines.append(f"most similar in the library (1 is identical): {alike}")
    warnings = tuple(Point(f"warning: {warning}", "!") for warning in trial.warnings)
    verdict = f"{effect.name} ({effect.family}, {effect.kind}) is sound"
    return [Sentence(verdict, main=True), Points.of("", lines), Points("", warnings)]
