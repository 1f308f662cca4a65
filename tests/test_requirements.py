"""Required packages are imported, and extras are listed and imported."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest

from rigctl.cli.commands.doctor.doctor import _EXTRAS

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
#: import name where it is another than the package's
IMPORTED = {"pyserial": "serial", "ruamel.yaml": "ruamel", "npTDMS": "nptdms", "FMPy": "fmpy"}
#: extra -> what is installed along and found by another package
ALONG = {"visa": {"pyvisa-py"}, "storage": {"s3fs"}}
#: required, and found by another package
FOUND = {"websockets"}  # by uvicorn
#: for whom works on rigctl, not for whom works with it
OURS = {"dev", "benchmarks"}
#: every extra for whom works with it
ALL = "all"


def name_of(requirement: str) -> str:
    return re.split(r"[<>=\[;]", requirement)[0].strip()


def imports_of(folder: Path) -> set[str]:
    found = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found


@pytest.fixture(scope="module")
def imported() -> set[str]:
    return imports_of(ROOT / "src" / "rigctl")


def test_every_required_package_is_imported(imported: set[str]) -> None:
    required = {name_of(one) for one in PROJECT["dependencies"]} - FOUND
    assert {name for name in required if IMPORTED.get(name, name) not in imported} == set()


def test_every_extra_is_listed_by_doctor_and_imported(imported: set[str]) -> None:
    offered = {
        extra: {IMPORTED.get(name_of(one), name_of(one)) for one in requirements}
        for extra, requirements in PROJECT["optional-dependencies"].items()
        if extra not in OURS and extra != ALL
    }
    assert {extra: {module, *ALONG.get(extra, ())} for module, extra, _ in _EXTRAS} == offered
    (everything,) = PROJECT["optional-dependencies"][ALL]
    assert set(re.findall(r"\w+", everything.partition("[")[2])) == set(offered)
    assert set().union(*offered.values()) <= imported | set().union(*ALONG.values())
