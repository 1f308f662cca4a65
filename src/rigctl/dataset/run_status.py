"""The status of a run."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigctl.dataset import run_json
from rigctl.dataset.recording import journal
from rigctl.dataset.recording.writer_lock import in_progress


def status_of(folder: Path, info: Mapping[str, Any]) -> str:
    """Return the run's status, distinguishing a run in progress from an abandoned one."""
    status = str(info["status"])
    if status != run_json.RUNNING and not os.path.exists(f"{folder}{os.sep}{journal.NAME}"):  # noqa: PTH110
        return status
    return run_json.RUNNING if in_progress(folder) else "unclosed"
