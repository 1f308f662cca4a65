"""Ten thousand rounds that a design may propose, carried out: ``python -m benchmarks.rounds``.

On every shipped rig, after a few records of its simulated bench: records at random points of all variables,
each carried out with one of the explanations as the truth. Those that trip an interlock of the runner are
counted; `tests/design/test_rounds.py` carries out a few of the same.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.record import keep, table
from rigctl.files.shipped import shipped
from rigctl_validation.designed.rounds import Tally
from rigctl_validation.designed.shipped_benches import BENCHES, proposer

HERE = Path(__file__).parent


def main() -> None:
    """Carry them out, and print and store the results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=10_000, help="on all rigs together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rig", action="append", choices=list(BENCHES), help="this one alone; repeatable")
    given = parser.parse_args()
    each = -(-given.rounds // len(BENCHES))
    rows = [("rig", "rounds", "not let through", "held back", "no solution", "tripped", "processor s")]
    asked = {"rounds": given.rounds, "seed": given.seed}
    results: dict[str, object] = {**_before(asked), **asked}
    tripped = 0
    for name in given.rig or BENCHES:
        began = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            found = proposer(name, Path(folder)).carry_out(each, given.seed)
        seconds = time.process_time() - began
        rows.append((name, *_counts(found), f"{seconds:.0f}"))
        results[name] = {
            "carried_out": found.carried_out,
            "refused": found.refused,
            "held_back": found.held_back,
            "failed": found.failed,
            "tripped": [f"{one.alarm.name}: {one.settings}; {'; '.join(one.steps)}" for one in found.tripped],
            "seconds": seconds,
        }
        tripped += len(found.tripped)
        print(" ".join(rows[-1]), flush=True)
    table("Rounds that a design may propose, carried out", rows)
    missing = {path.stem for path in shipped("rigs").glob("*.yaml")} - set(BENCHES)
    print(f"rigs that are not among them: {', '.join(sorted(missing)) or 'none'}")
    print(f"kept in {keep(HERE, results, 'numpy', 'scipy')}")
    sys.exit(1 if tripped else 0)


def _before(asked: dict[str, int]) -> dict[str, object]:
    """Stored results of as many rounds with the same seed, for other rigs."""
    path = HERE / "results.json"
    known: dict[str, object] = json.loads(path.read_text("utf-8"))["results"] if path.exists() else {}
    return known if all(known.get(name) == value for name, value in asked.items()) else {}


def _counts(found: Tally) -> tuple[str, ...]:
    numbers = (found.carried_out, found.refused, found.held_back, found.failed, len(found.tripped))
    return tuple(map(str, numbers))


if __name__ == "__main__":
    main()
