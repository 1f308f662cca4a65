"""Time and memory over records and columns, with the whole library: up to 1000 records and 60 columns.

    python -m benchmarks.engine.scaling records|columns

Each row is measured in a separate process, as the peak memory of a process never decreases.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

from benchmarks.engine import superset
from benchmarks.engine.timing import best, peak_memory_mb
from rigctl.engine.compile import compile_system
from rigctl.engine.simulate import simulate

RECORDS = (28, 125, 250, 500, 1000)
COLUMNS = (0, 8, 15, 30, 60)
FEW = 8


def results() -> dict[str, Any]:
    """Seconds for growing numbers of records with 8 columns, and of columns with 28 records."""
    found = {}
    for kind in ("records", "columns"):
        command = [sys.executable, "-m", "benchmarks.engine.scaling", kind]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        found[kind] = json.loads(done.stdout.splitlines()[-1])
    return found


def measured(kind: str) -> list[dict[str, float]]:
    """In this process, from few to many."""
    compiled = compile_system(superset.build())
    names = compiled.system.parameter_names
    sizes = [(count, FEW) for count in RECORDS] if kind == "records" else [(28, count) for count in COLUMNS]
    found = []
    for count, columns in sizes:
        records = superset.campaign(compiled.system, count)
        chosen = names[:columns]
        took = best(lambda: simulate(compiled, records, columns=chosen).require(), 3)  # noqa: B023
        held = count * 701 * (len(names[:columns]) * len(compiled.system.outputs)) * 8 / 2**20
        found.append(
            {
                "records": count,
                "columns": columns,
                **took,
                "peak_memory_mb": peak_memory_mb(),
                "columns_mb": held,
            }
        )
    return found


if __name__ == "__main__":
    print(json.dumps(measured(sys.argv[1])))
