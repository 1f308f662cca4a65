"""A preview as one JSON document with permanent field names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rigctl.planning.limits import LimitUse
from rigctl.planning.preview import Preview, PreviewNode
from rigctl.units import parse_unit


def as_document(preview: Preview, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """The whole preview; times in seconds, limits in the unit of their channel.

    `warnings` are additional ones, on the rig.
    """
    plan = preview.plan
    return {
        "procedure": plan.name,
        "path": plan.procedure.path.as_posix() if plan.procedure.path else None,
        "rig": plan.rig.name,
        "rig_path": plan.rig.path.as_posix() if plan.rig.path else None,
        "digest": plan.digest,
        "arguments": dict(plan.arguments),
        "start": {name: _display(preview, name, si) for name, si in preview.start_readings.items()},
        "records": preview.records,
        "samples": preview.samples,
        "duration": preview.seconds,
        "duration_basis": preview.basis.name.lower(),
        "open_ended": preview.open_ended,
        "unattended_for": preview.unattended_for,
        "sweeps": [
            {"path": sweep.path, "variables": list(sweep.variables), "points": sweep.points}
            for sweep in preview.sweeps
        ],
        "limits": [_limit(preview, use) for use in preview.limits],
        "warnings": [
            *({"where": str(where), "message": message} for where, message in preview.warnings),
            *({"where": str(plan.rig.path or ""), "message": message} for message in warnings),
        ],
        "steps": [_node(root) for root in preview.roots],
    }


def _display(preview: Preview, channel_name: str, si: float) -> float:
    """A reading in its channel's unit."""
    channel = preview.plan.rig.channels[channel_name]
    return round(parse_unit(channel.unit).from_si(si, difference=channel.difference), 9)


def _limit(preview: Preview, use: LimitUse) -> dict[str, Any]:
    return {
        "name": use.name,
        "channel": use.channel,
        "action": use.action,
        use.bound: _display(preview, use.channel, use.threshold),
        "closest": None if use.closest is None else _display(preview, use.channel, use.closest),
        "unit": preview.plan.rig.channels[use.channel].unit,
        "state": use.state,
    }


def _node(node: PreviewNode) -> dict[str, Any]:
    document: dict[str, Any] = {
        "path": node.path,
        "label": node.label,
        "kind": node.kind,
        "where": str(node.where),
        "duration": node.seconds,
        "basis": node.basis.name.lower(),
        "records": node.records,
    }
    if node.bindings:
        document["values"] = dict(node.bindings)
    if node.kind == "loop":
        document["times"] = node.times
    if not node.counted:
        document["only_if_needed"] = True
    if node.warning:
        document["warning"] = node.warning
    if node.children:
        document["steps"] = [_node(child) for child in node.children]
    return document
