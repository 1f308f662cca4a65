"""Planted faults: the tool plants what it says, and its list of equivalent ones names faults that exist."""

from __future__ import annotations

import ast
import importlib.util
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


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("planted_faults", ROOT / "tools" / "planted_faults.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_messages_types_and_docstrings_are_no_places_for_faults(tool: ModuleType) -> None:
    found = [tuple(one.change.split(" -> ")) for one in tool.faults("module.py", ast.parse(MODULE))]
    assert set(found) == CHANGES
    assert len(found) == len(CHANGES)


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
        assert all((ROOT / file).is_file() for file in room["tests"])
