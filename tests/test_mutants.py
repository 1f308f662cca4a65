"""Planted faults: the tool plants what it says, and its list of equivalent ones names faults that exist."""

from __future__ import annotations

import ast
import importlib.util
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = tomllib.loads((ROOT / "tools" / "mutants.toml").read_text(encoding="utf-8"))

MODULE = '''
from typing import Final

LEAST: Final = 0.5

def kept(values, other=3):
    """Not changed: -1 < 2."""
    if not values:
        raise ValueError("no values, at least 1")
    return [value for value in values if value > LEAST and value is not other]
'''
KEPT = "return [value for value in values"
CHANGES = {
    ("LEAST: Final = 0.5", "LEAST: Final = 1.0"),
    ("3", "4"),
    ("not values", "True"),
    ("not values", "False"),
    ("not values", "values"),
    ("raise ValueError('no values, at least 1')", "pass"),
    *(
        (f"{KEPT} if value > LEAST and value is not other]", f"{KEPT} if {other}]")
        for other in (
            "True",
            "value > LEAST or value is not other",
            "value > LEAST",
            "value is not other",
            "value >= LEAST and value is not other",
            "value <= LEAST and value is not other",
            "value > LEAST and value is other",
        )
    ),
}


#: one room of a project with one test
ROOM = """
import sys
from argparse import Namespace
sys.path.insert(0, sys.argv[1])
import mutants
options = Namespace(since=None, only=sys.argv[3], sample=0, seed=0)
sys.exit(mutants.run_room("room", {"files": ["printable.py"], "tests": [sys.argv[2]]}, {}, options))
"""


def imported(name: str, path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    return imported("planted_faults", ROOT / "tools" / "planted_faults.py")


def test_messages_types_and_docstrings_are_no_places_for_faults(tool: ModuleType) -> None:
    found = [tuple(one.change.split(" -> ")) for one in tool.faults("module.py", ast.parse(MODULE))]
    assert set(found) == CHANGES
    assert len(found) == len(CHANGES)


def test_a_planted_fault_changes_what_runs(
    tool: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "small_module.py").write_text(MODULE, "utf-8")
    monkeypatch.setattr(tool, "SOURCE", tmp_path)
    monkeypatch.setattr(tool, "ROOT", tmp_path)
    monkeypatch.setattr(tool.gc, "unfreeze", lambda: None)  # the other tests of this process stay frozen
    monkeypatch.setitem(sys.modules, "small_module", ModuleType("small_module"))  # removed in the end
    module = imported("small_module", tmp_path / "small_module.py")
    planter = tool.Planter(["small_module.py"])
    kept = module.kept
    assert kept([0.5, 0.7, 1.5]) == [0.7, 1.5]
    (function,) = (one for one in planter.faults() if "if value >= LEAST" in one.change)
    assert planter.plant(function)
    assert kept([0.5, 0.7, 1.5]) == [0.5, 0.7, 1.5]
    (constant,) = (one for one in planter.faults() if one.change.startswith("LEAST"))
    assert planter.plant(constant)
    assert kept([0.5, 0.7, 1.5]) == [1.5]


@pytest.mark.parametrize(
    ("test", "only", "outcome", "said"),
    [
        ("import no_such_module", "", 1, "room: tests could not be collected"),
        ("def test_nothing():\n    pass", "misspelt", 2, "room: no faults"),
    ],
)
@pytest.mark.skipif(not hasattr(os, "fork"), reason="planting forks")
def test_a_room_without_tests_or_faults_finds_nothing(
    tmp_path: Path, test: str, only: str, outcome: int, said: str
) -> None:
    """Neither is a score of 100 %."""
    file = tmp_path / "test_one.py"
    file.write_text(test, "utf-8")
    done = subprocess.run(
        [sys.executable, "-c", ROOM, str(ROOT / "tools"), str(file), only],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, said in done.stdout) == (outcome, True), done.stdout + done.stderr


def test_every_fault_said_to_be_equivalent_exists_and_has_a_reason(tool: ModuleType) -> None:
    for file in {one["file"] for one in ROOMS["equivalent"]}:
        tree = ast.parse((tool.SOURCE / file).read_text(encoding="utf-8"))
        there = {one.key for one in tool.faults(file, tree)}
        for one in ROOMS["equivalent"]:
            if one["file"] == file:
                assert (file, one["where"], one["change"]) in there
                assert one["reason"]


def test_rooms_name_files_and_tests_that_exist(tool: ModuleType) -> None:
    for room in ROOMS["rooms"].values():
        assert all((tool.SOURCE / file).is_file() for file in room["files"])
        assert all((ROOT / test.partition("::")[0]).is_file() for test in room["tests"])
