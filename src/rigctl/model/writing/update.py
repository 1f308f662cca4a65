"""The text of a model file, updated for a changed model.

In: a changed `Model` with the text from which it was read. Out: that text, in which only the entries that
differ are replaced (decision 13). It is read again before it is returned: a layout in which that goes wrong
is refused, and the file stays as it was.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from rigctl.errors import Location, RigctlError
from rigctl.files.layout import Text
from rigctl.files.shipped import shipped
from rigctl.files.yaml import parse_document
from rigctl.model.load import parse_model
from rigctl.model.model import Model, Value
from rigctl.model.writing.numbers import std_text, value_text

#: relative change of a value that rounding in a file may cause
_ROUNDING = 1e-5
_PLAIN = re.compile(r"[A-Za-z][\w./@+-]*(?: [\w./@+-]+)+")


def updated_text(model: Model, path: Path, effect_files: Sequence[Path] = ()) -> str:
    """`model.text` updated to describe `model`; comments and layout are kept.

    Unchanged values stay as written; others keep their unit, with digits according to their uncertainty.

    Parameters
    ----------
    path: the model file, relative to which its other files are given.
    effect_files: of the user's own effects that the text does not name yet.

    Raises
    ------
    RigctlError
        the model was not read from a file, or the file uses anchors.
    """
    if not model.text:
        raise RigctlError("this model was not read from a file, so there is no file to change")
    _refuse_anchors(model.text, path)
    # what differs from the text as it was read is written, and nothing else: digits and units of the rest
    # stay as their user wrote them
    before = parse_model(model.text, path)
    text = Text(model.text)
    for file in effect_files:
        text.append("own_effects", _word(_relative(file, path)))
    _write_parameters(text, before, model)
    _write_effects(text, before, model)
    _check(parse_model(text.text, path), model, path)
    return text.text


def _refuse_anchors(text: str, path: Path) -> None:
    from ruamel.yaml import YAML
    from ruamel.yaml.events import AliasEvent

    parse_document(text, path)
    for event in YAML(typ="safe", pure=True).parse(text):
        if isinstance(event, AliasEvent):
            where = Location(path, event.start_mark.line + 1, event.start_mark.column + 1)
            raise RigctlError(
                "a model file with anchors cannot be changed",
                value=f"*{event.anchor}",
                where=where,
                hint="Write the value out",
            )


def _relative(file: Path, path: Path) -> str:
    """The path of a file relative to the folder of the model file, so that the project can be moved and
    shared.

    A file shipped with rigctl is named relative to the shipped files; one on another drive has no relative
    path.
    """
    absolute, folder = file.resolve(), path.resolve().parent
    if absolute.is_relative_to(shipped()) and not folder.is_relative_to(shipped()):
        return absolute.relative_to(shipped()).as_posix()
    try:
        return Path(os.path.relpath(absolute, folder)).as_posix()
    except ValueError:
        return absolute.as_posix()


def _write_parameters(text: Text, before: Model, model: Model) -> None:
    for name, value in model.parameters.items():
        if before.parameters.get(name) != value:
            declared = model.family.parameter(name)
            low, high = declared.widest
            fields = _fields(
                value,
                value.unit or declared.unit,
                changed=name not in before.parameters or before.parameters[name].si != value.si,
                low=low,
                high=high,
            )
            _write_setting(text, ("parameters", name), fields)


def _write_effects(text: Text, before: Model, model: Model) -> None:
    for name in before.effects:
        if name not in model.effects:
            text.remove(("effects", name))
    for name, values in model.effects.items():
        if not text.has("effects", name):
            text.insert(("effects", name), "{}")
        old = before.effects.get(name, {})
        for parameter, value in values.items():
            if old.get(parameter) != value:
                _write_effect_parameter(text, model, name, parameter, value, old.get(parameter))


def _write_effect_parameter(
    text: Text, model: Model, name: str, parameter: str, value: Value, old: Value | None
) -> None:
    effect = model.effect(name)
    declared = effect.parameter(parameter)
    keys = ("effects", name, parameter)
    # a fit yields the parameter itself, not an alternative form of it
    for way in effect.other_ways:
        if way.parameter == parameter and text.has("effects", name, way.name):
            text.rename(("effects", name, way.name), parameter)
            old = None
    low, high = declared.bounds_around(value.si)
    fields = _fields(
        value,
        value.unit or declared.unit,
        changed=old is None or old.si != value.si or not text.has(*keys),
        difference=declared.difference,
        low=low,
        high=high,
    )
    _write_setting(text, keys, fields)


def _fields(
    value: Value,
    unit: str,
    *,
    changed: bool,
    difference: bool = False,
    low: float = -math.inf,
    high: float = math.inf,
) -> dict[str, str | None]:
    """The fields of an entry, in the order of the file; None for fields left out.

    A value that did not change is left out of the mapping altogether.
    """
    std = value.std if value.std is not None and math.isfinite(value.std) else None
    fields: dict[str, str | None] = {}
    if changed:
        fields["value"] = value_text(value.si, unit, std=std, difference=difference, low=low, high=high)
    fields["fit"] = "true" if value.fit else None
    fields["standing"] = value.standing or None
    fields["range"] = _range_text(value.range, unit, difference=difference)
    fields["std"] = None if std is None else std_text(std, unit)
    fields["from"] = _word(value.source) if value.source else None
    return fields


def _range_text(limits: tuple[float, float] | None, unit: str, *, difference: bool) -> str | None:
    if limits is None:
        return None
    low, high = (value_text(end, unit, difference=difference) for end in limits)
    return f"[{low}, {high}]"


def _word(text: str) -> str:
    """A text as YAML: plain if that is unambiguous, quoted otherwise."""
    flat = " ".join(text.split())
    return flat if _PLAIN.fullmatch(flat) else json.dumps(flat, ensure_ascii=False)


def _write_setting(text: Text, keys: tuple[str, ...], fields: Mapping[str, str | None]) -> None:
    """Write `fields` to the entry under `keys`: the value alone if there are no other fields."""
    # three layouts: a mapping, in which single fields change; a bare value, which becomes a mapping in braces
    # only if there is more to say; no entry at all
    stated = {name: field for name, field in fields.items() if field is not None}
    if text.is_mapping(*keys):
        for name, field in fields.items():
            _write_field(text, (*keys, name), field)
        return
    value = stated.pop("value", None) or text.scalar(*keys)
    inner = "".join(f", {name}: {field}" for name, field in stated.items())
    entry = f"{{value: {value}{inner}}}" if stated else str(value)
    if text.has(*keys):
        text.replace(keys, entry)
    else:
        text.insert(keys, entry)


def _write_field(text: Text, keys: tuple[str, ...], field: str | None) -> None:
    present = text.has(*keys)
    if field is not None and present:
        if text.scalar(*keys) != field:
            text.replace(keys, field)
    elif field is not None:
        text.insert(keys, field)
    elif present and keys[-1] == "fit":
        text.replace(keys, "false")
    elif present:
        text.remove(keys)


def _check(again: Model, model: Model, path: Path) -> None:
    """Require that the text read again is the model, to the digits of a file."""
    same = set(again.effects) == set(model.effects) and set(again.fitted) == set(model.fitted)
    for name, value in model.values.items():
        if not same or not math.isclose(again.values[name], value, rel_tol=_ROUNDING, abs_tol=1e-300):
            raise RigctlError(
                "the file is laid out in a way that cannot be changed without losing some of it",
                where=Location(path),
                hint="Write each parameter on a line of its own, as the shipped models do",
            )
