"""One peer that simulates the campaign, in a separate process: times, memory and results.

    python -m benchmarks.engine.measure NAME RUNS SLOW FILE

Runs in the peer's environment, which has NumPy and the peer's packages.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.engine import cylinder
from benchmarks.engine.common import EIGHT, PEERS, Floats, Peer
from benchmarks.engine.timing import best, peak_memory_mb


def main() -> None:
    name, runs, slow, file = sys.argv[1:]
    entry = PEERS[name]
    module = importlib.import_module(f"benchmarks.engine.{entry.module}")
    peer: Peer = getattr(module, entry.kind)()
    outputs, columns = stacked(peer.simulate()), stacked(peer.jacobian(EIGHT))
    every = list(cylinder.PARAMETERS)
    found: dict[str, Any] = {
        "simulate": best(peer.simulate, int(runs)),
        "columns_8": best(lambda: peer.jacobian(EIGHT), int(runs)),
        "columns_28": best(lambda: peer.jacobian(every), int(runs)) if int(slow) else None,
        "peak_memory_mb": peak_memory_mb(),
        "versions": {package: version(package) for package in peer.packages},
    }
    np.savez(Path(file), outputs=outputs, columns=columns)
    print(json.dumps(found))


def stacked(records: Sequence[Floats] | Floats) -> Floats:
    """All records in one array; outside the timing for peers that return them individually."""
    return np.stack(list(records))


if __name__ == "__main__":
    main()
