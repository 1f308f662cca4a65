"""Changed files of loggers are read as a strict reader reads them, or refused; `make torture` has more."""

from __future__ import annotations

from pathlib import Path

from torture import logger_files


def test_changed_files_of_loggers_are_read_right_or_refused(tmp_path: Path) -> None:
    found = logger_files.torture(tmp_path, 240, 0)
    assert not found.failures
    assert found.read > 60
    assert found.refused > 60
