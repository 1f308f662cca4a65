"""Many runs: ``python -m benchmarks.catalogue [--runs 100000] [--rows 1000000]``.

Writes runs in folders by day, each with its own ``run.json`` and a hard link to one ``samples.parquet``;
measures the time to build the index, and whole commands. The filter is timed on an index with the given
number of rows, copied from these.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sqlite3
import sys
import tempfile
import time
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from benchmarks.journal.__main__ import LAYOUT
from benchmarks.record import command_seconds, keep, median_seconds, table
from rigctl.dataset import RunHeader, RunWriter, Source, list_runs
from rigctl.dataset.day_folders import shard_of
from rigctl.dataset.index.file import index_path
from rigctl.dataset.index.schema import INNER_COLUMNS, RUN_COLUMNS, quoted
from rigctl.dataset.index.select import select
from rigctl.dataset.run_json import checksum, read_info

BEGAN = datetime(2020, 1, 1, tzinfo=UTC)
RIGS = ("bench A", "bench B", "bench C")
LINKS = 30_000
FILTER = (
    "rig = 'bench B' AND started >= '2020-06' AND "
    "id IN (SELECT run FROM channels WHERE name = 'oil_temperature' AND high > 40)"
)


def write_runs(runs: Path, count: int) -> None:
    """Folders as written by `RunWriter`, as far as the catalogue reads them."""
    header = RunHeader("20200101-000000-x", Source("stroke"), Source("bench A"), LAYOUT, BEGAN)
    writer = RunWriter.create(runs.parent / "one", header)
    writer.open_record(0.0, "x", {}, "1", 100.0)
    time_s = np.arange(600) * 0.01
    writer.append_block(np.column_stack([time_s, np.zeros(600), *(300 + time_s + c for c in range(6))]))
    writer.close_record(6.0, "complete")
    one = writer.close("finished")
    info, samples = read_info(one), one / "samples.parquet"
    for number in range(count):
        began = BEGAN + timedelta(minutes=3 * number)
        run_id = f"{began:%Y%m%d-%H%M%S}-stroke"
        folder = runs / str(shard_of(run_id)) / run_id
        folder.mkdir(parents=True)
        info |= {"id": run_id, "started": began.isoformat(), "records": number % 40}
        info["rig"] = {**info["rig"], "name": RIGS[number % len(RIGS)]}
        text = json.dumps({**info, "checksum": checksum(info)}, indent=2)
        (folder / "run.json").write_text(text, encoding="utf-8")
        if number % LINKS == 0:  # the file system limits the number of links
            samples = folder / "samples.parquet"
            shutil.copy(one / "samples.parquet", samples)
        else:
            os.link(samples, folder / "samples.parquet")


def filter_seconds(index: Path, rows: int) -> tuple[float, int]:
    """Time of the filter on an index extended with copies to some number of rows, s."""
    with closing(sqlite3.connect(index)) as base:
        (there,) = base.execute("SELECT max(key) FROM run").fetchone()
        rest = [name for name in (*RUN_COLUMNS, *INNER_COLUMNS) if name != "shard"]
        for copy in range(1, max(rows // there, 1)):
            shift = copy * there
            base.execute(
                f"INSERT INTO run (key, shard, {quoted(rest)}) "
                f"SELECT key + ?, shard || ?, {quoted(rest)} FROM run WHERE key <= ?",
                [shift, f"/{copy}", there],
            )
            base.execute(
                "INSERT INTO channel SELECT name, run + ?, low, high FROM channel WHERE run <= ?",
                [shift, there],
            )
        base.commit()
        (count,) = base.execute("SELECT count(*) FROM run").fetchone()
        return median_seconds(lambda: select(base, FILTER, 100)), count


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=20_000)
    arguments.add_argument("--rows", type=int, default=1_000_000)
    asked = arguments.parse_args()
    runs_command = [sys.executable, "-m", "rigctl", "runs"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["RIGCTL_CACHE_DIR"] = str(folder / "cache")
        runs = folder / "runs"
        write_runs(runs, asked.runs)
        began, busy = time.perf_counter(), time.process_time()
        list_runs(runs, last=1)
        rebuild = asked.runs / (time.perf_counter() - began)
        of_processor = asked.runs / (time.process_time() - busy)
        for shard in runs.iterdir():
            os.utime(shard, (1e9, 1e9))
        os.utime(runs, (1e9, 1e9))
        list_runs(runs, last=1)
        listed = command_seconds([*runs_command, "list"], cwd=folder)
        filtered = command_seconds([*runs_command, "list", "--where", FILTER], cwd=folder)
        everything = command_seconds([*runs_command, "list", "--json"], cwd=folder)
        started = command_seconds([*runs_command, "--help"], cwd=folder)
        asked_of, rows = filter_seconds(index_path(runs), asked.rows)
    results = {
        "runs": asked.runs,
        "rebuild [runs/s]": rebuild,
        "rebuild [runs/s of one processor]": of_processor,
        "rigctl runs list [s]": listed,
        "rigctl runs list --where [s]": filtered,
        "rigctl runs list --json, all [s]": everything,
        "rigctl runs --help [s]": started,
        "index rows": rows,
        "filter, newest 100 [s]": asked_of,
    }
    shown = [("what", "value"), *((key, f"{value:.4g}") for key, value in results.items())]
    table("the catalogue", shown)
    keep(Path(__file__).parent, results)


if __name__ == "__main__":
    main()
