"""testium: generated test files run by its command; start-up is subtracted with a run of ten steps.

It has no Python interface, so this script runs with any Python: TESTIUM names the command.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from workload import seconds

COMMAND = os.environ.get("TESTIUM", "testium")
INDENT = " " * 10
LET = f"{INDENT}- let:\n{INDENT}    name: s\n{INDENT}    values:\n{INDENT}      - x: 1\n"
REPORT = f"{INDENT}    report:\n" + "".join(
    f"{INDENT}      ch{k}: <| $(loop_index) * 0.001 / {k + 3} |>\n" for k in range(8)
)
HEAD = (  # fmt: skip
    "main:\n  name: bench\n  steps:\n    - loop:\n"
    "        name: L\n        iterator: {count}\n        steps:\n"
)


def run(folder: Path, count: int, step: str) -> tuple[float, Path]:
    database = folder / f"{count}.db"
    (folder / "bench.tum").write_text(HEAD.format(count=count) + step, encoding="utf-8")
    command = [COMMAND, "-b", "-o", "-p", str(database), "-t", "sqlite", "bench.tum"]
    return seconds(lambda: subprocess.run(command, cwd=folder, capture_output=True, check=False)), database


def main() -> None:
    kind, count = sys.argv[1], int(sys.argv[2])
    folder = Path(sys.argv[3] if len(sys.argv) > 3 else tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    step = LET if kind == "steps" else LET + REPORT
    start_up, _ = run(folder, 10, step)
    duration, database = run(folder, count, step)
    per_step = (duration - start_up) / (count - 10)
    if kind == "steps":
        print(json.dumps({"let": per_step * 1e6}))
    else:
        print(json.dumps({"rows_per_s": 1 / per_step, "bytes_per_row": database.stat().st_size / count}))


main()
