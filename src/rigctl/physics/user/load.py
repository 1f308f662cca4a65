"""Read a family file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from rigctl.errors import RigctlError
from rigctl.files.reader import Reader
from rigctl.files.validate import validate
from rigctl.files.yaml import Document, parse_document, read_document
from rigctl.physics.derived_slots import with_derived_slots
from rigctl.physics.family import ModelFamily
from rigctl.physics.family_checks import examine_family
from rigctl.physics.user.declare import declare
from rigctl.physics.user.equations import write_equations
from rigctl.physics.user.fmu import fmu_family
from rigctl.physics.user.record import read_record
from rigctl.physics.user.schema import FamilyFile


def load_family(path: Path, taken: Iterable[str] = ()) -> ModelFamily:
    """The family described by a file, validated; its name must not be one of `taken`.

    Raises
    ------
    RigctlError
        the file cannot be read, or something in it is wrong, with its location; `SeveralErrors` for more
        than one mistake.
    """
    return _build(read_document(Path(path)), taken)


def parse_family(text: str, path: Path | None = None, taken: Iterable[str] = ()) -> ModelFamily:
    """The family described by a text; `path` is its name in messages.

    Raises
    ------
    RigctlError
        as `load_family`.
    """
    return _build(parse_document(text, path), taken)


def _build(document: Document, taken: Iterable[str]) -> ModelFamily:
    if isinstance(document.data, Mapping) and "fmu" in document.data:
        return fmu_family(document, taken)
    written = validate(document, FamilyFile)
    reader = Reader(document)
    if written.family in taken:
        error = RigctlError(
            "there is a model family of this name already", value=written.family, expected="another name"
        )
        reader.refuse(("family",), error)
    # 1. names, units and numbers; 2. formulas, with the types of all names; 3. the whole family in symbols,
    #    evaluated near its start. Errors are collected within a step, and a step begins only after the one
    #    before is without any. Slots are derived last: the author's own equations are examined, not the
    #    wrapped ones.
    declared = declare(reader, written)
    reader.stop_at_errors()
    family = write_equations(reader, written, declared)
    if written.standard_record is not None:
        family = replace(family, standard_record=read_record(reader, written.standard_record, family))
    reader.stop_at_errors()
    for flaw in examine_family(family):
        reader.refuse(_keys(written, flaw.part, flaw.name), flaw.error, of_key=flaw.unused)
    reader.stop_at_errors()
    return with_derived_slots(family)


def _keys(written: FamilyFile, part: str, name: str) -> tuple[str, ...]:
    """The location of a part of the family in the file; constants are parameters that no fit changes."""
    if part == "parameters" and name in written.constants:
        return ("constants", name)
    field = {"states": "rate", "definitions": "formula", "outputs": "formula", "inputs": "delay"}.get(part)
    return (part, name) if field is None else (part, name, field)
