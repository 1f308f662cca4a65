"""A stirrer's heat, which is in no library, in a family of a user's: two effects imitate it."""

from __future__ import annotations

from pathlib import Path

import pytest

from benches.stirred_jar import write_log, write_project
from commands import answer, told


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    told("init", "--minimal")
    write_project(tmp_path)
    return tmp_path


def test_two_effects_that_imitate_the_heat_of_a_stirrer_are_not_certain(project: Path) -> None:
    """They explain 99 % of the misfit, and pass the cross-validation."""
    write_log(project / "log.csv", stirring=60.0, seed=4)
    told("import", "log.csv", "--rig", "rigs/jar.yaml")
    diagnosis = answer("diagnose", "latest", "--model", "models/jar.yaml")
    assert diagnosis["verdict"] == "ambiguous"
    assert len(diagnosis["levels"]) == len(diagnosis["effects"]) == 2
    assert not any(one[level]["sure"] for one in diagnosis["levels"] for level in ("place", "driver", "law"))
    assert diagnosis["remainder"]["share"] < 0.02
    assert diagnosis["remainder"]["size"] > 100.0


def test_a_jar_without_that_heat_agrees_with_its_model(project: Path) -> None:
    write_log(project / "log.csv", stirring=0.0, seed=1)
    told("import", "log.csv", "--rig", "rigs/jar.yaml")
    assert answer("diagnose", "latest", "--model", "models/jar.yaml")["verdict"] == "adequate"
