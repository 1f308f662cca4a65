"""The method version: decision code does not change without a declaration; other code may."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from types import ModuleType

import pytest

from rigctl import method_version

TOOL = Path(__file__).parent.parent / "tools" / "method_version.py"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("method_version_tool", TOOL)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_decision_code_matches_its_declared_fingerprint(tool: ModuleType) -> None:
    for number, mark, packages in tool.DECLARATIONS:
        assert getattr(method_version, number) >= 1
        assert tool.fingerprint(packages=packages) == getattr(method_version, mark), (
            "code that decides has changed: run 'python tools/method_version.py --changed' if a verdict or a "
            "formula may come out differently (and validate again), or '--same' if it cannot"
        )


@pytest.mark.parametrize(
    ("file", "raised"), [("search.py", "METHOD_VERSION"), ("grammar.py", "DISCOVERY_VERSION")]
)
def test_a_declared_change_raises_only_the_version_that_the_file_affects(
    tool: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, raised: str
) -> None:
    """A search for formulas starts from a verdict, so code used only there leaves the rates valid."""
    for one in ("search.py", "grammar.py"):
        _copied(tool, tmp_path, one)
    declared = tmp_path / "method_version.py"
    shutil.copy(tool.DECLARED, declared)
    monkeypatch.setattr(tool, "DECLARED", declared)
    monkeypatch.setattr(tool.fingerprint, "__defaults__", (tmp_path, tool.PACKAGES))
    tool.declare(changed=False)
    before = {number: getattr(method_version, number) for number, _, _ in tool.DECLARATIONS}
    tool.declare(changed=True)
    assert _versions(declared) == before, "nothing has changed since the declaration"
    path = next(p for p in tmp_path.rglob(file))
    path.write_text(path.read_text(encoding="utf-8") + "\nNEW = 1\n", encoding="utf-8")
    tool.declare(changed=True)
    assert _versions(declared) == before | {raised: before[raised] + 1}


def _versions(declared: Path) -> dict[str, int]:
    lines = declared.read_text(encoding="utf-8").splitlines()
    pairs = [line.split(" = ") for line in lines if "_VERSION = " in line]
    return {name: int(value) for name, value in pairs}


@pytest.mark.parametrize(
    ("name", "old", "new", "same"),
    [
        ("decision_levels.py", "#: probability of rejecting", "#: how often it calls", True),  # a comment
        ("adequacy.py", '"""Does the model agree', '"""Whether the model agrees', True),  # a docstring
        ("decision_levels.py", "ALPHA: Final = 0.01", "ALPHA: Final = 0.02", False),
        ("adequacy.py", "self.p_value < ALPHA", "self.p_value <= ALPHA", False),
    ],
)
def test_only_changes_of_code_change_the_fingerprint_and_not_comments_or_docstrings(
    tool: ModuleType, tmp_path: Path, name: str, old: str, new: str, same: bool
) -> None:
    before = _copied(tool, tmp_path, name)
    path = next(tmp_path.rglob(name))
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    assert (tool.fingerprint(tmp_path) == before) is same


def test_renaming_a_file_leaves_the_fingerprint_unchanged(tool: ModuleType, tmp_path: Path) -> None:
    before = _copied(tool, tmp_path, "adequacy.py")
    path = next(tmp_path.rglob("adequacy.py"))
    path.rename(path.with_name("agreement.py"))
    assert tool.fingerprint(tmp_path) == before


def _copied(tool: ModuleType, folder: Path, name: str) -> str:
    """A tree with this one file in it, and its fingerprint."""
    packages = (*tool.PACKAGES, *tool.SEARCHING)
    path = next(p for package in packages for p in (tool.ROOT / package).rglob(name))
    copy = folder / path.relative_to(tool.ROOT)
    copy.parent.mkdir(parents=True)
    shutil.copy(path, copy)
    found: str = tool.fingerprint(folder)
    return found
