from __future__ import annotations

import sys
from pathlib import Path

import pytest

if sys.platform == "win32":
    pytest.skip("a copy of a process is POSIX", allow_module_level=True)

from torture.foreign_files import torture


def test_damaged_files_of_other_programs_are_imported_or_refused_with_one_message(tmp_path: Path) -> None:
    found = torture(tmp_path, 20, seed=1, kinds=("mf4",))["mf4"]
    assert found["failures"] == []
    assert found["read"] + found["refused"] == 20
    assert found["read"] > 2
