from __future__ import annotations

from pathlib import Path

from torture.broken_files import torture


def test_randomly_broken_files_are_read_or_refused_with_one_message(tmp_path: Path) -> None:
    found = torture(tmp_path, 250, seed=1)
    assert found.refused > 100
    assert found.read > 10
