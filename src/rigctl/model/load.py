"""Read a model file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TypeVar

from rigctl.effects.declaration import Effect
from rigctl.effects.option import read_parameter
from rigctl.effects.registry import find_effect
from rigctl.errors import RigctlError, SeveralErrors
from rigctl.files.validate import validate
from rigctl.files.yaml import Document, parse_document, read_document
from rigctl.model.model import Model, Value
from rigctl.model.schema import ModelFile
from rigctl.model.values import parameter_values
from rigctl.physics.families import find_family
from rigctl.physics.family import ModelFamily, ParameterDeclaration
from rigctl.physics.oil import find_oil
from rigctl.project import find_project
from rigctl.rig.load import load_rig
from rigctl.rig.rig import Rig
from rigctl.units import read_si, show

T = TypeVar("T")
Keys = tuple[str, ...]


def load_model(path: Path) -> Model:
    """The model that a file describes; its rig's path is looked for beside it, then in the project.

    Raises
    ------
    RigctlError
        the file or its rig's cannot be read, or something in it is wrong, with the place; `SeveralErrors`
        when there is more than one mistake.
    """
    return _build(read_document(Path(path)))


def parse_model(text: str, path: Path | None = None) -> Model:
    """The model that a text describes; `path` is what messages call it and where its rig is looked for.

    Raises
    ------
    RigctlError
        as `load_model`.
    """
    return _build(parse_document(text, path))


def _build(document: Document) -> Model:
    written = validate(document, ModelFile)
    reader = _Reader(document)
    family = reader.read(("model",), partial(find_family, written.model))
    if family is None:
        raise reader.error()
    rig = reader.read(("rig",), partial(_rig, written.rig, document.path))
    if written.oil is not None:
        reader.read(("oil",), partial(find_oil, written.oil))
    parameters = dict(_parameters(reader, family, written))
    if reader.errors:
        raise reader.error()
    given = {name: value.si for name, value in parameters.items()}
    known = parameter_values(family, rig, given, written.oil)
    effects = dict(_effects(reader, family, written, known))
    if reader.errors:
        raise reader.error()
    return Model(family, rig, written.oil, parameters, effects, written.description, document.path)


class _Reader:
    """Reads parts of a document and keeps every mistake with its place."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.errors: list[RigctlError] = []

    def read(self, keys: Keys, read: Callable[[], T], *, of_key: bool = False) -> T | None:
        """What `read` returns, or None when it refuses what stands under `keys`."""
        try:
            return read()
        except RigctlError as error:
            self.errors.append(error.at(self.document.locate(keys, of_key=of_key)))
            return None

    def error(self) -> RigctlError:
        """All the mistakes, as one to raise."""
        return self.errors[0] if len(self.errors) == 1 else SeveralErrors(self.errors)


def _rig(written: str | None, path: Path | None) -> Rig | None:
    if written is None:
        return None
    project = find_project(path.parent if path else None)
    return load_rig(project.resolve(written, relative_to=path))


def _parameters(reader: _Reader, family: ModelFamily, written: ModelFile) -> Iterator[tuple[str, Value]]:
    for name, setting in written.parameters.items():
        keys = ("parameters", name)
        declared = reader.read(keys, partial(family.parameter, name), of_key=True)
        if declared is None:
            continue
        value = reader.read((*keys, "value"), partial(_value, declared, str(setting.value)))
        if setting.fit and declared.fixed:
            fixed = RigctlError(f"{name} is a dimension that no fit changes", hint="Leave 'fit' out")
            reader.errors.append(fixed.at(reader.document.locate((*keys, "fit"))))
        if value is not None:
            yield name, Value(value, setting.fit)


def _value(declared: ParameterDeclaration, written: str) -> float:
    value = read_si(written, declared.unit)
    if not declared.low <= value <= declared.high:
        ends = [show(end, declared.unit) for end in (declared.low, declared.high) if math.isfinite(end)]
        raise RigctlError(f"{declared.name} is out of bounds", value=written, expected=" to ".join(ends))
    return value


def _effects(
    reader: _Reader, family: ModelFamily, written: ModelFile, known: Mapping[str, float]
) -> Iterator[tuple[str, dict[str, Value]]]:
    for name, settings in written.effects.items():
        keys = ("effects", name)
        effect = reader.read(keys, partial(_effect, name, family), of_key=True)
        if effect is None:
            continue
        values = {parameter: Value(si) for parameter, si in effect.start.items()}
        for key, setting in settings.items():
            read = partial(read_parameter, effect, key, str(setting.value), known)
            found = reader.read((*keys, key), read)
            values |= {parameter: Value(si, setting.fit) for parameter, si in (found or {}).items()}
        yield name, values


def _effect(name: str, family: ModelFamily) -> Effect:
    effect = find_effect(name, family.name)
    if effect.base:
        raise RigctlError(
            f"{name} is base physics, which every model has", hint="Set the model's parameters instead"
        )
    return effect
