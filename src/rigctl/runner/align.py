"""Measures how far the devices' clocks are off: an output is set and set back, and each of them sees it.

In: a rig whose file names the output and one channel of each device. Out: an offset with its uncertainty
for each channel, or for none. The movements are a procedure that is made here and run like any other,
with locks, interlocks and the safe ending, but kept in memory: no run is recorded.

An edge lies between two readings, and so limits the offset to an interval. If edges always fell at the
same place between two readings, all intervals would agree and be wrong together; the holds are therefore
spread over the period of the slowest device. The statistics are in `edge_offset`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rigctl.errors import Location, RigctlError
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig
from rigctl.rig.align import Align
from rigctl.runner.bench_access import held, opened
from rigctl.runner.edge_offset import Edge, Offset, offset_of
from rigctl.runner.launch import Launch
from rigctl.runner.operators.control_thread import beside
from rigctl.runner.recorder import Unrecorded
from rigctl.runner.session import RunResult, run

#: the least number of readings of each device in a hold
_LEAST_READINGS = 10
#: its multiples, without whole turns, lie evenly however many there are: by these the holds are spread
#: over the period of the slowest device, so that edges are not always at one place between two readings
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class Alignment:
    """What was measured.

    Attributes
    ----------
    result: how the movements of the output ended.
    offsets: by the channel that saw it; empty if they did not end well.
    """

    result: RunResult
    offsets: Mapping[str, Offset] = field(default_factory=dict)


class _Kept(Unrecorded):
    """Keeps the readings and the commands in memory."""

    def __init__(self) -> None:
        super().__init__(self._event)
        self.rows: list[Sequence[float]] = []
        self.commands: list[Mapping[str, Any]] = []

    def append(self, row: Sequence[float]) -> None:
        """Keep a reading of one device."""
        self.rows.append(tuple(row))

    def _event(self, time: float, kind: str, fields: Mapping[str, Any]) -> None:
        if kind == "command":
            self.commands.append({"time": time, **fields})


def stated_edge(rig: Rig) -> Align:
    """The edge that the rig file states.

    Raises
    ------
    RigctlError
        it states none, or holds it for too few readings of a device.
    """
    stated = rig.align
    if stated is None:
        raise RigctlError(
            "nothing says which output the devices see",
            expected="'align: {actuator: …, to: …, channels: [one of each device]}' in the rig file",
            where=Location(rig.path),
            hint="It is an output to which a channel of each device is wired, or that it reads back",
        )
    slowest = max(_periods(rig, stated).items(), key=lambda one: one[1])
    least = _LEAST_READINGS * slowest[1]
    if stated.hold < least:
        raise RigctlError(
            f"align: {rig.device_of(slowest[0])} is read too slowly for this hold",
            value=f"{stated.hold:g} s",
            expected=f"'hold: {least:g} s' or longer",
            where=Location(rig.path),
        )
    return stated


def align(rig: Rig, how: Launch) -> Alignment:
    """Set the output of `align` and set it back, as often as is stated; every output is safe afterwards.

    Interlocks act as in a run.

    Raises
    ------
    RigctlError
        nothing is stated, the bench cannot be reached, or some channel does not show the edges.
    """
    stated = stated_edge(rig)
    kept = _Kept()
    # At the highest rate that a watched bench has: the interval of an edge is as wide as the period of the
    # readings.
    sampled = rig.model_copy(update={"monitor_rate": _rate(rig)})
    plan = expand(parse_procedure(_steps(rig, stated), generated=True), sampled)
    with held(rig, "'rigctl doctor --align'", how) as lock, opened(sampled, how) as backend:
        controls = [*how.controls, *([beside(lock, backend.clock)] if lock is not None else [])]
        result = run(plan, backend, kept, operator=how.operator, controls=controls, observer=how.observer)
    if result.status != "finished":
        return Alignment(result)
    edges = _edges(rig, stated, kept.commands)
    table = np.array(kept.rows, dtype=float)
    offsets = {}
    for name in stated.channels:
        column = table[:, 2 + rig.layout.channels.index(name)]
        # Each row is the reading of one device, and rows of a slow device arrive after later ones of others.
        read = np.flatnonzero(np.isfinite(column))
        read = read[np.argsort(table[read, 0], kind="stable")]
        offsets[name] = offset_of(name, table[read, 0], column[read], edges, stated.hold)
    return Alignment(result, offsets)


def _rate(rig: Rig) -> float:
    return max(rig.monitor_rate, rig.moving_rate)


def _periods(rig: Rig, stated: Align) -> dict[str, float]:
    """Between two readings of each channel, s."""
    return {name: 1.0 / rig.rate_of(rig.device_of(name), _rate(rig)) for name in stated.channels}


def _steps(rig: Rig, stated: Align) -> str:
    """The movements as a procedure, so that they are checked and carried out like every other step."""
    spread = max(_periods(rig, stated).values())
    steps: list[dict[str, Any]] = [{"wait": f"{stated.hold!r} s"}]
    for k in range(2 * stated.repeats):
        value = rig.safe_state[stated.actuator] if k % 2 else stated.to
        steps.append({"set": {"values": {stated.actuator: value.text}}})
        steps.append({"wait": f"{stated.hold + spread * math.fmod(k * _GOLDEN, 1.0):.9g} s"})
    return json.dumps({"procedure": "align", "steps": steps})  # JSON is YAML


def _edges(rig: Rig, stated: Align, commands: Sequence[Mapping[str, Any]]) -> list[Edge]:
    """The switches of the output, as the bench has confirmed them."""
    safe = float(rig.safe_state[stated.actuator])
    edges: list[Edge] = []
    value = safe
    for one in commands:
        if one["actuator"] == stated.actuator and one["value"] != value:
            value, half = one["value"], one["uncertainty"]
            edges.append(Edge(one["time"] - half, one["time"] + half, value != safe))
    return edges
