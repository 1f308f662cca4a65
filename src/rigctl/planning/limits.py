"""The limits of the rig that a plan comes near."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rigctl.plan.forecast import Extents
from rigctl.rig import Limit, Rig

#: a limit nearer than this share of the channel's range counts as approached
_NEAR = 0.05


@dataclass(frozen=True, slots=True)
class LimitUse:
    """How near a plan's set-points and expected positions come to one limit; SI."""

    name: str
    channel: str
    action: Literal["warn", "stop"]
    bound: Literal["above", "below"]
    threshold: float
    closest: float | None  #: None: the plan does not determine this channel
    state: Literal["clear", "approached", "touched", "unknown"]


def limits_used(rig: Rig, extents: Extents, start: Mapping[str, float]) -> tuple[LimitUse, ...]:
    """Every limit on a value with the nearest expected reading, the one at the start included; the others
    cannot be foreseen. A limit is approached by steps, not by a bench at rest beside it."""
    return tuple(
        _use(rig, name, limit, extents, start) for name, limit in rig.limits.items() if limit.of_value
    )


def _use(rig: Rig, name: str, limit: Limit, extents: Extents, start: Mapping[str, float]) -> LimitUse:
    above = limit.bound == "above"
    bound: Literal["above", "below"] = "above" if above else "below"
    reached = extents.get(limit.channel)
    if reached is None:
        return LimitUse(name, limit.channel, limit.action, bound, limit.threshold, None, "unknown")
    by_steps = reached[1] if above else reached[0]
    at_rest = start.get(limit.channel, by_steps)
    closest = max(by_steps, at_rest) if above else min(by_steps, at_rest)
    margin = limit.threshold - by_steps if above else by_steps - limit.threshold
    possible = rig.channels[limit.channel].range
    near = _NEAR * (possible[1] - possible[0]) if possible is not None else 0.0
    state: Literal["clear", "approached", "touched"] = "clear"
    if margin < 0.0:
        state = "touched"
    elif margin < near:
        state = "approached"
    return LimitUse(name, limit.channel, limit.action, bound, limit.threshold, closest, state)
