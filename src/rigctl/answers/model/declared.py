"""A model as its file declares it, and what differs between two."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rigctl.answers.blocks import Block, Column, Point, Points, Sentence, Table
from rigctl.model import Model, StatedValue, Version, stated_values
from rigctl.model.difference import ModelDifference, ValueDifference
from rigctl.printable import shown_path
from rigctl.units import known_digits, significant, with_uncertainty


def model_blocks(model: Model, version: Version) -> list[Block]:
    """Equations in short, effects, and a table of all parameters."""
    family = model.family
    remark = "" if version.kept or version.done.kind == "start" else ", not kept yet"
    rig = f"rig '{model.rig.name}'" if model.rig is not None else "no rig"
    oil = model.oil or (model.rig.oil if model.rig is not None else None)
    states = ", ".join(f"{state.name} ({state.unit})" for state in family.states)
    lines = [
        f"{family.name}: {family.title}. Base equations: {family.source}",
        f"{rig}{f', oil {oil}' if oil else ''}",
        f"states: {states or 'none'}",
        f"readings: {', '.join(model.system().output_names)}",
        *(line for name in model.effects for line in _effect(model, name)),
        *([] if model.effects else ["no effects besides its base"]),
    ]
    named = f"{model.name} ({version.head.as_posix()}, version {version.number}{remark})"
    return [
        Sentence(model.description.rstrip("."), head=named, main=True)
        if model.description
        else Sentence(named, main=True),
        Points.of("", lines),
        _parameters(stated_values(model)),
    ]


def _effect(model: Model, name: str) -> list[str]:
    effect = model.effect(name)
    return [
        f"effect {name} at {', '.join(effect.slots)}: {effect.equation}",
        *([f"  valid over {'; '.join(map(str, effect.valid))}"] if effect.valid else []),
        *([f"  provenance: {effect.provenance}"] if effect.provenance is not None else []),
    ]


def _parameters(values: Sequence[StatedValue]) -> Table:
    columns = (
        Column("name", "parameter"),
        Column("value", "value"),
        Column("spread", "", words=True),
        Column("unit", "unit", words=True, unit=True),
        Column("fit", "", words=True),
        Column("from", "from", words=True),
        Column("meaning", "meaning", words=True),
    )
    return Table(columns, tuple(_parameter(stated) for stated in values))


def _parameter(stated: StatedValue) -> dict[str, Any]:
    value, spread = value_texts(stated)
    return {
        "name": stated.name,
        "value": value,
        "spread": spread,
        "unit": stated.unit,
        "fit": _whether_fitted(stated),
        "from": stated.stated_in,
        "meaning": stated.meaning,
    }


def _whether_fitted(stated: StatedValue) -> str:
    """Whether a fit may change it, and its prior."""
    if not stated.fit and stated.range_values is not None:
        low, high = (f"{end:.4g}" for end in stated.range_values)
        return f"assumed, {low} to {high}"
    if not stated.fit:
        return stated.standing or "fixed"
    if stated.prior_values is None:
        return "fitted"
    value, std = stated.prior_values
    return f"fitted, prior {with_uncertainty(value, std)}"


def value_texts(stated: StatedValue) -> tuple[str, str]:
    """A value and its standard deviation in the significant digits, with its unit if that differs."""
    if stated.undetermined:
        return significant(stated.value, 2), "not determined"
    if not stated.std_value:
        return f"{stated.value:.6g}", ""
    unit = "" if stated.std_unit == stated.unit else f" {stated.std_unit}"
    value, std = known_digits(stated.value, stated.std_value)
    return value, f"± {std}{unit}"


def difference_blocks(difference: ModelDifference) -> list[Block]:
    """Effects and parameters that differ."""
    before, after = difference.before, difference.after
    named = f"{shown_path(before.path)} to {shown_path(after.path)}"
    if difference.same:
        return [Sentence("They do not differ", head=named, main=True)]
    effects = [
        *(Point(f"{name}: {after.effect(name).equation}", "+") for name in difference.added),
        *(Point(f"{name}: {before.effect(name).equation}", "-") for name in difference.removed),
        *(Point(f"{field}: {old or 'none'} to {new or 'none'}") for field, old, new in difference.fields),
    ]
    columns = (
        Column("name", "parameter"),
        Column("before", "A", words=True),
        Column("after", "B", words=True),
        Column("unit", "unit", words=True, unit=True),
        Column("change", "change"),
        Column("deviations", "standard deviations"),
    )
    values = Table(columns, tuple(map(_differing, difference.values)))
    return [Points(named, tuple(effects) or (Point("the same effects"),)), values]


def _differing(difference: ValueDifference) -> dict[str, Any]:
    known = difference.after or difference.before
    change, deviations = difference.change, difference.deviations
    return {
        "name": difference.name,
        "before": _side(difference.before),
        "after": _side(difference.after),
        "unit": known.unit if known is not None else "",
        "change": None if change is None else f"{significant(100.0 * change, 3, sign=True)} %",
        "deviations": None if deviations is None else significant(deviations, 2),
    }


def _side(stated: StatedValue | None) -> str:
    """A value in one of two columns, marked if it is fitted."""
    if stated is None:
        return ""
    parts = (*value_texts(stated), "fitted" if stated.fit else "")
    return " ".join(part for part in parts if part)
