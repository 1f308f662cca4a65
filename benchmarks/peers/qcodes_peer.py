"""qcodes: a sweep's points, and its SQLite store row by row (QCODES_BATCH rows at a time)."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import qcodes
from qcodes.dataset import (
    LinSweep,
    Measurement,
    dond,
    initialise_or_create_database_at,
    load_or_create_experiment,
)
from workload import CHANNELS, answer, row, seconds

BATCH = int(os.environ.get("QCODES_BATCH", "1"))


def steps(count: int) -> dict[str, float]:
    initialise_or_create_database_at(str(Path(tempfile.mkdtemp()) / "steps.db"))
    load_or_create_experiment("bench", "bench")
    drive = qcodes.parameters.Parameter("drive", get_cmd=None, set_cmd=None, initial_value=0.0)
    reading = qcodes.parameters.Parameter("reading", get_cmd=lambda: 1.0)

    def sweep():
        dond(LinSweep(drive, 0, 1, count, 0), reading, show_progress=False, do_plot=False)

    return {
        "set": seconds(lambda: [drive.set(float(i)) for i in range(count)]) / count,
        "sweep point": seconds(sweep) / count,
    }


def rows(count: int, folder: Path) -> float:
    initialise_or_create_database_at(str(folder / "rows.db"))
    load_or_create_experiment("bench", "bench")
    measurement = Measurement()
    for name in CHANNELS:
        measurement.register_custom_parameter(name, paramtype="array" if BATCH > 1 else "numeric")

    def work():
        with measurement.run() as saver:
            for i in range(0, count, BATCH):
                block = np.array([row(j) for j in range(i, i + BATCH)]).T if BATCH > 1 else row(i)
                saver.add_result(*zip(CHANNELS, block, strict=True))

    return seconds(work)


answer(steps, rows)
