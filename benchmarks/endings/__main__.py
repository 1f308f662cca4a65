"""Time from a signal to safe outputs, and effect of a slow disk: ``python -m benchmarks.endings``.

Both in real time. The first is measured at the emulated board's pins.
"""

from __future__ import annotations

import os
import random
import signal
import statistics
import sys
import tempfile
import threading
import time
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

from benchmarks.record import keep, table
from rigctl.backends.emulated.board import EmulatedBoard
from rigctl.backends.protocol import Backend
from rigctl.backends.registry import create_backend
from rigctl.clock import real_clock
from rigctl.dataset import RunHeader, RunWriter, Source
from rigctl.dataset.recording import journal, log
from rigctl.dataset.recording.disk_thread import BackgroundWriter
from rigctl.dataset.recording.header import source_of_rig
from rigctl.files.shipped import shipped
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig, load_rig
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.session import run

ENDINGS = int(sys.argv[1]) if len(sys.argv) > 1 else 30
RATE, LASTS = 100.0, 12.0  # Hz, s
MOVING = """\
procedure: moving
steps:
  - set: {heater: on}
  - repeat: 1000
    do:
      - extend: {for: 0.3 s}
      - retract: {for: 0.3 s}
"""
HEATING = (
    "procedure: heating\nsteps:\n  - set: {heater: on}\n  - wait: 1 h\n"  #: read only ten times per second
)


def carry_out(text: str, rig: Rig, backend: Backend, folder: Path) -> None:
    plan = expand(parse_procedure(text), rig)
    header = RunHeader(
        "20260101-000000-x", Source("x"), source_of_rig(rig), rig.layout, datetime.now(UTC), backend.identity
    )
    writer = BackgroundWriter(RunWriter.create(Path(tempfile.mkdtemp(dir=folder)), header))
    run(plan, backend, writer, operator=AutomaticOperator())


def ending(seed: int, folder: Path) -> tuple[float, int]:
    """s from a signal to the last output off, and the number of outputs that were switched on again."""
    clock = real_clock()
    edges: list[tuple[float, tuple[bool, bool, bool]]] = []
    before = EmulatedBoard._switch  # noqa: SLF001 - the pins are the witness

    def switch(board: EmulatedBoard, at: float, pin: tuple[str, int]) -> None:
        edges.append((clock.now(), board.outputs))
        before(board, at, pin)

    sent: list[float] = []

    def press() -> None:
        sent.append(clock.now())
        os.kill(os.getpid(), signal.SIGINT)

    rig = load_rig(shipped("rigs", "hl32-bench-uno.yaml"))
    with patch.object(EmulatedBoard, "_switch", switch):
        backend = create_backend(rig, "emulated", clock, {"plant": "roles", "noise": "off", "seed": 1})
        backend.open()
        timer = threading.Timer(random.Random(seed).uniform(0.8, 2.0), press)
        timer.start()
        carry_out(HEATING if seed % 2 else MOVING, rig, backend, folder)
    after = [(at, levels) for at, levels in edges if at > sent[0]]
    dark = next((index for index, (_, levels) in enumerate(after) if not any(levels)), len(after))
    switched_on = sum(any(levels) for _, levels in after[dark:])
    return (after[-1][0] - sent[0] if after else 0.0), switched_on


def periods(folder: Path, delay: float) -> list[float]:
    """s between two samples in the loop, with a disk that needs `delay` s for each write and sync."""
    rig = load_rig(shipped("rigs", "heater-board.yaml"))
    backend = create_backend(rig, "simulated", real_clock(), {"plant": "roles"})
    backend.open()
    times: list[float] = []
    original = backend.next_sample

    def next_sample(timeout: float) -> Any:
        sample = original(timeout)
        if sample is not None:
            times.append(time.perf_counter())
        return sample

    backend.next_sample = next_sample  # type: ignore[method-assign]
    write, sync = journal.write_fully, os.fsync

    def slowly(action: Any) -> Any:
        def act(*given: Any) -> Any:
            time.sleep(delay)
            return action(*given)

        return act

    text = f"procedure: x\nsteps:\n  - record: {{name: r, rate: {RATE:g} Hz}}\n    do: [wait: {LASTS:g} s]\n"
    with (
        patch.object(journal, "write_fully", slowly(write)),
        patch.object(log, "write_fully", slowly(write)),
        patch.object(os, "fsync", slowly(sync)),
    ):
        carry_out(text, rig, backend, folder)
    return [later - earlier for earlier, later in pairwise(times[10:])]


def percentile(values: list[float], share: float) -> float:
    return statistics.quantiles(values, n=100, method="inclusive")[round(share * 100) - 1]


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = [ending(seed, folder) for seed in range(ENDINGS)]
        usual, slow = periods(folder, 0.0), periods(folder, 1.0)
    delays = [1e3 * delay for delay, _ in found]
    facts = {
        "endings": ENDINGS,
        "signal_to_off_median_ms": round(statistics.median(delays), 1),
        "signal_to_off_p99_ms": round(percentile(delays, 0.99), 1),
        "on_again_after_all_were_off": sum(count for _, count in found),
        "period_p99_ms": round(1e3 * percentile(usual, 0.99), 2),
        "period_p99_slow_disk_ms": round(1e3 * percentile(slow, 0.99), 2),
        "period_longest_slow_disk_ms": round(1e3 * max(slow), 2),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    }
    rows = [(key, str(value)) for key, value in facts.items()]
    table("Endings and a slow disk", [("what", "value"), *rows])
    keep(Path(__file__).parent, facts)


if __name__ == "__main__":
    main()
