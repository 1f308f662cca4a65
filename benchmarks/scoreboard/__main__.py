"""rigctl beside published figures: ``python -m benchmarks.scoreboard --nist FOLDER``.

The logs of real benches are read from the folder that RIGCTL_REAL_DATA names, the regressions of NIST from
the other; the rival models need no files (``--rivals bff1983 --seeds 10``). What is not asked for keeps its
stored results. `make docs` then writes the page.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.record import keep
from benchmarks.scoreboard.discrimination import same_searches, searched
from benchmarks.scoreboard.nist import fits
from benchmarks.scoreboard.page import RESULTS
from benchmarks.scoreboard.rival_cases import CASES
from rigctl_validation.real.logs import LOGS
from rigctl_validation.real.trial import RealTrial
from rigctl_validation.real.work import carry_out_real


def main() -> None:
    """Measure, and store the results beside this file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scoreboard", description=__doc__)
    parser.add_argument("logs", nargs="*", help=f"of {', '.join(LOGS)}; all by default")
    parser.add_argument("--nist", type=Path, metavar="FOLDER", help="the files of NIST, *.dat")
    parser.add_argument("--only-nist", action="store_true", help="leave the real benches as they are stored")
    parser.add_argument("--rivals", nargs="*", choices=CASES, help="cases of rival models, and nothing else")
    parser.add_argument("--seeds", type=int, default=10, help="of each case of rival models")
    parser.add_argument(
        "--at-random", action="store_true", help="with rows at random instead of designed ones"
    )
    options = parser.parse_args()
    known: Mapping[str, Any] = {}
    if RESULTS.exists():
        known = json.loads(RESULTS.read_text(encoding="utf-8"))["results"]
    benches = {bench["log"]: bench for bench in known.get("benches", ())}
    searches: list[Mapping[str, Any]] = list(known.get("discrimination", ()))
    for name in () if options.only_nist or options.rivals is not None else options.logs or LOGS:
        benches[name] = _bench(name)
        print(benches[name], flush=True)
    regressions: Sequence[Mapping[str, Any]] = known.get("nist", ())
    if options.nist is not None:
        regressions = [asdict(one) for one in fits(options.nist)]
    for name in options.rivals or ():
        found = searched(CASES[name](), range(options.seeds), designed=not options.at_random)
        print(found, flush=True)
        searches = [one for one in searches if not same_searches(one, found)] + [found]
    ordered = [benches[name] for name in LOGS if name in benches]
    results = {"benches": ordered, "nist": regressions, "discrimination": searches}
    keep(RESULTS.parent, results, "numpy", "scipy")


def _bench(name: str) -> dict[str, Any]:
    log, outcome = LOGS[name], carry_out_real(RealTrial(name))
    improved = outcome.improved
    if improved is None:
        raise SystemExit(f"{name}: {outcome.failure}")
    return {
        "log": name,
        "title": log.title,
        "unit": log.unit,
        "verdict": outcome.verdict,
        "added": improved.added,
        "parameters": improved.parameters,
        "before": _finite(improved.before),
        "after": _finite(improved.after),
        "by_hand": {part: best for part, (_, best) in log.known.items()},
        "seconds": outcome.seconds,
    }


def _finite(errors: Mapping[str, float]) -> dict[str, float | None]:
    return {part: value if math.isfinite(value) else None for part, value in errors.items()}


if __name__ == "__main__":
    main()
