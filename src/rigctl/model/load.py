"""Read a model file.

In: a YAML file of the form `schema.ModelFile`. Out: a `Model`, all of it in SI. Mistakes are collected, each
with its line, as far as what follows can still be read: without a family there are no parameters, and without
parameters no effects, whose other forms are computed from them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from rigctl.argument_types import checks_argument_types
from rigctl.effects.contradiction import refuse_contradictions
from rigctl.effects.declaration import Effect
from rigctl.effects.option import read_parameter
from rigctl.effects.user.load import effect_files, load_effect
from rigctl.engine.least_squares.unknown import Prior
from rigctl.errors import RigctlError
from rigctl.files.reader import Reader
from rigctl.files.validate import validate
from rigctl.files.version_suffix import split_version, with_version
from rigctl.files.yaml import Document, parse_document, read_document
from rigctl.model.bounds import within
from rigctl.model.history.store import read_version
from rigctl.model.model import Model, Value
from rigctl.model.rig_family import require_constants
from rigctl.model.schema import Known, ModelFile, Setting
from rigctl.model.values import parameter_values
from rigctl.physics.families import find_family
from rigctl.physics.family import ModelFamily, ParameterDeclaration
from rigctl.physics.oil import find_oil
from rigctl.physics.standing import range_of
from rigctl.project import find_project
from rigctl.rig.load import load_rig
from rigctl.rig.rig import Rig
from rigctl.units import Quantity, read_si


@checks_argument_types
def load_model(path: str | Path) -> Model:
    """The model described by a file; its rig file is searched beside it, then in the project.

    ``m.yaml@3`` is version 3 of ``m.yaml``; paths in it are relative to ``m.yaml``.

    Raises
    ------
    RigctlError
        the file or its rig file cannot be read, or something in it is wrong, with its location;
        `SeveralErrors` for more than one mistake.
    """
    head, number = split_version(Path(path))
    if number is None:
        return _build(read_document(head), head)
    document = read_version(head, number)
    return replace(_build(document, head), path=with_version(head, number))


def parse_model(text: str, path: Path | None = None) -> Model:
    """The model described by a text; `path` is used in messages and to find its rig file.

    Raises
    ------
    RigctlError
        as `load_model`.
    """
    return _build(parse_document(text, path), path)


def _build(document: Document, path: Path | None) -> Model:
    """The model described by a document; relative paths are searched beside `path`."""
    written = validate(document, ModelFile)
    reader = Reader(document)
    # the family first: it says which parameters and effects there are, so that nothing else can be judged
    # without it
    family = reader.read(("model",), partial(find_family, written.model, path))
    reader.stop_at_errors()
    assert family is not None  # noqa: S101 - the reader has stopped where it is
    rig = reader.read(("rig",), partial(_rig, written.rig, path))
    if rig is not None:
        reader.read(("rig",), partial(require_constants, rig, family))
    if written.oil is not None:
        reader.read(("oil",), partial(find_oil, written.oil))
    parameters = dict(_parameters(reader, family, written))
    reader.stop_at_errors()
    # then all values, including the rig's and the oil's, from which effects in other forms are computed
    given = {name: value.si for name, value in parameters.items()}
    known = parameter_values(family, rig, given, written.oil)
    own_effects = tuple(_own_effects(reader, family, written, path))
    reader.stop_at_errors()
    model = Model(
        family, rig, written.oil, parameters, {}, written.description, path, own_effects, text=document.text
    )
    # effects last, and against each other once all are known
    effects = dict(_effects(reader, model, written, known))
    reader.read(("effects",), partial(refuse_contradictions, [*map(model.effect, effects)]), of_key=True)
    reader.stop_at_errors()
    return replace(model, effects=effects)


def _rig(written: str | None, path: Path | None) -> Rig | None:
    return None if written is None else load_rig(_resolve(written, path))


def _resolve(written: str, path: Path | None) -> Path:
    """A file named in the model: beside it, in its project, or shipped."""
    project = find_project(path.parent if path else None)
    return project.resolve(written, relative_to=path)


def _own_effects(
    reader: Reader, family: ModelFamily, written: ModelFile, beside: Path | None
) -> Iterator[Effect]:
    """The effects in the files that the model names; for a folder, those of its family."""
    known: set[str] = set()
    for index, named in enumerate(written.own_effects):
        keys = ("own_effects", index)
        path = reader.read(keys, partial(_resolve, named, beside))
        if path is None:
            continue
        folder = path.is_dir()
        for file in effect_files(path) if folder else [path]:
            effect = reader.read(keys, partial(load_effect, file))
            if effect is None or (folder and effect.family != family.name):
                continue
            if effect.family != family.name:
                error = RigctlError(
                    "this effect belongs to another family", value=named, expected=family.name
                )
                reader.refuse(keys, error)
            elif effect.name in known:
                reader.refuse(keys, RigctlError("two effects have the same name", value=effect.name))
            else:
                known.add(effect.name)
                yield effect


def _parameters(reader: Reader, family: ModelFamily, written: ModelFile) -> Iterator[tuple[str, Value]]:
    for name, setting in written.parameters.items():
        keys = ("parameters", name)
        declared = reader.read(keys, partial(family.parameter, name), of_key=True)
        if declared is None:
            continue
        # each field is read on its own, so that every mistake of an entry is reported at once
        value = reader.read((*keys, "value"), partial(_value, declared, setting.value))
        if setting.fit and declared.fixed:
            fixed = RigctlError(f"{name} is a dimension that no fit changes", hint="Leave 'fit' out")
            reader.refuse((*keys, "fit"), fixed)
        if setting.standing == "assumed" and declared.fixed:
            exact = RigctlError(
                f"{name} is a number in the equations, which no fit changes",
                hint="Write its standing in the family file",
            )
            reader.refuse((*keys, "standing"), exact)
        read_std = partial(_std, setting.std, declared.unit)
        std = reader.read((*keys, "std"), read_std)
        prior = reader.read((*keys, "prior"), partial(_prior, declared, setting.prior))
        if value is not None:
            limits = reader.read((*keys, "range"), partial(_range, declared, value, setting))
            standing = setting.standing or ""
            yield name, replace(_stated(value, setting, std), prior=prior, standing=standing, range=limits)


def _range(declared: ParameterDeclaration, value: float, setting: Setting) -> tuple[float, float] | None:
    """The range of an assumed value as it is stated, SI; None for the default one."""
    ends = setting.range
    stated = None if ends is None else (read_si(ends[0], declared.unit), read_si(ends[1], declared.unit))
    limits = range_of(declared.name, value, declared.unit, setting.standing or "", stated)
    return None if stated is None else limits


def _value(declared: ParameterDeclaration, written: Quantity) -> float:
    si = read_si(written, declared.unit)
    return within(declared.name, si, *declared.widest, declared.unit, str(written))


def _prior(declared: ParameterDeclaration, written: Known | None) -> Prior | None:
    if written is None:
        return None
    std = _std(written.std, declared.unit)
    if not std:
        raise RigctlError("a prior's standard deviation is above zero", value=str(written.std))
    return Prior(_value(declared, written.value), std)


def _effects(
    reader: Reader, model: Model, written: ModelFile, known: Mapping[str, float]
) -> Iterator[tuple[str, dict[str, Value]]]:
    for name, settings in written.effects.items():
        keys = ("effects", name)
        effect = reader.read(keys, partial(_effect, model, name), of_key=True)
        if effect is None:
            continue
        values = {parameter: Value(si) for parameter, si in effect.start.items()}
        for key, setting in settings.items():
            read = partial(read_parameter, effect, key, setting.value, known)
            parsed = reader.read((*keys, key), read)
            std = reader.read((*keys, key, "std"), partial(_effect_std, effect, key, setting, known))
            for parameter, si in (parsed or {}).items():
                declared = effect.parameter(parameter)
                value = _stated(si, setting, std)
                values[parameter] = value if key == parameter else replace(value, unit=declared.unit)
        yield name, values


def _stated(si: float, setting: Setting, std: float | None) -> Value:
    return Value(si, setting.fit, std, setting.source, setting.value.unit.text or "1")


def _std(written: Quantity | None, unit: str) -> float | None:
    """A standard deviation in SI; for a temperature it is a difference."""
    if written is None:
        return None
    std = read_si(written, unit, difference=True)
    if std < 0.0:
        raise RigctlError("a standard deviation is not negative", value=str(written))
    return std


def _effect_std(effect: Effect, key: str, setting: Setting, known: Mapping[str, float]) -> float | None:
    """The standard deviation of an effect's parameter, which may be written in an alternative form.

    That of ``f(x)`` is ``|f(x + s) - f(x - s)|/2``, f being the conversion from the alternative form.
    """
    way = next((way for way in effect.other_ways if way.name == key), None)
    if way is None:
        unit = next((p.unit for p in effect.parameters if p.name == key), None)
        return _std(setting.std, unit) if unit is not None else None
    std = _std(setting.std, way.unit)
    if std is None:
        return None
    everything = {p.name: p.value for p in effect.model_family.parameters} | dict(known)
    value = read_si(setting.value, way.unit)
    return abs(way.value_of(value + std, everything) - way.value_of(value - std, everything)) / 2.0


def _effect(model: Model, name: str) -> Effect:
    effect = model.effect(name)
    if effect.base:
        raise RigctlError(
            f"{name} is base physics, which every model has", hint="Set the model's parameters instead"
        )
    return effect
