"""How often is ``adequate`` right? ``python -m benchmarks.adequacy``

200 campaigns of the separate bench without a hidden effect, and 200 with one of at least 30 sigmas, all
effects in turn. Each has 32 records: 28 conditions, four of them repeated; noise correlated between samples
(0.6), a ten-bit converter, and a relief valve set to within 0.2 %. The comparison must determine all this by
itself. Half of the campaigns have the chamber pressures too.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.adequacy.work import REPEATED, SIZE, Judged, attempt, nothing, one
from benchmarks.record import keep, table
from rigctl_validation.figures import wilson


def rates(found: Sequence[Judged]) -> dict[str, Any]:
    """Counts and Wilson's bounds, and the effects that were missed."""
    right = [one.adequate if not one.hidden else not one.adequate for one in found]
    low, high = wilson(sum(right), len(right))
    return {
        "right": sum(right),
        "of": len(right),
        "low": low,
        "high": high,
        "wrong": [
            f"{one.hidden or 'nothing'}, {'chambers' if one.chambers else 'published'}: p = {one.p_value:.2g}"
            for one, good in zip(found, right, strict=True)
            if not good
        ],
    }


def main() -> int:
    """Carry out and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200, help="of each kind")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    results: dict[str, Any] = {"size": SIZE, "records": 28 + REPEATED}
    with ProcessPoolExecutor(asked.workers, mp_context=get_context("spawn")) as pool:
        for kind, scenarios in (("nothing hidden", nothing), ("one effect", one)):
            found = []
            for place, judged in enumerate(pool.map(attempt, scenarios(asked.campaigns)), start=1):
                if isinstance(judged, str):
                    print(f"\n{judged}", file=sys.stderr)
                else:
                    found.append(judged)
                print(f"\r{kind}: {place} of {asked.campaigns}", end="", file=sys.stderr, flush=True)
            print(file=sys.stderr)
            results[kind] = rates([one for one in found if one.reached])
            results[kind]["not reached"] = sorted({one.hidden for one in found if not one.reached})
    rows = [
        [kind, word, f"{one['right']} of {one['of']}", f"{100 * one['low']:.1f} to {100 * one['high']:.1f} %"]
        for kind, word in (("nothing hidden", "adequate"), ("one effect", "not adequate"))
        for one in (results[kind],)
    ]
    table("the verdict of compare", [["campaigns", "right is", "right", "Wilson, 95 %"], *rows])
    for kind in ("nothing hidden", "one effect"):
        for line in results[kind]["wrong"]:
            print(f"wrong: {line}")
    keep(Path(__file__).parent, results, "numpy", "scipy", "numba")
    return 0


if __name__ == "__main__":
    sys.exit(main())
