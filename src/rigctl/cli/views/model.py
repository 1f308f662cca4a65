"""How models, their differences and their errors are printed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from rigctl.cli.tables import console, table
from rigctl.effects.declaration import Effect
from rigctl.model import Model, StatedValue, Version, stated_values
from rigctl.model.difference import ModelDifference, ValueDifference
from rigctl.model.value_table import rounded
from rigctl.printable import shown_path
from rigctl.units import known_digits, parse_unit, significant, with_uncertainty

#: the source of a value that the model file does not explain
_SAID_BY = {
    "model": "model file",
    "rig": "rig file",
    "oil": "oil",
    "family": "typical",
    "effect": "typical",
}


def show_model(model: Model, version: Version) -> None:
    """Equations in short, effects, and a table of all parameters."""
    out, family = console(), model.family
    out.print(f"[bold]{escape(model.name)}[/] {escape(_which(version))}: {escape(model.description)}")
    out.print(f"  {family.name}: {escape(family.title)}. Base equations: {escape(family.source)}")
    rig = f"rig '{model.rig.name}'" if model.rig is not None else "no rig"
    oil = model.oil or (model.rig.oil if model.rig is not None else None)
    out.print(f"  {escape(rig)}{f', oil {oil}' if oil else ''}")
    states = ", ".join(f"{state.name} ({state.unit})" for state in family.states)
    out.print(f"  states: {escape(states or 'none')}")
    out.print(f"  readings: {', '.join(model.system().output_names)}")
    for name in model.effects:
        effect = model.effect(name)
        out.print(f"  effect [bold]{name}[/] at {', '.join(effect.slots)}: {escape(effect.equation)}")
        if effect.valid:
            out.print(f"    [dim]valid over[/] {escape('; '.join(map(str, effect.valid)))}", soft_wrap=True)
        if effect.provenance is not None:
            out.print(f"    [dim]provenance:[/] {escape(str(effect.provenance))}", soft_wrap=True)
    if not model.effects:
        out.print("  no effects besides its base")
    out.print(_parameters(stated_values(model)))


def _which(version: Version) -> str:
    """Which version of which file, in words."""
    remark = "" if version.kept or version.done.kind == "start" else ", not kept yet"
    return f"({version.head}, version {version.number}{remark})"


def _parameters(values: Sequence[StatedValue]) -> Table:
    grid = table("parameter", "value", "", "unit", "", "from", "meaning")
    grid.columns[1].justify = "right"
    for stated in values:
        value, spread = value_texts(stated)
        grid.add_row(
            stated.name,
            value,
            escape(spread),
            escape(stated.unit),
            _whether_fitted(stated),
            escape(stated.source or _SAID_BY[stated.origin]),
            escape(stated.meaning),
        )
    return grid


def _whether_fitted(stated: StatedValue) -> str:
    """Whether a fit may change it, and its prior."""
    if not stated.fit and stated.range is not None:
        low, high = (f"{_in_unit(end, stated):.4g}" for end in stated.range)
        return f"assumed, {low} to {high}"
    if not stated.fit:
        return stated.standing or "fixed"
    if stated.prior_values is None:
        return "fitted"
    value, std = stated.prior_values
    return f"fitted, prior {with_uncertainty(value, std)}"


def _in_unit(si: float, stated: StatedValue) -> float:
    return rounded(parse_unit(stated.unit).from_si(si))


def value_texts(stated: StatedValue) -> tuple[str, str]:
    """A value and its standard deviation in the significant digits, with its unit if that differs."""
    if stated.undetermined:
        return significant(stated.value, 2), "not determined"
    if not stated.std_value:
        return f"{stated.value:.6g}", ""
    unit = "" if stated.std_unit == stated.unit else f" {stated.std_unit}"
    value, std = known_digits(stated.value, stated.std_value)
    return value, f"± {std}{unit}"


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
        "range": None if stated.range is None else [_in_unit(end, stated) for end in stated.range],
        "fixed": stated.fixed,
        "origin": stated.origin,
        "from": stated.source or _SAID_BY[stated.origin],
        "meaning": stated.meaning,
    }


def show_difference(difference: ModelDifference) -> None:
    """Effects and parameters that differ."""
    out = console()
    before, after = (escape(shown_path(one.path)) for one in (difference.before, difference.after))
    out.print(f"[bold]{before}[/] to [bold]{after}[/]")
    if difference.same:
        out.print("  They do not differ.")
        return
    for name in difference.added:
        out.print(f"  [green]+[/] {name}: {escape(difference.after.effect(name).equation)}")
    for name in difference.removed:
        out.print(f"  [red]-[/] {name}: {escape(difference.before.effect(name).equation)}")
    for field, old, new in difference.fields:
        out.print(f"  {field}: {escape(old or 'none')} to {escape(new or 'none')}")
    if difference.values:
        grid = table("parameter", "A", "B", "unit", "change", "standard deviations")
        for value in difference.values:
            grid.add_row(*map(escape, _row(value)))
        out.print(grid)


def _row(difference: ValueDifference) -> tuple[str, ...]:
    unit = next((stated.unit for stated in (difference.after, difference.before) if stated is not None), "")
    change, deviations = difference.change, difference.deviations
    return (
        difference.name,
        _side(difference.before),
        _side(difference.after),
        unit,
        "" if change is None else f"{significant(100.0 * change, 3, sign=True)} %",
        "" if deviations is None else significant(deviations, 2),
    )


def _side(stated: StatedValue | None) -> str:
    """A value in one of two columns, marked if it is fitted."""
    if stated is None:
        return ""
    parts = (*value_texts(stated), "fitted" if stated.fit else "")
    return " ".join(part for part in parts if part)


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


def _prior(known: tuple[float, float] | None) -> dict[str, float] | None:
    return None if known is None else {"value": known[0], "std": known[1]}
