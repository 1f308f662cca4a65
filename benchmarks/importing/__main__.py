"""Import a million rows in every format, and ten million: ``python -m benchmarks.importing``.

Each import is a separate process, so that its memory can be measured (on Linux). It is compared with
`pandas.read_csv`, which only reads the same file.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa

from benchmarks.record import keep, table
from rigctl.dataset.exporting import export

ROWS = 1_000_000
MANY = 10_000_000
PER_RECORD = 375
RIG = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"
FORMATS = ("csv", "parquet", "tdms", "mf4", "mat")

_IMPORT = """
import json, resource, sys, time
from pathlib import Path
start = time.perf_counter()
from rigctl.dataset.importing import import_file
from rigctl.rig import load_rig
done = import_file(Path(sys.argv[1]), load_rig(Path(sys.argv[2])), Path(sys.argv[3]))
seconds = time.perf_counter() - start
status = Path("/proc/self/status").read_text()
peak = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM"))
apart = resource.getrusage(resource.RUSAGE_CHILDREN)  # readers of foreign formats
peak = max(peak, apart.ru_maxrss)
computing = time.process_time() + apart.ru_utime + apart.ru_stime
print(json.dumps([seconds, computing, peak / 1024, done.records, done.rows]))
"""


def blocks(rows: int, *, records: bool) -> Iterator[pa.Table]:
    """A campaign of short strokes, or one record as long as the file."""
    rng = np.random.default_rng(1)
    fields = [
        pa.field("time", pa.float64(), metadata={"unit": "s"}),
        pa.field("record", pa.int32()),
        pa.field("valve", pa.float64(), metadata={"unit": "1"}),
        pa.field("oil_temperature", pa.float64(), metadata={"unit": "degC"}),
        pa.field("supply_pressure", pa.float64(), metadata={"unit": "bar"}),
        pa.field("relief_valve", pa.float64(), metadata={"unit": "bar"}),
        pa.field("position", pa.float64(), metadata={"unit": "mm"}),
    ]
    for start in range(0, rows, ROWS):
        row = np.arange(start, min(start + ROWS, rows))
        record = row // PER_RECORD if records else np.zeros_like(row)
        time_of = row % PER_RECORD if records else row
        columns = [
            (time_of * 0.01).round(2),
            record.astype(np.int32),
            (row % PER_RECORD > 20).astype(float),
            (20.0 + record % 7 * 10 + rng.normal(0.0, 0.1, row.size)).round(3),
            (30.0 + rng.normal(0.0, 0.08, row.size)).round(4),
            20.0 + record % 4 * 10,
            (100.0 + rng.normal(0.0, 0.1, row.size)).round(4),
        ]
        yield pa.table(columns, schema=pa.schema(fields))


def write(path: Path, rows: int, *, records: bool = True) -> None:
    from importlib import import_module

    whole = pa.concat_tables(blocks(rows, records=records))
    names = ["stroke"] * (int(whole["record"][-1].as_py()) + 1)
    module = import_module(f"rigctl.dataset.exporting.{export.FORMATS[path.suffix]}")
    module.write(path, whole, names, "samples")


def bring_in(path: Path, folder: Path) -> tuple[float, float, float, int, int]:
    """Wall and CPU time, s, peak memory, MB, records and rows of one import in a separate process."""
    command = [sys.executable, "-c", _IMPORT, str(path), str(RIG), str(folder)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds, computing, megabytes, records, rows = json.loads(done.stdout)
    return seconds, computing, megabytes, records, rows


def pandas_seconds(path: Path) -> float:
    import pandas as pd

    start = time.perf_counter()
    pd.read_csv(path)
    return time.perf_counter() - start


def main() -> None:
    results: dict[str, dict[str, float]] = {}
    rows = [
        (
            "file",
            "rows",
            "records",
            "seconds",
            "of processor",
            "MB of memory",
            "MB of file",
            "to pandas.read_csv",
        )
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        jobs = [(ending, ROWS, True) for ending in FORMATS]
        jobs += [("csv", MANY, True), ("csv", MANY, False), ("parquet", MANY, True)]
        for ending, count, records in jobs:
            path = folder / f"{count}-{'records' if records else 'one'}.{ending}"
            write(path, count, records=records)
            repeats = [bring_in(path, folder / "runs") for _ in range(3 if count == ROWS else 1)]
            seconds, computing, megabytes, found, read = sorted(repeats)[len(repeats) // 2]
            if read != count:
                raise SystemExit(f"{path.name}: {read} rows instead of {count}")
            ratio = seconds / pandas_seconds(path) if ending == "csv" and count == ROWS else None
            size = path.stat().st_size / 1e6
            path.unlink()
            results[path.name] = {
                "seconds": seconds,
                "processor_seconds": computing,
                "megabytes": megabytes,
                "records": found,
            }
            if ratio is not None:
                results[path.name]["ratio_to_pandas_read_csv"] = ratio
            shown = (
                f"{seconds:.2f}",
                f"{computing:.2f}",
                f"{megabytes:.0f}",
                f"{size:.0f}",
                f"{ratio:.1f}" if ratio else "",
            )
            rows.append((path.name, str(count), str(found), *shown))
            print(
                f"  {path.name}: {seconds:.2f} s, {computing:.2f} s of processor, {megabytes:.0f} MB",
                flush=True,
            )
    table("import, a process each; median of three at a million rows", rows)
    print(keep(Path(__file__).parent, results, "numpy", "pyarrow", "pandas", "npTDMS", "asammdf", "scipy"))


if __name__ == "__main__":
    main()
