"""Record the same samples with rigctl and with `csv.writer`: ``python -m benchmarks.journal``."""

from __future__ import annotations

import csv
import random
import tempfile
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from benchmarks.record import keep, median_seconds, table
from rigctl.dataset import RunHeader, RunWriter, Source, open_run
from rigctl.rig import Layout

ROWS = 200_000
EVENTS = 50_000
LAYOUT = Layout(
    channels=("oil_temperature", "supply_pressure", "position"),
    commands=("heater", "valve", "relief_valve"),
    units=("s", "1", "degC", "bar", "mm", "1", "1", "bar"),
)
Row = tuple[float, ...]


def adc_rows() -> list[Row]:
    """Eight floats per row: noisy channels with 10-bit converters, and a clock in microseconds."""
    chance = random.Random(1)

    def converted(value: float, span: float) -> float:
        return round(value / span * 1023) / 1023 * span

    return [
        (
            round(row * 0.01 + chance.gauss(0.0, 5e-6), 6),
            0.0,
            273.15 + round((40.0 + chance.gauss(0.0, 0.2)) * 4) / 4,
            converted(30e5 + chance.gauss(0.0, 2e4), 100e5),
            converted(0.1 + 0.05 * np.sin(row / 300) + chance.gauss(0.0, 2e-4), 0.3),
            float(row // 3000 % 2),
            float(row // 700 % 3 - 1),
            30e5,
        )
        for row in range(ROWS)
    ]


def begin(folder: Path) -> RunWriter:
    header = RunHeader("20260101-000000-x", Source("x"), Source("x"), LAYOUT, datetime.now(UTC))
    writer = RunWriter.create(Path(tempfile.mkdtemp(dir=folder)), header)
    writer.open_record(0.0, "x", {}, "1", 100.0)
    return writer


def rate(folder: Path, count: int, work: Callable[[RunWriter], object]) -> float:
    """Rows per second of a writer, flushed to the system, without its creation."""
    writers: Iterable[RunWriter] = iter([begin(folder) for _ in range(6)])

    def once() -> None:
        writer = next(writers)  # type: ignore[call-overload]
        work(writer)
        writer.flush()

    return count / median_seconds(once)


def csv_rate(folder: Path, rows: list[Row]) -> float:
    def once() -> None:
        with (folder / "rows.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            for row in rows:
                writer.writerow(row)

    return len(rows) / median_seconds(once)


def write_rows(rows: list[Row]) -> Callable[[RunWriter], None]:
    def work(writer: RunWriter) -> None:
        append = writer.append
        for row in rows:
            append(row)

    return work


def write_events(writer: RunWriter) -> None:
    for number in range(EVENTS):
        writer.event(0.01 * number, "step", path="1/2/heat", message="heat to 40 degC", state="done")


def main() -> None:
    rows = adc_rows()
    block = np.array(rows)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        by_csv = csv_rate(folder, rows)
        by_row = rate(folder, ROWS, write_rows(rows))
        by_block = rate(folder, 10 * ROWS, lambda writer: [writer.append_block(block) for _ in range(10)])
        event_time = 1e6 / rate(folder, EVENTS, write_events)
        writer = begin(folder)
        writer.append_block(block)
        writer.close_record(2000.0, "complete")
        size = (writer.close("finished") / "samples.parquet").stat().st_size / ROWS
        csv_size = (folder / "rows.csv").stat().st_size / ROWS
        open_time = median_seconds(lambda: open_run(writer.folder).samples())
    table(
        f"{ROWS} rows of 8 floats",
        [
            ("", "rigctl", "csv.writer", "ratio"),
            ("row by row, k rows/s", f"{by_row / 1e3:.0f}", f"{by_csv / 1e3:.0f}", f"{by_row / by_csv:.1f}"),
            (
                "in blocks, k rows/s",
                f"{by_block / 1e3:.0f}",
                f"{by_csv / 1e3:.0f}",
                f"{by_block / by_csv:.1f}",
            ),
            ("on disk, bytes a row", f"{size:.1f}", f"{csv_size:.1f}", f"{csv_size / size:.1f}"),
            ("one event, us", f"{event_time:.2f}", "", ""),
            ("read back, k rows/s", f"{ROWS / open_time / 1e3:.0f}", "", ""),
        ],
    )
    results = {
        "rows_per_second": {"row_by_row": by_row, "blocks": by_block, "csv_writer": by_csv},
        "ratio_to_csv": {"row_by_row": by_row / by_csv, "blocks": by_block / by_csv},
        "bytes_per_row": {"samples.parquet": size, "csv": csv_size},
        "microseconds_per_event": event_time,
        "rows_per_second_read": ROWS / open_time,
    }
    print(keep(Path(__file__).parent, results, "numpy", "pyarrow"))


if __name__ == "__main__":
    main()
