from __future__ import annotations

import sys
from pathlib import Path

import pytest

if sys.platform == "win32":
    pytest.skip("a copy of a process is POSIX", allow_module_level=True)

from torture.foreign_files import torture


def test_damaged_files_of_other_programs_are_a_run_or_one_message(tmp_path: Path) -> None:
    found = torture(tmp_path, 80, seed=1, kinds=("csv", "mf4"))
    for kind in ("csv", "mf4"):
        assert found[kind]["failures"] == []
        assert found[kind]["read"] + found[kind]["refused"] == 40
        assert found[kind]["read"] > 3
