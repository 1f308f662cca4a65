"""The cache of compiled modules: kept, shared, never in the way, never trusted when damaged."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.engine import cache

SOURCE = {
    "compiled.py": (
        "from numba import njit, types\n\n\n"
        "@njit(types.float64(types.float64), cache=True)\n"
        "def double(x):\n    return 2.0 * x\n"
    )
}


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    return tmp_path / "engine"


def load(name: str, *, forget: bool = True) -> tuple[object, list[str]]:
    """The module as a new process would load it, and whether it was compiled."""
    if forget:
        for known in [module for module in sys.modules if module.startswith(f"rigctl_compiled_{name}_")]:
            del sys.modules[known]
    compiled: list[str] = []
    module = cache.load_compiled(name, SOURCE, before_compiling=lambda: compiled.append(name))
    assert module.double(21.0) == 42.0
    return module, compiled


def only_folder(root: Path) -> Path:
    folders = [path for path in root.iterdir() if path.is_dir()]
    assert len(folders) == 1
    return folders[0]


def test_a_module_is_compiled_once(root: Path) -> None:
    assert load("once")[1] == ["once"]
    assert load("once", forget=False)[1] == []
    module, compiled = load("once")
    assert compiled == []
    assert sum(module.double.stats.cache_hits.values()) == 1  # type: ignore[attr-defined]
    assert only_folder(root).name.startswith("once-")


def spoil_machine_code(folder: Path) -> None:
    code = next((folder / "__pycache__").glob("*.nbc"))
    code.write_bytes(code.read_bytes()[:-7])


def spoil_index(folder: Path) -> None:
    next((folder / "__pycache__").glob("*.nbi")).write_bytes(b"garbage")


def spoil_source(folder: Path) -> None:
    (folder / "compiled.py").write_text("raise SystemError\n", encoding="utf-8")


def spoil_checksums(folder: Path) -> None:
    (folder / "checksums.json").write_text("{", encoding="utf-8")


def lose_checksums(folder: Path) -> None:
    (folder / "checksums.json").unlink()


@pytest.mark.parametrize(
    "spoil", [spoil_machine_code, spoil_index, spoil_source, spoil_checksums, lose_checksums]
)
def test_a_damaged_module_is_built_again(
    root: Path, spoil: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    name = spoil.__name__
    load(name)
    spoil(only_folder(root))
    with caplog.at_level(logging.WARNING):
        assert load(name)[1] == [name]
    assert "damaged and is built again" in caplog.text
    assert load(name)[1] == []


def test_a_module_that_fails_in_spite_of_its_checksums_is_built_again(root: Path) -> None:
    load("failing")
    folder = only_folder(root)
    spoil_source(folder)
    cache._write_manifest(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cache, "_import_whole", raising)
        assert load("failing")[1] == ["failing"]
    assert load("failing")[1] == []


def raising(module_name: str, folder: Path) -> object:
    raise EOFError(module_name)


def test_a_cache_that_cannot_be_written_costs_a_warning_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    blocked = tmp_path / "a-file"
    blocked.write_text("not a folder", encoding="utf-8")
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(blocked))
    with caplog.at_level(logging.WARNING):
        assert load("blocked")[1] == ["blocked"]
    assert "cannot be used" in caplog.text


def test_a_cache_that_can_only_be_read_is_used(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load("shared")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    module, compiled = load("shared")
    assert compiled == []
    assert sum(module.double.stats.cache_hits.values()) == 1  # type: ignore[attr-defined]


def test_another_process_that_was_faster_is_no_error(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load("raced")
    found = cache._from_cache
    answers = iter([None, None])
    monkeypatch.setattr(cache, "_from_cache", lambda name, folder: next(answers, None))
    assert load("raced")[1] == ["raced"]
    monkeypatch.setattr(cache, "_from_cache", found)
    assert load("raced")[1] == []
    only_folder(root)


def test_processes_share_one_module(root: Path) -> None:
    program = (
        "import sys; from rigctl.engine.cache import load_compiled\n"
        f"module = load_compiled('many', {SOURCE!r})\n"
        "assert module.double(2.0) == 4.0\n"
    )
    processes = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(3)]
    assert [process.wait(600) for process in processes] == [0, 0, 0]
    only_folder(root)


def test_what_is_old_is_pruned(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "_KEPT", 2)
    root.mkdir(parents=True)
    for age, name in enumerate(["pruning-newest", "pruning-newer", "pruning-old", "kernels-oldest"]):
        (root / name).mkdir()
        os.utime(root / name, (1e9 - age, 1e9 - age))
    (root / ".half-built").mkdir()
    os.utime(root / ".half-built", (2e9, 1e9))
    load("pruning")
    kept = {path.name for path in root.iterdir() if path.is_dir()}
    (built,) = kept - {"pruning-newest", "kernels-oldest"}
    assert built.startswith("pruning-")
    assert len(kept) == 3


def test_the_users_own_place_is_used_unless_another_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(cache.CACHE_VARIABLE, raising=False)
    assert cache.cache_root().parts[-2:] == ("rigctl", "engine")
