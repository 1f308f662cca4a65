"""One run in real time that records when each of its samples was stored.

``python -m benchmarks.serve.watched_run SECONDS OUTPUT``, in a folder that holds the rig: the child of
`benchmarks.serve`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rigctl.dataset.recording.disk_thread import BackgroundWriter
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import load_rig
from rigctl.runner.bench_access import clock_for
from rigctl.runner.launch import Launch, launch
from rigctl.runner.operators.automatic_operator import AutomaticOperator

PROCEDURE = """\
procedure: watched
rig: rig.yaml
steps:
  - record: {{name: long, rate: 100 Hz}}
    do:
      - wait: {seconds} s
"""


def main() -> None:
    seconds, output = float(sys.argv[1]), Path(sys.argv[2])
    handed: list[tuple[float, float]] = []
    append = BackgroundWriter.append

    def noted(self: BackgroundWriter, row: Sequence[float]) -> None:
        handed.append((row[0], time.time()))
        append(self, row)

    BackgroundWriter.append = noted  # type: ignore[method-assign]
    procedure = parse_procedure(PROCEDURE.format(seconds=seconds), Path("watched.yaml"))
    plan = expand(procedure, load_rig(Path("rig.yaml")), {})
    how = Launch(
        runs=Path("runs"),
        operator=AutomaticOperator(),
        backend="simulated",
        clock=clock_for("1x", "simulated"),
        exclusive=False,
    )
    launch(plan, how)
    np.save(output, np.array(handed))


if __name__ == "__main__":
    main()
