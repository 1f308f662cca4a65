"""What a command shows while its run is carried out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigctl.cli.main import app

ROOT = Path(__file__).parents[2]


def test_progress_goes_to_stderr_and_the_result_to_stdout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["simulate", str(ROOT / "procedures" / "quick-check.yaml"), "--seed", "3", "--json"]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert json.loads(result.stdout)["status"] == "finished"
    states = [line.split("  ", 1)[1] for line in result.stderr.splitlines() if "%" not in line]
    assert states[:2] == ["arming", "running"]
    assert states[-1] == "finished"
