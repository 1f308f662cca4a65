"""Start-up, cost of a step, and recording of rows: rigctl and its peers, in one run.

    python -m benchmarks.peers --venvs DIR [--install] [--runs 3]

Each peer has a virtual environment under DIR; `--install` makes missing ones.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.record import command_seconds, keep, table

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Peer:
    """A peer: packages to install, modules to import, amount of work."""

    name: str
    packages: tuple[str, ...]
    start: str
    steps: int
    rows: int


PEERS = (
    Peer("bluesky", ("bluesky", "ophyd", "ophyd-async", "suitcase-jsonl"),
         "from bluesky import RunEngine; import bluesky.plans; RunEngine({})", 2000, 20_000),
    Peer("openhtf", ("openhtf",), "import openhtf", 1000, 100_000),
    Peer("pymeasure", ("pymeasure",), "import pymeasure.experiment", 500, 100_000),
    Peer("qcodes", ("qcodes",), "from qcodes.dataset import Measurement", 2000, 20_000),
    Peer("labgrid", ("labgrid",), "import labgrid", 20_000, 0),
    Peer("testium", ("testium-hil",), "", 1000, 1000),
)  # fmt: skip


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--venvs", type=Path, required=True)
    arguments.add_argument("--install", action="store_true")
    arguments.add_argument("--runs", type=int, default=3)
    options = arguments.parse_args()
    results: dict[str, Any] = {"rigctl": measure_rigctl(options.runs)}
    for peer in PEERS:
        folder = options.venvs / peer.name
        if options.install and not folder.exists():
            install(peer, folder)
        results[peer.name] = measure(peer, folder, options.runs) if folder.exists() else {}
    show(results)
    print(f"\nkept in {keep(HERE, results)}")


def install(peer: Peer, folder: Path) -> None:
    """A virtual environment with the peer in it."""
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    subprocess.run([folder / "bin" / "pip", "install", "--quiet", *peer.packages], check=True)


def measure_rigctl(runs: int) -> dict[str, Any]:
    """rigctl from this environment: its start-up is `--version`, since `--help` imports nothing."""
    python = Path(sys.executable)
    return {
        "start_ms": (command_seconds([str(python.parent / "rigctl"), "--version"], runs) - bare(python, runs))
        * 1e3,
        "steps_us": medians([python, HERE / "rigctl_peer.py", "steps", "20000"], runs),
        "rows": medians([python, HERE / "rigctl_peer.py", "rows", "500000"], runs, needs_folder=True),
    }


def measure(peer: Peer, folder: Path, runs: int) -> dict[str, Any]:
    """Measure one peer in its environment, without what it does not support."""
    python = folder / "bin" / "python"
    script = HERE / f"{peer.name}_peer.py"
    found: dict[str, Any] = {"version": installed(python, peer.packages[0])}
    start = [str(python), "-c", peer.start] if peer.start else [str(folder / "bin" / "testium"), "--version"]
    found["start_ms"] = (command_seconds(start, runs) - bare(python, runs)) * 1e3
    found["steps_us"] = medians([python, script, "steps", str(peer.steps)], runs)
    if peer.rows:
        found["rows"] = medians([python, script, "rows", str(peer.rows)], runs, needs_folder=True)
    return found


def bare(python: Path, runs: int) -> float:
    """Seconds of an idle interpreter, subtracted from every start-up."""
    return command_seconds([str(python), "-c", "pass"], runs)


def installed(python: Path, package: str) -> str:
    code = f"from importlib.metadata import version; print(version({package!r}))"
    return subprocess.run([python, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def medians(command: Sequence[str | Path], runs: int, *, needs_folder: bool = False) -> dict[str, float]:
    """The median of every figure that a script prints as its last JSON line."""
    answers = []
    for _ in range(runs):
        folder = tempfile.mkdtemp()
        environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "MPLBACKEND": "Agg"}
        environment["TESTIUM"] = str(Path(command[0]).parent / "testium")
        done = subprocess.run(
            [*map(str, command), *([folder] if needs_folder else [])],
            env=environment, capture_output=True, text=True, check=True,
        )  # fmt: skip
        shutil.rmtree(folder)
        answers.append(json.loads([line for line in done.stdout.splitlines() if line.startswith("{")][-1]))
    return {name: statistics.median(answer[name] for answer in answers) for name in answers[0]}


def show(results: dict[str, Any]) -> None:
    """The three tables, rigctl first."""
    ours = results["rigctl"]
    starts = [["tool", "start-up over bare Python [ms]", "of rigctl's"]]
    steps = [["tool", "step", "µs", "of rigctl's"]]
    rows = [["tool", "rows/s", "of rigctl's", "bytes/row"]]
    our_step = min(ours["steps_us"].values())
    for name, found in results.items():
        if not found:
            continue
        starts.append([name, f"{found['start_ms']:.0f}", f"{found['start_ms'] / ours['start_ms']:.1f}"])
        for step, cost in found["steps_us"].items():
            steps.append([name, step, f"{cost:.1f}", f"{cost / our_step:.1f}"])
        if "rows" in found:
            rate = found["rows"]["rows_per_s"]
            ratio = rate / ours["rows"]["rows_per_s"]
            rows.append([name, f"{rate:,.0f}", f"{ratio:.3f}", f"{found['rows']['bytes_per_row']:.0f}"])
    table("Start-up", starts)
    table("One trivial step", steps)
    table("Eight floats a row, into the tool's own store", rows)


if __name__ == "__main__":
    main()
