"""Measures strokes until it is killed; prints which data were reported as stored.

Run as a program: ``endless_writer.py RUNS SEED``.
"""

from __future__ import annotations

import random
import sys
from pathlib import Path
from time import monotonic

from dataset.strokes import LAYOUT, STARTED, sample
from rigctl.dataset import RunHeader, RunWriter, Source


def main() -> None:
    runs, seed = Path(sys.argv[1]), int(sys.argv[2])
    chance = random.Random(seed)
    header = RunHeader("20261121-093000-stroke", Source("stroke"), Source("bench"), LAYOUT, STARTED)
    writer = RunWriter.create(runs, header)
    print(writer.folder, flush=True)  # noqa: T201 - read by the test
    count = 0
    while True:
        record = writer.open_record(float(count), "stroke", {"oil": (300.0, "degC")}, "1", 100.0)
        for _ in range(chance.randrange(1, 20000)):
            began = monotonic()
            writer.append(sample(float(count), record))
            if count % 100 == 0:
                # the wall time before the row was appended: everything older than a second must be on disk
                print(count, began, flush=True)  # noqa: T201
                writer.event(float(count), "note", n=count)
            count += 1
        writer.close_record(float(count), "complete")


if __name__ == "__main__":
    main()
