"""Steps of a plan that need a device without which the run may go on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass

from rigctl.errors import RigctlError
from rigctl.expressions import Expression
from rigctl.plan import Branch, Leaf, Loop, Node, Plan, all_nodes


def refuse_needed(plan: Plan) -> None:
    """Refuse a plan with a step that needs a device with ``lost: continue``, before anything moves.

    A record needs none: its rows lack the channels of a device that is gone.

    Raises
    ------
    RigctlError
        there is such a step; the message names every one, with the location of the first.
    """
    rig = plan.rig
    spare = {name for name, device in rig.devices.items() if device.lost == "continue"}
    needing: dict[str, list[tuple[Node, str]]] = {}
    for node in all_nodes(plan) if spare else ():
        for name in dict.fromkeys(_names(node)):
            device = rig.device_of(name)
            if device in spare:
                needing.setdefault(device, []).append((node, name))
    for device, places in needing.items():
        steps = "; ".join(f"'{node.label}' (line {node.where.line}) needs {name}" for node, name in places)
        raise RigctlError(
            f"the rig file says 'lost: continue' for '{device}', and steps need it: {steps}",
            expected="'lost: pause' or 'lost: stop', or steps that do without it",
            where=places[0][0].where,
        )


def _names(node: Node) -> Iterator[str]:
    """Yield what a node itself names, among it the channels and outputs that it reads or commands."""
    match node:
        case Leaf():
            yield from _named_in(node.action)
        case Loop() | Branch():
            yield from _named_in(node.condition)


def _named_in(value: object) -> Iterator[str]:
    """Yield the texts within the fields of an action, and the names of its expressions."""
    match value:
        case Expression():
            yield from sorted(value.names)
        case str():
            yield value
        case Mapping():
            for key, each in value.items():
                yield from _named_in(key)
                yield from _named_in(each)
        case tuple() | list() | frozenset():
            for each in value:
                yield from _named_in(each)
        case _ if is_dataclass(value) and not isinstance(value, type):
            for field in fields(value):
                yield from _named_in(getattr(value, field.name))
