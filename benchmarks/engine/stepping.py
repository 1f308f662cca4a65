"""A bench watched at 10 Hz for nearly two hours: 65 000 calls of a stepper."""

from __future__ import annotations

import time
from collections.abc import Mapping

from benchmarks.engine.rigctl_peer import RigctlPeer
from rigctl.engine.stepper import Stepper

CALLS = 65_000


def results() -> dict[str, float]:
    peer = RigctlPeer()
    record = peer.records[3]
    stepper = Stepper(peer.compiled, record.initial, record.parameters, [0.0, *record.inputs[0][1:]])
    start = time.perf_counter()
    for k in range(1, CALLS + 1):
        stepper.advance(k / 10.0)
        stepper.outputs()
    return {"calls": CALLS, "seconds": time.perf_counter() - start}


def show(found: Mapping[str, float]) -> None:
    print(f"\n{found['calls']} calls of a stepper (rigctl): {found['seconds']:.2f} s")
