"""The jitter of a closed loop on this computer and on the board: ``python -m benchmarks.control_loop``.

On the computer: a whole run with recording, interlocks and log on the simulated heater board in real time,
100 updates per second. The jitter is that stored with the run; a real line adds to it. On the board:
`benchmarks.control_loop.board`; ``--board`` measures only that, ``--host`` the computer, also with Windows.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.board.real_time import go_first
from benchmarks.record import keep, table
from rigctl.backends.registry import create_backend
from rigctl.clock import real_clock
from rigctl.dataset import RunWriter, open_run
from rigctl.dataset.recording.disk_thread import BackgroundWriter
from rigctl.files.shipped import shipped
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.session import run
from rigctl.testing import VirtualBench

FOLDER = Path(__file__).parent
SECONDS = 30
STEPS = f"""\
steps:
  - record: {{name: loop, rate: 100 Hz}}
    do:
      - control: {{actuator: heater_1, channel: temperature_1, to: 40 degC, gain: 5 %/K,
          integral: 0.1 %/(K*s), rate: 100 Hz, for: {SECONDS} s}}
"""


def main() -> None:
    if "--host" not in sys.argv[1:]:
        on_board()
    if "--board" not in sys.argv[1:]:
        on_host()


def on_board() -> None:
    """The firmware on the emulated chip, which is for Linux only."""
    from benchmarks.control_loop.board import all_loads, rows

    found = all_loads()
    table("a closed loop on the board; 200 us were asked for", rows(found))
    print(f"\nkept in {keep(FOLDER, found, name='board')}")


def on_host() -> None:
    """Thirty seconds at normal priority, and thirty at the highest where that is permitted."""
    results: dict[str, Any] = {"updates": 100 * SECONDS}
    bench_file = shipped("rigs", "heater-board.yaml")
    for name, first in (("as any process", False), ("at the head of the queue", True)):
        if first:
            results["scheduling"] = go_first()
            if results["scheduling"] == "as any process":  # not permitted, or not on this system
                continue
        with tempfile.TemporaryDirectory() as folder:
            bench = VirtualBench(Path(folder), bench_file)
            plan = bench.plan(STEPS)
            backend = create_backend(plan.rig, "simulated", real_clock(), {"seed": 1})
            backend.open()
            writer = RunWriter.create(Path(folder) / "runs", bench.header(plan, backend))
            done = run(plan, backend, BackgroundWriter(writer), operator=AutomaticOperator())
            if done.folder is None:
                raise SystemExit(done.summary())
            measures = open_run(done.folder).record(0).measures
            results[name] = {key: 1e3 * measures[f"control_{key}"] for key in _SHOWN}
    rows = [
        (f"{key}, ms, {name}", f"{results[name][key]:.3f}", "5" if key == "jitter_p99" else "")
        for name in ("as any process", "at the head of the queue")
        if name in results
        for key in _SHOWN
    ]
    table("a closed loop at 100 Hz on the host", [("", "reached", "asked"), *rows])
    print(f"\nkept in {keep(FOLDER, results)}")


_SHOWN = ("jitter_p50", "jitter_p99", "latency_p99")

if __name__ == "__main__":
    sys.exit(main())
