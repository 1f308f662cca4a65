"""Whole commands, as a user types them: ``python -m benchmarks.campaign``.

The published campaign on the simulated bench, its page, and the overview of the commands, each beside the
time that the same would take otherwise: the bench's own time, and a bare interpreter.
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
    bare = command_seconds([sys.executable, "-c", "pass"], RUNS)
    overview = command_seconds([command, "--help"], RUNS)
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
            ("rigctl --help", f"{overview:.3f}", f"{(overview - bare) * 1e3:.0f} ms over a bare interpreter"),
        ],
    )
    results = {
        "simulate_s": simulated,
        "bench_s": bench_time,
        "rows": rows,
        "report_s": page,
        "page_bytes": size,
        "help_s": overview,
        "bare_interpreter_s": bare,
    }
    print(f"\nkept in {keep(HERE, results, 'numpy', 'numba', 'pyarrow', 'typer')}")


if __name__ == "__main__":
    main()
