"""``python -m benchmarks.report``: a page about 28 records and 65 100 samples, side by side with plotly's."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from benchmarks.record import command_seconds, keep, median_seconds, table

HERE = Path(__file__).parent
TARGET = 3.0  # s
sys.path.insert(0, str(HERE.parents[1] / "tests"))  # the synthetic campaign is part of the tests


def main() -> None:
    """Measure, print and keep."""
    from benchmarks.report.plotly_writer import write_page
    from report.made_campaign import Campaign, make_campaign
    from rigctl.dataset import open_run
    from rigctl.report import write_report

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run_folder = make_campaign(folder / "runs", Campaign(idle_rows=1950))
        page, other = folder / "page.html", folder / "plotly.html"
        ours = median_seconds(lambda: write_report([open_run(run_folder)], page))
        theirs = median_seconds(lambda: write_page(open_run(run_folder), other), runs=3)
        command = [sys.executable, "-m", "rigctl", "report", str(run_folder), "-o", str(page)]
        whole = command_seconds(command, runs=3)
        size, other_size = page.stat().st_size / 1e6, other.stat().st_size / 1e6
    table(
        "A page about 28 records, 65 100 samples, 6 signals",
        [
            ("", "seconds", "megabytes", "ratio of times", "ratio of sizes"),
            ("rigctl report", f"{ours:.2f}", f"{size:.2f}", "1", "1"),
            (
                "plotly to_html, all samples",
                f"{theirs:.2f}",
                f"{other_size:.2f}",
                f"{theirs / ours:.1f}",
                f"{other_size / size:.1f}",
            ),
            ("rigctl report, whole command", f"{whole:.2f}", f"{size:.2f}", f"{whole / ours:.1f}", "1"),
        ],
    )
    results = {
        "rigctl_seconds": ours,
        "rigctl_megabytes": size,
        "rigctl_command_seconds": whole,
        "plotly_seconds": theirs,
        "plotly_megabytes": other_size,
    }
    print(f"\nkept in {keep(HERE, results, 'plotly', 'jinja2', 'pyarrow')}")
    print(f"target of the whole command: {TARGET:g} s, {'met' if whole <= TARGET else 'missed'}")


if __name__ == "__main__":
    main()
