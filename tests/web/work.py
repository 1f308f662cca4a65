"""Work for other processes, which find it by the name of this module."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from rigctl.errors import RigctlError
from rigctl.web.jobs import Report


def measured(report: Report, folder: str) -> dict[str, object]:
    report("half", 0.5, {"so far": 1})
    return {"here": Path.cwd() == Path(folder), "nan": float("nan")}


def mistaken(report: Report) -> None:
    raise RigctlError("no such channel", value="x", nearest="y")


def faulty(report: Report) -> None:
    raise ZeroDivisionError


def dying(report: Report) -> None:
    os.kill(os.getpid(), signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)


def endless(report: Report) -> None:
    report("begun")
    time.sleep(600)
