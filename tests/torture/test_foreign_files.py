from __future__ import annotations

import sys
from pathlib import Path

import pytest

if sys.platform == "win32":
    pytest.skip("a copy of a process is POSIX", allow_module_level=True)

from torture.foreign_files import torture


def test_damaged_files_of_another_program_are_a_run_or_one_message(tmp_path: Path) -> None:
    found = torture(tmp_path, 32, seed=1, kinds=("mf4",))["mf4"]
    assert found["failures"] == []
    assert found["read"] + found["refused"] == 32
    assert found["read"] > 3
