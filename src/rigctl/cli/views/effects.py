"""How effects are printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from rigctl.cli.tables import console, table
from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.document import effect_document
from rigctl.effects.equations import term_texts
from rigctl.effects.generic import offers
from rigctl.effects.measured_curve import MeasuredCurve
from rigctl.model.effect_preview import SAME, Trial
from rigctl.model.signature import Signature
from rigctl.physics.family import ModelFamily
from rigctl.report.braille import draw_curve
from rigctl.report.effect_figure import shown_unit
from rigctl.rig.rig import Rig
from rigctl.units import parse_unit, show, significant

#: share of a reading below which a change is rounding of the integration
_ROUNDING = 1e-8
#: number of similar effects that are named
_FEW = 3


def show_list(effects: Sequence[Effect]) -> None:
    """A table of effects for each family."""
    for family in dict.fromkeys(effect.family for effect in effects):
        listed = table("effect", "kind", "acts at", "parameters", "")
        for effect in effects:
            if effect.family == family:
                where = "base physics" if effect.base else ", ".join(effect.slots)
                names = ", ".join(parameter.name for parameter in effect.parameters)
                listed.add_row(effect.name, effect.kind, where, names, escape(effect.summary))
        console().print(f"[bold]{family}[/]")
        console().print(listed)


def offer_documents(family: ModelFamily) -> list[dict[str, Any]]:
    """The slots of a family with the generic effects that act there, and why others do not."""
    return [
        {
            "family": family.name,
            "slot": offer.role.slot.name,
            "unit": offer.role.slot.shown_unit,
            "effects": [effect.name for effect in offer.effects],
            "why_not": offer.why_not,
        }
        for offer in offers(family)
    ]


def show_offers(documents: Sequence[Mapping[str, Any]]) -> None:
    """Show where generic effects act, and why others do not."""
    for family in dict.fromkeys(document["family"] for document in documents):
        shown = table("slot", "unit", "generic effects there", "others not, because")
        for document in documents:
            if document["family"] == family:
                names = ", ".join(document["effects"]) or "none"
                shown.add_row(document["slot"], document["unit"], names, escape(document["why_not"]))
        console().print(shown)


def show_slots(documents: Sequence[Mapping[str, Any]]) -> None:
    """Show where effects can act, and which names their terms may use."""
    out = console()
    for family in documents:
        out.print(f"[bold]{family['family']}[/]")
        slots = table("slot", "unit", "", "meaning", "its own variables")
        for slot in family["slots"]:
            local_variables = ", ".join(f"{local['name']} [{local['unit']}]" for local in slot["local"])
            slots.add_row(
                slot["name"], slot["unit"], slot["combine"], escape(slot["meaning"]), escape(local_variables)
            )
        out.print(slots)
        variables = table("variable", "unit", "meaning")
        for item in family["variables"]:
            variables.add_row(item["name"], item["unit"], escape(item["meaning"]))
        out.print(variables)


def show_effect(effect: Effect) -> None:
    """Show the declaration of an effect."""
    out, family = console(), effect.model_family
    out.print(f"[bold]{effect.name}[/] ({effect.family}, {effect.kind}): {escape(effect.summary)}")
    out.print(f"  {escape(effect.equation)}\n")
    for slot, term, _ in term_texts(effect, family):
        declared = family.slot(slot)
        how = "multiplies" if declared.combine == "product" else "adds"
        out.print(f"  {how} at {slot} \\[{declared.shown_unit}]: {escape(term)}")
    if effect.curve is not None:
        out.print(_points(effect.curve))
    if effect.base:
        taken = ", ".join(f"{name} = {value:g}" for name, value in effect.base.items())
        out.print(f"  base physics, in every model; removed by {taken} (SI)")
    if effect.parameters:
        out.print(_parameters(effect))
    for title, text in (
        ("looks like", effect.looks_like),
        ("confused with", ", ".join(effect.confused_with)),
        ("instead of", ", ".join(effect.instead_of)),
        ("needs", effect.needs),
        ("valid over", "; ".join(map(str, effect.valid))),
        ("provenance", str(effect.provenance or "")),
        ("source", effect.source),
    ):
        if text:
            out.print(f"  [dim]{title}:[/] {escape(text)}")


def _points(curve: MeasuredCurve) -> Table:
    """The points of a measured curve with their band."""
    document = curve.document()
    banded = bool(document["low"])
    over, unit = (escape(f"[{document[name]}]") for name in ("over", "unit"))
    grid = table(f"{escape(curve.of)} {over}", f"value {unit}", *(["lowest", "highest"] if banded else []))
    rows = [document[name] for name in ("x", "y", *(("low", "high") if banded else ()))]
    for row in zip(*rows, strict=True):
        grid.add_row(*(significant(value, 5) for value in row))
    return grid


def _parameters(effect: Effect) -> Table:
    grid = table("parameter", "null", "start", "bounds", "sign", "meaning")
    for parameter in effect.parameters:
        grid.add_row(
            parameter.name,
            "shape" if parameter.null is None else _shown(parameter, parameter.null),
            _shown(parameter, parameter.start),
            _bounds(parameter),
            {1: "positive", -1: "negative", 0: "" if parameter.shape else "either"}[parameter.sign],
            escape(parameter.meaning),
        )
    for way in effect.other_ways:
        grid.add_row(way.name, "", "", f"in {way.unit}", "", escape(f"sets {way.parameter}: {way.meaning}"))
    return grid


def _bounds(parameter: EffectParameter) -> str:
    """Lower and upper bound of a parameter; a bound that is merely usual is in brackets."""
    ends = zip((parameter.low, parameter.high), parameter.usual, strict=True)
    return " to ".join(f"({_shown(parameter, e)})" if usual else _shown(parameter, e) for e, usual in ends)


def _shown(parameter: EffectParameter, si: float) -> str:
    return show(si, parameter.unit, difference=parameter.difference)


def show_signature(signature: Signature, rig: Rig | None) -> None:
    """Show a small plot of the change of each reading by the effect."""
    out = console()
    out.print(f"\nWhat it changes at its typical size. Standard record: {signature.record.description}.")
    for index, name in enumerate(signature.output_names):
        unit = shown_unit(name, signature.output_units[index], rig)
        change = signature.difference[:, index] / parse_unit(unit).factor
        if not _changes(signature, index):
            out.print(f"  {name}: no change")
            continue
        peak = int(np.argmax(np.abs(change)))
        low, high = min(float(change.min()), 0.0), max(float(change.max()), 0.0)
        size = f"{significant(change[peak], 3, sign=True)} {unit} at {signature.times[peak]:g} s"
        out.print(f"  {name}: largest {size}{_in_noise(signature, index, rig)}")
        lines = draw_curve(change.tolist(), low=low, high=high)
        # values that are negligible in the picture are rounding errors of the integration
        top, bottom = (end if abs(end) > 1e-3 * (high - low) else 0.0 for end in (high, low))
        labels = [significant(top, 3), *[""] * (len(lines) - 2), significant(bottom, 3)]
        for label, line in zip(labels, lines, strict=True):
            out.print(f"  {label:>9} │{line}")
    if signature.silent:
        out.print("  Alone it has no influence on any reading; try it --with another effect.")


def _changes(signature: Signature, index: int) -> bool:
    size = float(np.abs(signature.without[:, index]).max()) or 1.0
    return bool(np.abs(signature.difference[:, index]).max() > _ROUNDING * size)


def _in_noise(signature: Signature, index: int, rig: Rig | None) -> str:
    noise = rig.channels[signature.output_names[index]].noise_level if rig is not None else 0.0
    if not noise:
        return ""
    return f", {significant(np.abs(signature.difference[:, index]).max() / noise, 2)} times the noise"


def signature_document(signature: Signature, rig: Rig | None) -> dict[str, Any]:
    """The changes of the readings by an effect as data, in display units."""
    outputs = {}
    for index, name in enumerate(signature.output_names):
        unit = shown_unit(name, signature.output_units[index], rig)
        change = signature.difference[:, index] / parse_unit(unit).factor
        outputs[name] = {
            "unit": unit,
            "max": float(np.abs(change).max()),
            "changes": _changes(signature, index),
            "difference": change,
        }
    return {
        "record": signature.record.description,
        "time": signature.times,
        "silent": signature.silent,
        "flat_at_null": signature.flat_at_null,
        "outputs": outputs,
    }


def show_trial(trial: Trial, rig: Rig | None) -> None:
    """The verdict of a check."""
    out, effect, signature = console(), trial.effect, trial.seen
    family = effect.model_family
    out.print(f"[bold]{effect.name}[/] ({effect.family}, {effect.kind}) is sound")
    for slot in effect.slots:
        how = "a factor" if family.slot(slot).combine == "product" else f"a term in {family.slot(slot).unit}"
        out.print(f"  {slot}: {how}, exactly off at its null value, smooth along the standard record")
    for index, name in enumerate(signature.output_names):
        if _changes(signature, index):
            unit = shown_unit(name, signature.output_units[index], rig)
            largest = float(np.abs(signature.difference[:, index]).max()) / parse_unit(unit).factor
            out.print(
                f"  changes {name} by up to {significant(largest, 3)} {unit}"
                f"{_in_noise(signature, index, rig)}"
            )
    alike = ", ".join(f"{each.name} ({each.likeness:.3f})" for each in trial.alike[:_FEW])
    if alike:
        out.print(f"  most similar in the library (1 is identical): {alike}")
    for warning in trial.warnings:
        out.print(f"[yellow]warning:[/] {escape(warning)}", soft_wrap=True)


def trial_document(trial: Trial, rig: Rig | None) -> dict[str, Any]:
    """The verdict of a check as data."""
    signature = signature_document(trial.seen, rig)
    for output in signature["outputs"].values():
        del output["difference"]
    del signature["time"]
    return {
        **effect_document(trial.effect),
        "sound": True,
        "signature": signature,
        "alike": [{"effect": each.name, "likeness": each.likeness} for each in trial.alike],
        "indistinguishable": [each.name for each in trial.alike if each.likeness > SAME],
        "warnings": list(trial.warnings),
    }
