"""An effect as plain data, for commands with output in JSON."""

from __future__ import annotations

from typing import Any

from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.equations import term_texts
from rigctl.effects.generic import offers
from rigctl.physics.family import ModelFamily
from rigctl.units import parse_unit


def effect_document(effect: Effect) -> dict[str, Any]:
    """The complete declaration of an effect; values in the stated units."""
    family = effect.model_family
    return {
        "effect": effect.name,
        "family": effect.family,
        "kind": effect.kind,
        "summary": effect.summary,
        "equation": effect.equation,
        "terms": [
            {
                "slot": slot,
                "unit": family.slot(slot).unit,
                "combine": family.slot(slot).combine,
                "term": term,
                "latex": latex,
            }
            for slot, term, latex in term_texts(effect, family)
        ],
        "curve": None if effect.curve is None else effect.curve.document(),
        "parameters": [parameter_document(parameter) for parameter in effect.parameters],
        "other_ways": [
            {"name": way.name, "unit": way.unit, "sets": way.parameter, "meaning": way.meaning}
            for way in effect.other_ways
        ],
        "states": [
            {"name": state.name, "unit": state.unit, "meaning": state.meaning} for state in effect.states
        ],
        "base": dict(effect.base),
        "source": effect.source,
        "looks_like": effect.looks_like,
        "confused_with": list(effect.confused_with),
        "instead_of": list(effect.instead_of),
        "needs": effect.needs,
        "valid": [one.document() for one in effect.valid],
        "provenance": None if effect.provenance is None else effect.provenance.document(),
    }


def parameter_document(parameter: EffectParameter) -> dict[str, Any]:
    """A parameter of an effect, in its display unit; `null` is None for a shape parameter."""
    unit = parse_unit(parameter.unit)

    def shown(si: float) -> float:
        # twelve digits hide only the rounding errors of the conversion
        return float(f"{unit.from_si(si, difference=parameter.difference):.12g}")

    return {
        "name": parameter.name,
        "unit": parameter.unit,
        "null": None if parameter.null is None else shown(parameter.null),
        "start": shown(parameter.start),
        "low": shown(parameter.low),
        "high": shown(parameter.high),
        "physical": {"low": not parameter.usual[0], "high": not parameter.usual[1]},
        "at_least": parameter.at_least,
        "sign": parameter.sign,
        "shape": parameter.shape,
        "meaning": parameter.meaning,
    }


def family_document(family: ModelFamily) -> dict[str, Any]:
    """The slots at which effects can act, and the names that their terms may use."""
    named = [(item.name, item.unit, item.meaning) for item in family.states]
    named += [(item.name, item.unit, item.meaning) for item in family.inputs]
    named += [(item.name, item.unit, item.meaning) for item in family.definitions]
    named += [(item.name, item.unit, item.meaning) for item in family.parameters]
    return {
        "family": family.name,
        "slots": [
            {
                "name": slot.name,
                "unit": slot.shown_unit,
                "combine": slot.combine,
                "kind": slot.kind,
                "meaning": slot.meaning,
                "local": [{"name": name, "unit": unit} for name, unit in slot.local],
            }
            for slot in family.slots
        ],
        "variables": [{"name": name, "unit": unit, "meaning": meaning} for name, unit, meaning in named],
    }


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
