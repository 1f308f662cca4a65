"""Records, and control loops between them, with a sampling rate that a device cannot deliver."""

from __future__ import annotations

from rigctl.errors import RigctlError
from rigctl.plan import Leaf, Plan, RecordNode, all_nodes
from rigctl.rig import Rig

_ROUNDING = 1e-9


def too_fast(rig: Rig, rate: float, kind: str | None = None) -> str | None:
    """Why the rig's real bench cannot sample at a rate (Hz); None if it can.

    `kind` is the kind of backend, by default the rig's own.
    """
    fastest = rig.fastest if kind is None else rig.fastest_on(kind)
    if rate <= fastest * (1.0 + _ROUNDING):
        return None
    return f"{rate:g} Hz is more than the device can be asked for: {fastest:g} Hz"


def refuse_rates(plan: Plan, kind: str | None = None) -> None:
    """Refuse a plan with such a record or loop, also in a cleanup block, before anything moves.

    Raises
    ------
    RigctlError
        there is one; with the location of the first.
    """
    for node in all_nodes(plan):
        rate = node.rate if isinstance(node, RecordNode) else 0.0
        if isinstance(node, Leaf):
            rate = node.action.needed_rate
        message = too_fast(plan.rig, rate, kind)
        if message is not None:
            raise RigctlError(f"{node.label}: {message}", where=node.where)
