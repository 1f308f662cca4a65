"""Records, and control loops between them, with a sampling rate that a device cannot deliver."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rigctl.backends.registry import options_of_device
from rigctl.errors import Location, RigctlError
from rigctl.plan import Leaf, Node, Plan, RecordNode, all_nodes
from rigctl.plan.action import Action
from rigctl.planning.line_capacity import line_capacity
from rigctl.rig import DEVICES, Rig

_ROUNDING = 1e-9
#: the kinds of backend whose devices have a limit
REAL = ("serial", "modbus", "visa", "opcua", "python", "emulated", DEVICES)
#: share by which the shortest of a few measured times may exceed the true one, on a busy computer
_MARGIN = 0.25


def too_fast(
    rig: Rig,
    rate: float,
    kind: str | None = None,
    options: Mapping[str, object] | None = None,
    loop_on: str | None = None,
) -> str | None:
    """Why the rig's real bench cannot sample at a rate (Hz); None if it can.

    Parameters
    ----------
    kind: of the backend, by default the rig's own.
    options: of the backend, where they are other than in the rig file: ``port``, ``baud``.
    loop_on: the channel of a loop with this rate: of several devices its own has to deliver it.
    """
    kind = kind or rig.kind
    device = rig.device_of(loop_on) if loop_on is not None and kind == DEVICES else ""
    if device and rate > rig.parts[device].fastest * (1.0 + _ROUNDING):
        return f"{rate:g} Hz is more than {device} can be asked for: {rig.parts[device].fastest:g} Hz"
    fastest = rig.fastest_on(kind)
    if rate > fastest * (1.0 + _ROUNDING):
        return f"{rate:g} Hz is more than the device can be asked for: {fastest:g} Hz"
    if kind == DEVICES:
        return _line_too_slow(rig, rate, options or {})
    line = line_capacity(rig, kind, options or {})
    if line is not None and rate > line.fastest * (1.0 + _ROUNDING):
        return f"{rate:g} Hz is more than possible: {line}"
    return None


def _line_too_slow(rig: Rig, rate: float, options: Mapping[str, object]) -> str | None:
    """Why one of several devices cannot be read as often as its part of a bench at `rate` needs."""
    for name, part in rig.parts.items():
        reason = too_fast(part, rig.rate_of(name, rate), None, options_of_device(rig, name, options))
        if reason is not None:
            return f"{name}: {reason}"
    return None


def refuse_rates(plan: Plan, kind: str | None = None, options: Mapping[str, object] | None = None) -> None:
    """Refuse a plan with such a record or loop, also in a cleanup block, before anything moves.

    Raises
    ------
    RigctlError
        there is one, with the location of the first; or the rig's own rate between records is too high.
    """
    if (kind or plan.rig.kind) not in REAL:
        return
    message = too_fast(plan.rig, plan.rig.monitor_rate, kind, options)
    if message is not None:
        raise RigctlError(f"monitor_rate: {message}", where=Location(plan.rig.path))
    for node, rate, _, loop_on in _rates(plan):
        message = too_fast(plan.rig, rate, kind, options, loop_on)
        if message is not None:
            raise RigctlError(f"{node.label}: {message}", where=node.where)


def refuse_slow_answers(plan: Plan, takes: float, device: str = "") -> None:
    """Refuse a plan whose records would lack too many samples, with a device that answers one at a time.

    A device that needs ``takes`` s for a sample delivers ``1/takes`` Hz, so that of a record at rate r at
    least the share ``1 - 1/(r takes)`` is missing. One of several devices is read at its own rate, which is
    at most its ``fastest``.

    Raises
    ------
    RigctlError
        a record would lack more than the share that it accepts, or a loop more than none.
    """
    who = f"device '{device}'" if device else "the device"
    hint = f"'fastest' in the description of '{device}' says how often it is read" if device else None
    for node, wanted, accepted, loop_on in _rates(plan):
        if loop_on is not None and device not in ("", plan.rig.device_of(loop_on)):
            continue  # the loop does not read it
        rate = plan.rig.rate_of(device, wanted) if device else wanted
        # Of r samples per second at most 1/takes arrive; the share 1 − 1/(r·takes) that is missing must not
        # exceed what the record accepts, which is r·takes·(1 − accepted) ≤ 1, with a margin for a busy
        # computer.
        if rate * takes * (1.0 - accepted) > 1.0 + _MARGIN:
            raise RigctlError(
                f"{node.label}: {rate:g} Hz is more than {who} can deliver: "
                f"a sample takes {takes:.2g} s, which allows {1.0 / takes:.2g} Hz",
                where=node.where,
                hint=hint,
            )


def _rates(plan: Plan) -> Iterator[tuple[Node, float, float, str | None]]:
    """Every record and loop, with its rate, Hz, the share of samples that may be missing, and of a loop its
    channel."""
    for node in all_nodes(plan):
        if isinstance(node, RecordNode):
            yield node, node.rate, node.most_missing, None
        elif isinstance(node, Leaf) and node.action.needed_rate > 0.0:
            yield node, node.action.needed_rate, 0.0, controlled(node.action)


def controlled(action: Action) -> str | None:
    """Return the channel that an action controls; None if it controls none."""
    target = action.set_point()
    return None if target is None else target.channel
