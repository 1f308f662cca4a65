"""Which family of models a rig file names, and whether the rig says of it what makes sense."""

from __future__ import annotations

from functools import partial

from rigctl.errors import RigctlError, unknown_name
from rigctl.files.reader import Reader
from rigctl.files.yaml import parse_document
from rigctl.physics.families import FAMILIES, find_family
from rigctl.physics.family import ModelFamily
from rigctl.rig.rig import Rig


def family_of(rig: Rig) -> ModelFamily:
    """The model family that the rig file names; a path in it is looked for as any path in a file.

    Raises
    ------
    RigctlError
        it names none, or none that there is; or it gives the family a constant of another dimension, or one
        that the family does not have (`rigctl.rig.checks` has looked at those of families that come with
        rigctl).
    """
    if rig.model is None:
        raise RigctlError(
            f"the rig '{rig.name}' names no model family", hint="Add 'model: hydraulic_cylinder', say, to it"
        )
    if rig.model in FAMILIES:
        return FAMILIES[rig.model]
    reader = Reader(parse_document(rig.text, rig.path))
    family = reader.read(("model",), partial(find_family, rig.model, rig.path))
    reader.stop_at_errors()
    assert family is not None  # noqa: S101 - the reader has stopped where it is
    _check_constants(reader, rig, family)
    reader.stop_at_errors()
    return family


def _check_constants(reader: Reader, rig: Rig, family: ModelFamily) -> None:
    units = {item.name: item.unit for item in family.inputs}
    units |= {parameter.name: parameter.unit for parameter in family.parameters}
    units |= {name: units[meant[0]] for name, meant in family.rig_names.items()}
    for part, amounts in (("geometry", rig.geometry), ("constants", rig.constants)):
        for name, amount in amounts.items():
            if name not in units:
                error = unknown_name(f"constant of {family.name}", name, units)
                reader.refuse((part, name), error, of_key=True)
            else:
                reader.read((part, name), partial(amount.check, units[name]))
