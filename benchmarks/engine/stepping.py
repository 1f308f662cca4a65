"""A bench sampled at 10 Hz for nearly two hours: 65 000 calls of a stepper."""

from __future__ import annotations

from benchmarks.engine.rigctl_peer import RigctlPeer
from benchmarks.engine.timing import best
from rigctl.engine.stepper import Stepper

CALLS = 65_000


def results(runs: int = 3) -> dict[str, float]:
    """Wall and CPU time of all calls, s."""
    peer = RigctlPeer()
    record = peer.records[3]

    def watch() -> None:
        stepper = Stepper(peer.compiled, record.initial, record.parameters, [0.0, *record.inputs[0][1:]])
        for k in range(1, CALLS + 1):
            stepper.advance(k / 10.0)
            stepper.outputs()

    return {"calls": CALLS, **best(watch, runs)}
