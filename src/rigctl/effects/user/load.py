"""Read an effect file.

In: YAML text with formulas in the language of `rigctl.expressions`; nothing in it is executed. Out: an
`Effect` as the shipped library declares it, or every mistake with its line. All checks, of names, units,
bounds, and of the term within the family's equations, are made here, so that an effect from a file needs no
caution later.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from rigctl.effects.declaration import NOT_EFFECTS, Effect, EffectParameter, Term, problems
from rigctl.effects.examine import examine
from rigctl.effects.measured_curve import MeasuredCurve
from rigctl.effects.registry import library
from rigctl.effects.user.curve import read_curve
from rigctl.effects.user.formula import read_term
from rigctl.effects.user.names import name_in_file, names_beside, taken_names
from rigctl.effects.user.schema import EffectFile, ParameterField
from rigctl.effects.user.valid import read_range
from rigctl.effects.validity import Provenance, ValidRange
from rigctl.errors import Location, RigctlError, unknown_name
from rigctl.files.quantity import in_dimension
from rigctl.files.reader import Reader
from rigctl.files.validate import validate
from rigctl.files.yaml import Document, parse_document, read_document
from rigctl.physics.families import find_family, is_family_file
from rigctl.physics.family import ModelFamily, Slot
from rigctl.units import Quantity

_ENDINGS = (".yaml", ".yml")


def is_effect_file(text: str) -> bool:
    """Whether a user's text names a file, rather than an effect of the library."""
    return text.casefold().endswith(_ENDINGS)


def load_effect(path: Path) -> Effect:
    """The effect described by a file, validated.

    Raises
    ------
    RigctlError
        the file cannot be read, or something in it is wrong, with the place; `SeveralErrors` when there is
        more than one mistake.
    """
    return _build(read_document(Path(path)))


def effect_files(folder: Path) -> list[Path]:
    """The effect files in `folder` itself, by name."""
    files = sorted(path for path in folder.iterdir() if is_effect_file(path.name))
    return [path for path in files if name_in_file(path) is not None]


def place_of(path: Path, part: tuple[str, str]) -> Location:
    """Where a part of an effect stands in its file: ``("terms", slot)`` or ``("parameters", name)``."""
    document = read_document(path)
    written = validate(document, EffectFile)
    return document.locate(_keys(written, part[1]) if part[0] == "terms" else part)


def parse_effect(text: str, path: Path | None = None) -> Effect:
    """The effect described by a text; `path` is its name in messages.

    Raises
    ------
    RigctlError
        as `load_effect`.
    """
    return _build(parse_document(text, path))


def _build(document: Document) -> Effect:
    written = validate(document, EffectFile)
    reader = Reader(document)
    family = reader.read(("family",), partial(find_family, written.family, document.path))
    reader.stop_at_errors()
    assert family is not None  # noqa: S101 - the reader has stopped where it is
    # Errors are collected within a stage and reported together; a stage begins only after the previous one is
    # without errors, since a term with an unknown parameter, say, would be reported once more for each of its
    # uses. Stages: family and mentioned names, parameters, terms and curves, the declaration as a whole, and
    # last the equations with the effect written into them.
    _check_mentions(reader, written, family)
    parameters = tuple(_parameters(reader, written, family))
    reader.stop_at_errors()
    terms = tuple(_terms(reader, written, family, parameters))
    valid = tuple(_valid(reader, written, family))
    drawn = _curve(reader, written, family)
    reader.stop_at_errors()
    effect = replace(_effect(written, family, terms, parameters, document.path), valid=valid)
    if drawn is not None:
        effect = _with_curve(effect, family, *drawn)
    for problem in problems(effect, family):
        reader.refuse(("parameters",), RigctlError(problem), of_key=True)
    reader.stop_at_errors()
    for (kind, name), error in examine(effect, family):
        reader.refuse(_keys(written, name) if kind == "terms" else (kind, name), error)
    reader.stop_at_errors()
    return effect


def _keys(written: EffectFile, slot: str) -> tuple[str, ...]:
    """Where the term at `slot` stands in the file, which has a short form for one slot."""
    if written.curve is not None:
        return ("curve",)
    return ("terms", slot) if written.slot is None else ("term",)


def _parameters(reader: Reader, written: EffectFile, family: ModelFamily) -> Iterator[EffectParameter]:
    for name, field in written.parameters.items():
        keys = ("parameters", name)
        if name in taken_names(family):
            taken = RigctlError("this name already means something in the model", value=name)
            reader.refuse(keys, taken, of_key=True)
            continue
        parameter = reader.read(keys, partial(_parameter, name, field))
        if parameter is not None:
            for wrong, error in _out_of_bounds(parameter, field):
                reader.refuse((*keys, wrong), error)
            yield parameter


def _parameter(name: str, field: ParameterField) -> EffectParameter:
    unit = field.start.unit.text or "1"
    # a temperature on a scale with an offset is a point, one in kelvin a difference
    difference = not field.start.unit.absolute_temperature

    def si(quantity: Quantity) -> float:
        return in_dimension(quantity, unit, difference=difference)

    low, high = map(si, field.bounds)
    null = None if field.null_value is None else si(field.null_value)
    grid = tuple(map(si, field.grid))
    return EffectParameter(
        name,
        unit,
        null,
        si(field.start),
        low,
        high,
        field.meaning,
        difference,
        grid,
        physical=field.physical,
    )


