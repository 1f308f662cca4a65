"""Simulating, differentiating and fitting 28 records, beside what people use instead.

    python -m benchmarks.engine [--runs 5] [--slow]

The peers that are installed take part. `--slow` also times 28 columns where that takes minutes.
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.engine import cylinder, fit
from benchmarks.engine.common import Floats, Peer
from benchmarks.engine.rigctl_peer import RigctlPeer
from benchmarks.record import keep, median_seconds, table

HERE = Path(__file__).parent
OTHERS = (
    ("scipy", "scipy_peer", "ScipyPeer"),
    ("casadi", "casadi_peer", "CasadiPeer"),
    ("diffrax", "diffrax_peer", "DiffraxPeer"),
)
EIGHT = list(cylinder.NUISANCES)
ALL = list(cylinder.PARAMETERS)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=5)
    arguments.add_argument("--slow", action="store_true")
    options = arguments.parse_args()
    reference = RigctlPeer().exact()
    results: dict[str, Any] = {}
    packages: list[str] = []
    for peer in peers():
        print(f"measuring {peer.name}", flush=True)
        wanted = isinstance(peer, RigctlPeer) or options.slow
        results[peer.name] = measure(peer, reference, options.runs, all_columns=wanted)
        packages += peer.packages
    ours = results[RigctlPeer.name]
    fitted, stepped = fit.seconds(), stepper_seconds()
    rows = [("", "simulate", "+ 8 columns", "+ 28 columns", "outputs off by", "columns off by")]
    for name, found in results.items():
        timed = [shown(found[kind], ours[kind]) for kind in ("simulate", "columns_8", "columns_28")]
        rows.append((name, *timed, f"{found['output_error']:.1e}", f"{found['column_error']:.1e}"))
    table("28 records of 7 s at 100 Hz, 7 stiff states: warm seconds (ratio to rigctl)", rows)
    print(
        "\n8 parameters fitted from 30 % off (rigctl): "
        f"{fitted['seconds']:.2f} s, {fitted['evaluations']} calls"
    )
    print(f"65 000 calls of a stepper (rigctl): {stepped:.2f} s")
    results["fit of 8 parameters from 30 % off, rigctl"] = fitted
    results["65 000 calls of a stepper, rigctl"] = {"seconds": stepped}
    print(f"\nkept in {keep(HERE, results, *dict.fromkeys(packages))}")


def peers() -> list[Peer]:
    """This engine and every other one that is installed."""
    found: list[Peer] = [RigctlPeer()]
    for package, module, name in OTHERS:
        try:
            importlib.import_module(package)
        except ImportError:
            print(f"{package} is not installed: left out")
            continue
        found.append(getattr(importlib.import_module(f"benchmarks.engine.{module}"), name)())
    return found


def measure(peer: Peer, reference: tuple[Floats, Floats], runs: int, *, all_columns: bool) -> dict[str, Any]:
    """Median seconds of each task, and the errors against a solution at 1e-9."""
    outputs = peer.simulate()
    columns = peer.jacobian(EIGHT)
    few = 1 if once(lambda: peer.jacobian(EIGHT)) > 1.0 else runs
    found = {
        "simulate": median_seconds(peer.simulate, runs),
        "columns_8": median_seconds(lambda: peer.jacobian(EIGHT), few, warm_up=0),
        "columns_28": median_seconds(lambda: peer.jacobian(ALL), few) if all_columns else None,
    }
    exact, slopes = reference
    peak = np.abs(exact).max(axis=(0, 1))
    found["output_error"] = float((np.abs(outputs - exact).max(axis=(0, 1)) / peak).max())
    # each column over all outputs, these in units of their noise
    wrong, whole = (
        np.sqrt(np.square(x / fit.SIGMA[:, None]).sum(axis=(0, 1, 2))) for x in (columns - slopes, slopes)
    )
    found["column_error"] = float((wrong / whole).max())
    return found


def once(work: Callable[[], object]) -> float:
    """Seconds of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def shown(seconds: float | None, ours: float) -> str:
    """Seconds, and how many times as long as ours."""
    return "-" if seconds is None else f"{seconds:.3f} ({seconds / ours:.1f}x)"


def stepper_seconds(calls: int = 65_000) -> float:
    """A bench watched at 10 Hz for nearly two hours."""
    from rigctl.engine.stepper import Stepper

    peer = RigctlPeer()
    record = peer.records[3]
    stepper = Stepper(peer.compiled, record.initial, record.parameters, [0.0, *record.inputs[0][1:]])
    start = time.perf_counter()
    for k in range(1, calls + 1):
        stepper.advance(k / 10.0)
        stepper.outputs()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
