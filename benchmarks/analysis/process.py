"""One task in a separate process, so that its memory can be measured: ``… process WORK ARGUMENTS``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.analysis.data import MODEL, RIG
from benchmarks.engine.timing import peak_memory_mb


@dataclass(frozen=True)
class Used:
    """The cost of a process: wall and CPU time, peak memory in MB, and its output."""

    wall: float
    cpu: float
    megabytes: float
    said: str


def in_a_process(work: str, *arguments: str) -> Used:
    """Carry out ``import FILE RUNS`` or ``compare RUN`` in a separate process."""
    command = [sys.executable, "-m", "benchmarks.analysis.process", work, *arguments]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return Used(*json.loads(done.stdout))


def in_a_command(
    command: Sequence[str],
    environment: Mapping[str, str],
    times: int,
    of: Callable[[list[float]], float] = min,
) -> dict[str, float]:
    """Wall and CPU time of a whole command: the shortest, or another statistic, after a warm-up."""
    walls, cpus = [], []
    for _ in range(1 + times):
        wall, before = time.perf_counter(), os.times()
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, **environment})
        walls.append(time.perf_counter() - wall)
        after = os.times()
        cpus.append(
            after.children_user + after.children_system - before.children_user - before.children_system
        )
    return {"wall": of(walls[1:]), "cpu": of(cpus[1:])}


def _import(file: str, runs: str) -> str:
    from rigctl.dataset.importing import import_file
    from rigctl.rig import load_rig

    return str(import_file(Path(file), load_rig(RIG), Path(runs)).path)


def _compare(run: str) -> str:
    from rigctl.analysis.comparison import compare
    from rigctl.dataset import open_run
    from rigctl.model import load_model

    return compare([open_run(run)], [load_model(MODEL)]).models[0].statement


def main() -> None:
    works = {"import": _import, "compare": _compare}
    wall, cpu = time.perf_counter(), time.process_time()
    said = works[sys.argv[1]](*sys.argv[2:])
    took = time.perf_counter() - wall, time.process_time() - cpu
    print(json.dumps([*took, peak_memory_mb(), said]))


if __name__ == "__main__":
    main()
