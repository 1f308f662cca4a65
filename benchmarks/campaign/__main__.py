"""Whole commands: ``python -m benchmarks.campaign``.

The published campaign on the simulated bench compared with bench time, and its page.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.record import command_seconds, keep, table
from rigctl.dataset import open_run

HERE = Path(__file__).parent
RUNS = 5


def main() -> None:
    command = str(Path(sys.executable).parent / "rigctl")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "bench"
        subprocess.run([command, "init", str(folder)], check=True, capture_output=True)
        simulate = [command, "simulate", "procedures/campaign.yaml"]
        simulated = command_seconds(simulate, RUNS, folder)
        page = command_seconds([command, "report", "latest", "-o", "page.html"], RUNS, folder)
        size = (folder / "page.html").stat().st_size
        run = open_run("latest", folder / "runs")
        bench_time, rows, records = float(run.info["duration"]), int(run.info["rows"]), len(run.records)
    table(
        f"The published campaign: {records} records, {rows} samples, {bench_time:.0f} s of bench time",
        [
            ("", "seconds", "beside"),
            (
                "rigctl simulate",
                f"{simulated:.2f}",
                f"{bench_time / simulated:.0f} times as fast as the bench",
            ),
            ("rigctl report", f"{page:.2f}", f"a page of {size / 1e6:.1f} MB"),
        ],
    )
    results = {
        "simulate_s": simulated,
        "bench_s": bench_time,
        "rows": rows,
        "report_s": page,
        "page_bytes": size,
    }
    print(f"\nkept in {keep(HERE, results, 'numpy', 'numba', 'pyarrow', 'typer')}")


if __name__ == "__main__":
    main()
