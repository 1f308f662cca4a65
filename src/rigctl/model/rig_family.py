"""Which model family a rig file names, and whether both use the same names for the same quantities."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from rigctl.errors import RigctlError, unknown_name
from rigctl.files.amount import Amount
from rigctl.files.reader import Reader
from rigctl.files.yaml import parse_document
from rigctl.model.bounds import within
from rigctl.model.inputs import require_unit_of
from rigctl.physics.families import FAMILIES, find_family
from rigctl.physics.family import ModelFamily, ParameterDeclaration
from rigctl.rig.rig import Rig
from rigctl.units import parse_unit

#: location in a rig file, whether the fault is in the key, and the check that refuses it
_Check = tuple[tuple[str, ...], bool, Callable[[], object]]


def family_of(rig: Rig) -> ModelFamily:
    """The model family named by the rig file; a path in it is searched like any path in a file.

    Raises
    ------
    RigctlError
        it names none, or one that does not exist; a channel or an actuator has another dimension than the
        family's output or input of its name; or the rig gives a constant that is out of the bounds of the
        parameter, or that a user's own family does not have (`rigctl.rig.checks` checks the names for the
        shipped families).
    """
    if rig.model is None:
        raise RigctlError(
            f"the rig '{rig.name}' names no model family", hint="Add 'model: hydraulic_cylinder', say, to it"
        )
    family = FAMILIES.get(rig.model)
    if family is None:
        reader = _reader(rig)
        family = reader.read(("model",), partial(find_family, rig.model, rig.path))
        reader.stop_at_errors()
        assert family is not None  # noqa: S101 - the reader has stopped where it is
    _check(rig, [*_signals(rig, family), *_constants(rig, family)])
    return family


def require_constants(rig: Rig, family: ModelFamily) -> None:
    """Refuse a rig whose constants, as far as a family has them, are not possible as its parameters.

    Raises
    ------
    RigctlError
        one has another dimension or is out of bounds; with its location in the rig file.
    """
    _check(rig, [check for check in _constants(rig, family) if not check[1]])


def _reader(rig: Rig) -> Reader:
    return Reader(parse_document(rig.text, rig.path))


def _check(rig: Rig, checks: Sequence[_Check]) -> None:
    wrong: list[_Check] = []
    for check in checks:
        try:
            check[2]()
        except RigctlError:
            wrong.append(check)
    if wrong:  # the file is read again only to give the location
        reader = _reader(rig)
        for keys, of_key, refused in wrong:
            reader.read(keys, refused, of_key=of_key)
        reader.stop_at_errors()


def _signals(rig: Rig, family: ModelFamily) -> Iterator[_Check]:
    units = {item.name: item.unit for item in family.inputs} | {o.name: o.unit for o in family.outputs}
    for name, channel in rig.channels.items():
        if name in units:
            what = f"the model's {name} is in {units[name]}"
            yield ("channels", name, "unit"), False, partial(require_unit_of, what, channel.unit, units[name])
    inputs = {item.name: item.unit for item in family.inputs}
    for name, actuator in rig.actuators.items():
        # a switch may state its power, which `input_sources` handles
        unit, wanted = actuator.display_unit, inputs.get(name)
        if wanted is not None and parse_unit(unit).dimension == parse_unit(wanted).dimension:
            check = partial(require_unit_of, f"the model's {name} is in {wanted}", unit, wanted)
            yield ("actuators", name, "unit"), False, check


def _constants(rig: Rig, family: ModelFamily) -> Iterator[_Check]:
    """Every constant has the dimension of the input or parameter of its name, and is within its bounds."""
    units = {item.name: item.unit for item in family.inputs}
    units |= {parameter.name: parameter.unit for parameter in family.parameters}
    units |= {name: units[meant[0]] for name, meant in family.rig_names.items()}
    declared = {parameter.name: parameter for parameter in family.parameters}
    for part, amounts in (("geometry", rig.geometry), ("constants", rig.constants)):
        for name, amount in amounts.items():
            meant = [declared[one] for one in family.rig_names.get(name, (name,)) if one in declared]
            if name in units:
                yield (part, name), False, partial(_check_constant, name, amount, units[name], meant)
            elif family.name not in FAMILIES:
                yield (part, name), True, partial(_refuse_constant, name, family, units)


def _check_constant(name: str, amount: Amount, unit: str, meant: Sequence[ParameterDeclaration]) -> None:
    amount.check(unit)
    for one in meant:
        within(name, amount, one.low, one.high, one.unit, amount.text)


def _refuse_constant(name: str, family: ModelFamily, known: dict[str, str]) -> None:
    raise unknown_name(f"constant of {family.name}", name, known)
