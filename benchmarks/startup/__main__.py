"""Start-up time of commands: ``python -m benchmarks.startup``.

Each command alternates with an idle interpreter; the figure is the median of the differences of such pairs,
which is least affected by other load.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.record import keep, table

RUNS = 21
COMMANDS = {
    "rigctl --help": ["--help"],
    "rigctl --version": ["--version"],
    "rigctl run --help": ["run", "--help"],
}


def main() -> None:
    command = str(Path(sys.executable).parent / "rigctl")
    bare = [sys.executable, "-c", "pass"]
    found = {name: over(bare, [command, *words], RUNS) for name, words in COMMANDS.items()}
    rows = [("command", "ms over a bare interpreter")]
    rows += [(name, f"{seconds * 1e3:.0f}") for name, seconds in found.items()]
    table(f"Start-up, medians of {RUNS} pairs", rows)
    print(f"\nkept in {keep(Path(__file__).parent, found, 'typer')}")


def over(bare: Sequence[str], command: Sequence[str], runs: int) -> float:
    """Median of the seconds by which `command` takes longer than `bare`, run alternately."""
    return statistics.median(seconds(command) - seconds(bare) for _ in range(runs))


def seconds(command: Sequence[str]) -> float:
    """Wall time of one process."""
    begin = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begin


if __name__ == "__main__":
    main()
