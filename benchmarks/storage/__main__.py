"""Runs in object storage compared with runs in a folder: ``python -m benchmarks.storage [--runs 20]``.

The storage is moto's S3 server in another process on this computer: the figures do not include a network or a
real store.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import boto3
import numpy as np

from benchmarks.journal.__main__ import LAYOUT
from benchmarks.record import keep, median_seconds, table
from rigctl.dataset import RunHeader, RunWriter, Source, list_runs, open_run
from rigctl.dataset.index.file import stored_index_path
from rigctl.dataset.storage import Store, upload

SERVER = """
from moto.server import ThreadedMotoServer
running = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
running.start()
print(running.get_host_and_port()[1], flush=True)
input()
"""
ROWS = 100_000


def write_run(runs: Path, number: int) -> Path:
    """Eight columns of incompressible noise: the worst case."""
    began = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(minutes=number)
    header = RunHeader(f"{began:%Y%m%d-%H%M%S}-x", Source("x"), Source("x"), LAYOUT, began)
    writer = RunWriter.create(runs, header)
    writer.open_record(0.0, "x", {}, "1", 100.0)
    noise = np.random.default_rng(number).normal(300.0, 1.0, (ROWS, 6))
    writer.append_block(np.column_stack([np.arange(ROWS) * 0.01, np.zeros(ROWS), noise]))
    writer.close_record(ROWS * 0.01, "complete")
    return writer.close("finished")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=10)
    asked = arguments.parse_args()
    with (
        tempfile.TemporaryDirectory() as name,
        subprocess.Popen(
            [sys.executable, "-c", SERVER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as server,
    ):
        assert server.stdout is not None
        endpoint = f"http://127.0.0.1:{server.stdout.readline().strip()}"
        os.environ |= {
            "AWS_ENDPOINT_URL": endpoint,
            "AWS_ACCESS_KEY_ID": "x",
            "AWS_SECRET_ACCESS_KEY": "x",
            "AWS_DEFAULT_REGION": "us-east-1",
        }
        boto3.client("s3", endpoint_url=endpoint).create_bucket(Bucket="lab")
        store, runs = Store("s3://lab/runs"), Path(name) / "runs"
        folders = [write_run(runs, number) for number in range(asked.runs)]
        size = sum(file.stat().st_size for file in folders[0].iterdir()) / 1e6
        began = time.perf_counter()
        for folder in folders:
            upload(folder, store)
        sent = (time.perf_counter() - began) / asked.runs
        address = f"{store.address}/{folders[0].name}"
        os.environ["RIGCTL_CACHE_DIR"] = str(Path(name) / "cache")

        def anew() -> None:
            stored_index_path(store.address).unlink(missing_ok=True)
            list_runs(store.address)

        results = {
            "a run [MB]": size,
            "send a run, read it back and compare [s]": sent,
            "find that a run is there already [s]": median_seconds(lambda: upload(folders[0], store)),
            "list the runs for the first time, for each [ms]": 1e3 * median_seconds(anew) / asked.runs,
            "list them again, for each [ms]": 1e3
            * median_seconds(lambda: list_runs(store.address))
            / asked.runs,
            "one column, from storage [s]": median_seconds(lambda: open_run(address).samples(["position"])),
            "one column, from the folder [s]": median_seconds(
                lambda: open_run(folders[0]).samples(["position"])
            ),
            "all columns, from storage [s]": median_seconds(lambda: open_run(address).samples()),
            "all columns, from the folder [s]": median_seconds(lambda: open_run(folders[0]).samples()),
        }
        server.kill()
    table("runs in storage", [("what", "value"), *((k, f"{v:.3g}") for k, v in results.items())])
    keep(Path(__file__).parent, results, "s3fs", "moto")


if __name__ == "__main__":
    main()
