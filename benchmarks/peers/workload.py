"""The workload of every peer: eight floats per row, with enough digits for a fair cost of text formats."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

CHANNELS = tuple(f"ch{k}" for k in range(8))


def row(i: int) -> tuple[float, ...]:
    """Eight channels with full mantissas."""
    x = i * 0.001
    return (x, 20.0 + x / 7, 100.0 - x / 3, x * x / 11, 1.0 / (1.0 + x), x / 13, x / 17, x / 19)


def bytes_under(folder: Path) -> int:
    """Size of everything a peer wrote."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def answer(steps: Callable[[int], dict[str, float]], rows: Callable[[int, Path], float]) -> None:
    """The command line of a peer's script: ``steps N`` or ``rows N FOLDER``; prints one JSON line."""
    kind, count = sys.argv[1], int(sys.argv[2])
    folder = Path(sys.argv[3]) if len(sys.argv) > 3 else None
    sys.argv = sys.argv[:1]  # peers that read the command line themselves must not see ours
    if kind == "steps" or folder is None:
        print(json.dumps({name: value * 1e6 for name, value in steps(count).items()}))
        return
    folder.mkdir(parents=True, exist_ok=True)
    duration = rows(count, folder)
    print(json.dumps({"rows_per_s": count / duration, "bytes_per_row": bytes_under(folder) / count}))
