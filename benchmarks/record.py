"""Common parts of the benchmarks: medians of repeated runs, the machine, and storage of results."""

from __future__ import annotations

import json
import os
import platform
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any


def machine() -> dict[str, Any]:
    """The machine of a measurement."""
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def versions(*packages: str) -> dict[str, str]:
    """Installed versions of the compared packages."""
    found = {}
    for name in ("rigctl", *packages):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def median_seconds(work: Callable[[], object], runs: int = 5, warm_up: int = 1) -> float:
    """Median wall time of `work` after `warm_up` calls."""
    for _ in range(warm_up):
        work()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def command_seconds(command: Sequence[str], runs: int = 5, cwd: Path | None = None) -> float:
    """Median wall time of a whole process."""
    return median_seconds(
        lambda: subprocess.run(command, cwd=cwd, check=True, capture_output=True), runs=runs
    )


def keep(
    folder: Path,
    results: Mapping[str, Any],
    *packages: str,
    name: str = "results",
    elsewhere: Mapping[str, str] | None = None,
) -> Path:
    """Store the results beside the benchmark, with machine and versions.

    `elsewhere` are versions of packages in other environments.
    """
    path = folder / f"{name}.json"
    known = versions(*packages) | dict(elsewhere or {})
    content = {"machine": machine(), "versions": known, "results": results}
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8", newline="\n")
    return path


def table(title: str, rows: Sequence[Sequence[str]]) -> None:
    """Print rows as aligned columns; the first row is the heading."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    print(f"\n{title}")
    for row in rows:
        print("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
