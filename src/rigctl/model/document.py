"""Models, the versions of them and their differences as plain data, for commands with output in JSON."""

from __future__ import annotations

from typing import Any

from rigctl.effects.declaration import Effect
from rigctl.model.difference import ModelDifference
from rigctl.model.history.version import Version
from rigctl.model.model import Model
from rigctl.model.value_table import StatedValue, stated_values
from rigctl.printable import shown_path


def model_document(model: Model, version: Version) -> dict[str, Any]:
    """A model as data."""
    values = stated_values(model)
    return {
        "model": shown_path(model.path),
        "version": version.number,
        "kept": version.kept,
        "description": model.description,
        "family": model.family.name,
        "title": model.family.title,
        "source": model.family.source,
        "rig": model.rig.name if model.rig is not None else None,
        "oil": model.oil or (model.rig.oil if model.rig is not None else None),
        "states": [
            {"name": state.name, "unit": state.unit, "meaning": state.meaning}
            for state in model.family.states
        ],
        "readings": list(model.system().output_names),
        "effects": [_effect_document(model.effect(name)) for name in model.effects],
        "parameters": [{"name": stated.name, **value_document(stated)} for stated in values],
    }


def _effect_document(effect: Effect) -> dict[str, Any]:
    """An effect of a model as data."""
    return {
        "effect": effect.name,
        "summary": effect.summary,
        "equation": effect.equation,
        "slots": list(effect.slots),
        "valid": [one.document() for one in effect.valid],
        "provenance": None if effect.provenance is None else effect.provenance.document(),
    }


def value_document(stated: StatedValue) -> dict[str, Any]:
    """A value as data, in the units beside it."""
    return {
        "value": stated.value,
        "unit": stated.unit,
        "std": stated.std_value,
        "std_unit": stated.std_unit,
        "fit": stated.fit,
        "prior": _prior(stated.prior_values),
        "undetermined": stated.undetermined,
        "standing": stated.standing or None,
        "range": None if stated.range_values is None else list(stated.range_values),
        "fixed": stated.fixed,
        "origin": stated.origin,
        "from": stated.stated_in,
        "meaning": stated.meaning,
    }


def _prior(known: tuple[float, float] | None) -> dict[str, float] | None:
    return None if known is None else {"value": known[0], "std": known[1]}


def difference_document(difference: ModelDifference) -> dict[str, Any]:
    """A difference as data."""
    return {
        "before": shown_path(difference.before.path),
        "after": shown_path(difference.after.path),
        "same": difference.same,
        "effects": {"added": list(difference.added), "removed": list(difference.removed)},
        "fields": [{"field": field, "before": old, "after": new} for field, old, new in difference.fields],
        "parameters": [
            {
                "name": value.name,
                "before": value_document(value.before) if value.before else None,
                "after": value_document(value.after) if value.after else None,
                "change": value.change,
                "deviations": value.deviations,
            }
            for value in difference.values
        ],
    }