def _out_of_bounds(parameter: EffectParameter, field: ParameterField) -> list[tuple[str, RigctlError]]:
    low, high = field.bounds
    if parameter.low >= parameter.high:
        error = RigctlError(
            "the bounds leave no room", value=f"{low}, {high}", expected="the lower one first"
        )
        return [("bounds", error)]
    errors = []
    for name, si, quantity in (
        ("start", parameter.start, field.start),
        ("null_value", parameter.at_null, field.null_value),
    ):
        if not parameter.low <= si <= parameter.high or not math.isfinite(si):
            error = RigctlError(f"{name} is out of bounds", value=str(quantity), expected=f"{low} to {high}")
            errors.append((name, error))
    if not errors and parameter.start == parameter.null:
        error = RigctlError(
            "the typical size is the null value, which switches the effect off",
            value=str(field.start),
            expected="another value",
        )
        errors.append(("start", error))
    for si, quantity in zip(parameter.grid, field.grid, strict=True):
        if not parameter.low <= si <= parameter.high:
            error = RigctlError("grid is out of bounds", value=str(quantity), expected=f"{low} to {high}")
            errors.append(("grid", error))
        elif si == parameter.null:
            error = RigctlError(
                "the grid holds the null value, which switches the effect off", value=str(quantity)
            )
            errors.append(("grid", error))
    return errors


def _terms(
    reader: Reader, written: EffectFile, family: ModelFamily, parameters: tuple[EffectParameter, ...]
) -> Iterator[tuple[str, Term]]:
    for name, text in written.by_slot.items():
        keys = _keys(written, name)
        of_slot = ("slot",) if written.slot is not None else keys
        slot = reader.read(of_slot, partial(_slot, name, written, family), of_key=written.slot is None)
        if slot is None:
            continue
        location = reader.document.locate(keys)
        term = reader.read(keys, partial(read_term, text, family, slot, parameters, location))
        if term is not None:
            yield name, term


def _valid(reader: Reader, written: EffectFile, family: ModelFamily) -> Iterator[ValidRange]:
    for over, ends in written.valid.items():
        keys = ("valid", over)
        where = reader.document.locate(keys, of_key=True)
        valid_range = reader.read(keys, partial(read_range, over, ends, family, where))
        if valid_range is not None:
            yield valid_range


def _curve(
    reader: Reader, written: EffectFile, family: ModelFamily
) -> tuple[Slot, MeasuredCurve, ValidRange | None] | None:
    """The curve that is the term, if the file has one."""
    if written.curve is None or written.slot is None:
        return None
    slot = reader.read(("slot",), partial(_slot, written.slot, written, family))
    if slot is None:
        return None
    where = reader.document.locate(("curve", "of"))
    parsed = reader.read(("curve",), partial(read_curve, written.curve, family, slot, where))
    return None if parsed is None else (slot, *parsed)


def _with_curve(
    effect: Effect, family: ModelFamily, slot: Slot, curve: MeasuredCurve, measured: ValidRange | None
) -> Effect:
    """The effect with a curve as its term; the measured range is added to its validity box."""
    stated = {one.over for one in effect.valid}
    return replace(
        effect,
        terms=((slot.name, curve),),
        parameters=curve.parameters,
        curve=curve,
        equation=effect.equation or curve.equation,
        kind="sensor" if slot.kind == "sensor" else "process",
        valid=effect.valid if measured is None or measured.over in stated else (measured, *effect.valid),
    )


def _slot(name: str, written: EffectFile, family: ModelFamily) -> Slot:
    try:
        return family.slot(name)
    except RigctlError as problem:
        if "family" not in written.model_fields_set:
            problem.hint = f"The file names no family, so it is of {family.name}: 'family: FILE' says another"
        raise


def _check_mentions(reader: Reader, written: EffectFile, family: ModelFamily) -> None:
    """Check the other effects that the file mentions: they must exist and differ from its own name.

    They are effects of the library, or of files in the same folder, which may mention each other.
    """
    known = library(family)
    if written.effect in NOT_EFFECTS:
        taken = RigctlError(
            "this name stands for unknowns of every model",
            value=written.effect,
            hint="Give it a name of its own",
        )
        reader.refuse(("effect",), taken)
    if written.effect in known:
        taken = RigctlError(
            "the library has an effect of this name", value=written.effect, hint="Give it a name of its own"
        )
        reader.refuse(("effect",), taken)
    for field in ("confused_with", "instead_of"):
        unknown = [name for name in getattr(written, field) if name not in known]
        beside = names_beside(reader.document.path) if unknown else frozenset()
        for name in unknown:
            if name not in beside:
                reader.refuse((field,), unknown_name("effect", name, [*known, *beside]))


def _effect(
    written: EffectFile,
    family: ModelFamily,
    terms: tuple[tuple[str, Term], ...],
    parameters: tuple[EffectParameter, ...],
    path: Path | None,
) -> Effect:
    sensor = bool(terms) and all(family.slot(slot).kind == "sensor" for slot, _ in terms)
    equation = "; ".join(f"{slot}: {' '.join(text.split())}" for slot, text in written.by_slot.items())
    return Effect(
        name=written.effect,
        family=family.name,
        summary=written.summary,
        equation=written.equation or equation,
        source=written.source or (path.name if path else ""),
        looks_like=written.looks_like,
        terms=terms,
        parameters=parameters,
        kind="sensor" if sensor else "process",
        confused_with=written.confused_with,
        instead_of=written.instead_of,
        needs=written.needs,
        own_family=family if is_family_file(written.family) else None,
        provenance=None if written.provenance is None else Provenance(**dict(written.provenance)),
    )
