"""Records with a sampling rate that a device cannot deliver."""

from __future__ import annotations

from rigctl.errors import RigctlError
from rigctl.plan import Plan, RecordNode, all_nodes
from rigctl.rig import Rig

_ROUNDING = 1e-9


def too_fast(rig: Rig, rate: float) -> str | None:
    """What is wrong with a sampling rate (Hz) on the rig's real bench, or None."""
    fastest = rig.lines.fastest if rig.lines is not None else None
    if fastest is None or rate <= fastest * (1.0 + _ROUNDING):
        return None
    return f"{rate:g} Hz is more than the device can be asked for: {fastest:g} Hz"


def refuse_rates(plan: Plan) -> None:
    """Refuse a plan with such a record, also in a cleanup block, before anything moves.

    Raises
    ------
    RigctlError
        there is one; with the location of the first.
    """
    for node in all_nodes(plan):
        if isinstance(node, RecordNode):
            message = too_fast(plan.rig, node.rate)
            if message is not None:
                raise RigctlError(f"{node.label}: {message}", where=node.where)
