"""`rigctl check` for files other than procedures: rigs, models, families and effects.

In: a YAML file. Out: its kind, told by the keys in it and not by its name or folder, and a description
for people or programs. Each kind is read by the same loader that every other command uses: a file passes
here exactly if they accept it, and no rule is written down a second time. Procedures are previewed
instead (`rigctl.planning`).

The last line is the next useful command for such a file, which depends on its kind: a rig of a real bench
is asked for its devices, one without is given data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from rigctl.physics.family import ModelFamily


def kind_of(path: Path) -> str:
    """The kind of a file: procedure, rig, model, family or effect.

    Raises
    ------
    RigctlError
        the file cannot be read, or is of another kind.
    """
    from rigctl.files.kinds import kind_of_keys
    from rigctl.files.yaml import read_document

    if path.is_dir():
        raise RigctlError("this is a folder", expected="a YAML file", where=Location(path))
    if path.suffix.casefold() not in (".yaml", ".yml") and "@" not in path.name:
        raise _none_of_ours(path, path.suffix or path.name)
    content = read_document(path.with_name(path.name.partition("@")[0])).data
    keys = list(content) if isinstance(content, Mapping) else []
    kind = kind_of_keys(keys)
    if kind is not None:
        return kind
    other = "a list" if isinstance(content, list) else str(content or "nothing")
    raise _none_of_ours(path, ", ".join(map(str, keys[:5])) or other)


def _none_of_ours(path: Path, content: str) -> RigctlError:
    return RigctlError(
        "this is not a rigctl file",
        value=content,
        expected="a procedure ('procedure: name' in it), a rig ('channels:'), a model ('model: FAMILY'), "
        "a family ('family: name') or an effect ('effect: name')",
        where=Location(path),
        hint="'rigctl import' reads data",
    )


def describe(kind: str, path: Path) -> dict[str, Any]:
    """A description of a file that was read and checked: its kind, name and content.

    Raises
    ------
    RigctlError
        something in it is wrong; with the location.
    """
    return {"kind": kind, "path": path.as_posix(), **_READERS[kind](path)}


def lines(document: Mapping[str, Any]) -> list[str]:
    """Print the description for people."""
    listed = [
        f"  {key.replace('_', ' ')}: {_listed(value)}"
        for key, value in document.items()
        if key not in ("kind", "path", "name", "next", "warnings") and value
    ]
    article = "an" if document["kind"] == "effect" else "a"
    text = [f"{document['path']} is {article} {document['kind']}: {document['name']}", *listed]
    text += [f"warning: {warning}" for warning in document.get("warnings", ())]
    return [*text, "Nothing is wrong with it.", f"Next: {document['next']}"]


def _listed(value: object) -> str:
    if isinstance(value, Mapping):
        units = {name: f" [{unit}]" if unit not in ("", "1") else "" for name, unit in value.items()}
        return ", ".join(f"{name}{unit}" for name, unit in units.items())
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _rig(path: Path) -> dict[str, Any]:
    from datetime import UTC, datetime

    from rigctl.cli.options.family import check_family_of
    from rigctl.rig import load_rig
    from rigctl.runner.bench_access import UNREAL

    rig = load_rig(path)
    check_family_of(rig)
    kind = rig.stated_kind
    measures = kind is not None and kind not in UNREAL
    verb = "doctor" if measures else "import FILE"  # of a device, whether it answers
    return {
        "name": rig.name,
        "channels": {name: channel.unit for name, channel in rig.channels.items()},
        "actuators": {name: actuator.display_unit for name, actuator in rig.actuators.items()},
        "limits": list(rig.limits),
        "family": rig.model,
        "backend": kind,
        "warnings": rig.warnings(datetime.now(UTC).date()),
        "next": f"rigctl {verb} --rig {path.as_posix()}",
    }


def _model(path: Path) -> dict[str, Any]:
    from rigctl.model import load_model

    model = load_model(path)
    fitted = [name for name, value in model.parameters.items() if value.fit]
    return {
        "name": path.stem,
        "family": model.family.name,
        "rig": model.rig.name if model.rig is not None else None,
        "parameters": list(model.parameters),
        "fitted": fitted,
        "effects": list(model.effects),
        "assumed": list(model.assumed),
        "next": f"rigctl model show {path.as_posix()}",
    }


def _family(path: Path) -> dict[str, Any]:
    from rigctl.physics.families import FAMILIES
    from rigctl.physics.user import load_family

    return family_facts(load_family(path, FAMILIES)) | {
        "next": f"rigctl effects list --slots --family {path.as_posix()}"
    }


def family_facts(family: ModelFamily) -> dict[str, Any]:
    """The names and units of a family."""
    return {
        "name": family.name,
        "title": family.title,
        "states": {item.name: item.unit for item in family.states},
        "inputs": {item.name: item.unit for item in family.inputs},
        "parameters": {item.name: item.unit for item in family.parameters},
        "slots": {item.name: item.unit for item in family.slots},
        "outputs": {item.name: item.unit for item in family.outputs},
    }


def _effect(path: Path) -> dict[str, Any]:
    from rigctl.effects.user import load_effect

    effect = load_effect(path)
    return {
        "name": effect.name,
        "summary": effect.summary,
        "family": effect.family,
        "slots": list(effect.slots),
        "parameters": {parameter.name: parameter.unit for parameter in effect.parameters},
        "next": f"rigctl effects check {path.as_posix()}",
    }


_READERS: Mapping[str, Callable[[Path], dict[str, Any]]] = {
    "rig": _rig,
    "model": _model,
    "family": _family,
    "effect": _effect,
}
