"""The shortest of several runs, and memory."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path


def best(work: Callable[[], object], runs: int) -> dict[str, float]:
    """Wall and CPU time, the shortest of several calls after a warm-up.

    On a machine with other load, a median would measure the other load. A call of more than ten seconds is
    not repeated.
    """
    work()
    walls, cpus = [], []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        cpus.append(time.process_time() - cpu)
        walls.append(time.perf_counter() - wall)
        if walls[-1] > 10.0:
            break
    return {"wall": min(walls), "cpu": min(cpus)}


def peak_memory_mb() -> float:
    """Peak memory of this process, if the system reports it."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage() there also counts what the parent had before the process began
        line = next(line for line in status.read_text("ascii").splitlines() if line.startswith("VmHWM"))
        return float(line.split()[1]) / 1024.0
    try:
        import resource
    except ImportError:
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2.0**20 if sys.platform == "darwin" else 1024.0)
