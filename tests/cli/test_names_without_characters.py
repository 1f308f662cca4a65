"""Names with bytes that are no UTF-8, which files may have on POSIX, and arguments with them."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

from commands import call, told
from rigctl.cli.commands.init import create_project
from rigctl.errors import RigctlError


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_procedure_in_a_folder_without_a_readable_name_is_carried_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It used to end with a traceback as soon as the run's first file was written."""
    create_project(tmp_path / "bench")
    monkeypatch.chdir(tmp_path / "bench")
    folder = os.fsdecode(b"bad\xff")
    Path(folder).mkdir()
    shutil.copy("procedures/quick-check.yaml", f"{folder}/q.yaml")
    told("simulate", f"{folder}/q.yaml")
    assert "bad?/q.yaml" in told("runs", "show", "latest")
    told("runs", "verify", "latest")
    for words in (["runs", "sql", f"SELECT '{folder}'"], ["runs", "list", "--where", f"id = '{folder}'"]):
        assert isinstance(call(*words).exception, RigctlError)
