"""Program that measures briefly and closes the run with limited memory: ``RUNS BYTES``."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

from dataset.strokes import LAYOUT, STARTED, sample
from rigctl.dataset import RunHeader, RunWriter, Source
from rigctl.errors import RigctlError

ROWS = 5000


def main() -> None:
    header = RunHeader("20261121-093000-stroke", Source("stroke"), Source("bench"), LAYOUT, STARTED)
    writer = RunWriter.create(Path(sys.argv[1]), header)
    record = writer.open_record(0.0, "stroke", {}, "1", 100.0)
    for count in range(ROWS):
        writer.append(sample(float(count), record))
    writer.close_record(float(ROWS), "complete")
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = pages * resource.getpagesize() + int(sys.argv[2])
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    try:
        writer.close("finished")
    except RigctlError as error:
        print(f"refused: {error}")  # noqa: T201 - read by the test
        sys.exit(1)


if __name__ == "__main__":
    main()
