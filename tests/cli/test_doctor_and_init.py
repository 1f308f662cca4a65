"""`rigctl init` makes a project that works; `rigctl doctor` says what there is and how to get the rest."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigctl.cli import doctor
from rigctl.cli.main import app
from rigctl.errors import RigctlError


def test_init_makes_a_project_whose_procedures_are_valid(tmp_path: Path) -> None:
    made = CliRunner().invoke(app, ["init", str(tmp_path / "bench"), "--json"])
    assert made.exit_code == 0
    files = [Path(file) for file in json.loads(made.stdout)["files"]]
    procedures = [file for file in files if file.parent.name == "procedures"]
    assert len(procedures) >= 5
    for procedure in procedures:
        checked = CliRunner().invoke(app, ["check", str(procedure)])
        assert checked.exit_code == 0, (procedure.name, checked.output)


def test_init_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("mine", encoding="utf-8")
    with pytest.raises(RigctlError, match="nothing is overwritten"):
        CliRunner().invoke(app, ["init", str(tmp_path)], catch_exceptions=False)
    assert [file.name for file in tmp_path.iterdir()] == ["README.md"]
    assert (tmp_path / "README.md").read_text(encoding="utf-8") == "mine"


def test_init_says_what_to_do_in_an_unwritable_place(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(RigctlError, match="cannot write the project folder"):
        CliRunner().invoke(app, ["init", str(tmp_path / "file" / "bench")], catch_exceptions=False)


def test_doctor_is_well_here_and_names_the_extras() -> None:
    shown = CliRunner().invoke(app, ["doctor", "--json"])
    assert shown.exit_code == 0
    findings = {finding["subject"]: finding for finding in json.loads(shown.stdout)["findings"]}
    assert findings["numba"]["state"] == "ok"
    assert findings["compiled models"]["state"] == "ok"
    for name in ("tdms", "mdf", "cluster"):
        extra = findings[f"{name} (extra)"]
        assert extra["state"] == "ok" or extra["fix"] == f"pip install 'rigctl[{name}]'"


def test_doctor_shows_what_to_type_in_full() -> None:
    shown = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["doctor"])
    missing = [finding for finding in doctor.examine() if finding.fix]
    assert all(finding.fix in shown.output for finding in missing)


def test_doctor_fails_when_something_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = doctor.Finding("numba", "broken", "not installed", "pip install numba")
    monkeypatch.setattr(doctor, "examine", lambda: iter([broken]))
    shown = CliRunner().invoke(app, ["doctor"])
    assert shown.exit_code == 1
    assert "pip install numba" in shown.output
