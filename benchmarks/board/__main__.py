"""The board and its line against their requirements: ``python -m benchmarks.board``.

The firmware runs on the emulated microcontroller. Figures that depend only on it and on the line are measured
in board time, faster than real time: `results.json`. Those that also depend on the host, round trips of
queries and the arrival of samples, need real time: ``python -m benchmarks.board --real-time`` runs a host
and an emulated board as two processes on a pseudo-terminal for ten minutes, into `real_time.json`, and
``--one-process`` leaves the terminal driver out, into `one_process.json`.

The emulator sends a parity bit that the real board does not: a character takes 11 bits, not 10.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from types import ModuleType

from benchmarks.board import fast, one_process, real_time
from benchmarks.record import keep, table

FOLDER = Path(__file__).parent


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.board")
    parser.add_argument("--real-time", action="store_true", help="two processes, ten minutes")
    parser.add_argument("--one-process", action="store_true", help="arrivals alone")
    parser.add_argument("--minutes", type=float, default=10.0, help="of board time (10)")
    given = parser.parse_args()
    name: str = "results"
    measured: ModuleType = fast
    if given.real_time:
        name, measured = "real_time", real_time
    elif given.one_process:
        name, measured = "one_process", one_process
    rows, results = measured.measure(given.minutes * 60.0)
    table(measured.TITLE, [("", "reached", "asked"), *rows])
    print(f"\nkept in {keep(FOLDER, results, 'pyserial', 'numpy', name=name)}")


if __name__ == "__main__":
    sys.exit(main())
