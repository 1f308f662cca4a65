"""Readings of the bench for the message of a step that fails."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rigctl.plan.behaviour import StepBench
from rigctl.units import show


def seen(bench: StepBench, names: Iterable[str]) -> str:
    """Return the latest values of the channels and commands among `names`, e.g. ``position was 80 mm``."""
    parts = [
        f"{name} was {reading(bench, name, bench.newest[bench.columns[name]])}"
        for name in sorted(names)
        if name in bench.columns and bench.newest is not None
    ]
    return ", ".join(parts) or "no channel of it was read"


def reading(bench: StepBench, name: str, value: float, *, difference: bool = False) -> str:
    """Return an SI value of a channel or command as text, in its unit."""
    if math.isnan(value):
        return "missing"
    layout = bench.rig.layout
    return show(value, layout.unit(name), difference=difference or name in layout.differences)
