"""rigctl, measured like its peers: steps with the whole runner, rows to journal and Parquet."""

from __future__ import annotations

import tempfile
from datetime import UTC, datetime
from pathlib import Path

from workload import CHANNELS, answer, row, seconds

import rigctl
from rigctl.dataset import RunHeader, RunWriter, Source
from rigctl.files.shipped import shipped
from rigctl.rig import Layout

STEPS = """\
procedure: steps
rig: {rig}
steps:
  - repeat: {count}
    do:
      - {step}
"""
KINDS = {
    "set an output": "set: {valve: neutral}",
    "wait for a true condition": "wait: {until: position < 1 m, timeout: 1 s}",
}


def steps(count: int) -> dict[str, float]:
    """With events, interlocks and timing for every step; start-up is subtracted with a short run."""
    folder = Path(tempfile.mkdtemp())
    found = {}
    for name, step in KINDS.items():
        times = []
        for rounds in (10, 10, count):  # the first one triggers late imports
            file = folder / "steps.yaml"
            file.write_text(
                STEPS.format(rig=shipped("rigs", "hl32-bench.yaml"), count=rounds, step=step),
                encoding="utf-8",
            )
            times.append(seconds(lambda file=file: rigctl.simulate(file, runs=folder)))
        found[name] = (times[2] - times[1]) / (count - 10)
    return found


def rows(count: int, folder: Path) -> float:
    """Row by row to the journal, then to Parquet; everything is timed."""
    layout = Layout(channels=CHANNELS, commands=(), units=("s", "1", *("1" for _ in CHANNELS)))
    header = RunHeader("20260101-000000-rows", Source("rows"), Source("rows"), layout, datetime.now(UTC))
    writer = RunWriter.create(folder, header)

    def work() -> None:
        for i in range(count):
            writer.append((i * 0.01, -1.0, *row(i)))
        writer.close("finished")

    return seconds(work)


answer(steps, rows)
