"""Work for other processes: functions that they can import."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from rigctl.tasks import seed_of


def drawn(piece: int) -> tuple[int, int]:
    return piece, seed_of(7, "piece", piece)


def refused(piece: int) -> int:
    if piece == 3:
        raise ValueError("piece 3")
    return piece


def deadly(folder: str, times: int, piece: int) -> int:
    """Piece 5 kills its worker process the given number of times."""
    if piece == 5:
        for number in range(times):
            mark = Path(folder) / f"death-{number}"
            if not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    return piece * piece


def slow(folder: str, piece: int) -> tuple[int, int]:
    """Writes down which process works on which piece."""
    with (Path(folder) / "begun").open("a", encoding="utf-8") as file:
        file.write(f"{piece} {os.getpid()}\n")
    time.sleep(0.05)
    return piece, seed_of(7, "piece", piece)
