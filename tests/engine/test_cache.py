"""The cache of machine code: persistent, shared, optional, and never trusted if damaged."""

from __future__ import annotations

import ctypes
import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.engine import cache
from rigctl.engine.machine_code import MachineCode, compiled
from rigctl.files.cache_folder import CACHE_VARIABLE

SOURCE = """
define double @double(double %x) {
  %twice = fmul double %x, 2.0
  ret double %twice
}
"""


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    return tmp_path / "engine"


def load(name: str, *, forget: bool = True) -> list[str]:
    """Load and call the function as a new process would; returns the steps "announced" and "made"."""
    if forget:
        cache._loaded.clear()
    made: list[str] = []

    def make() -> MachineCode:
        made.append("made")
        return compiled(SOURCE, ["double"], vectors=False)

    found = cache.load_compiled(name, SOURCE, make, before_compiling=lambda: made.append("announced"))
    double = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(found["double"])
    assert double(21.0) == 42.0
    return made


COMPILED = ["announced", "made"]


def only_folder(root: Path) -> Path:
    folders = [path for path in root.iterdir() if path.is_dir()]
    assert len(folders) == 1
    return folders[0]


def test_machine_code_is_compiled_once_and_then_loaded(root: Path) -> None:
    assert load("once") == COMPILED
    assert load("once", forget=False) == []
    assert load("once") == []
    assert only_folder(root).name.startswith("once-")


def spoil_machine_code(folder: Path) -> None:
    code = folder / "code.o"
    code.write_bytes(code.read_bytes()[:-7])


def spoil_names(folder: Path) -> None:
    (folder / "names.json").write_text('{"defines": ["triple"], "needs": []}', encoding="utf-8")


def spoil_checksums(folder: Path) -> None:
    (folder / "checksums.json").write_text("{", encoding="utf-8")


def lose_checksums(folder: Path) -> None:
    (folder / "checksums.json").unlink()


@pytest.mark.parametrize("spoil", [spoil_machine_code, spoil_names, spoil_checksums, lose_checksums])
def test_damaged_code_is_rebuilt(
    root: Path, spoil: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    name = spoil.__name__
    load(name)
    spoil(only_folder(root))
    with caplog.at_level(logging.WARNING):
        assert load(name) == COMPILED
    assert "is built again" in caplog.text
    assert load(name) == []


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("code.o", b"no machine code"),
        ("names.json", b"{}"),
        ("names.json", b'{"defines": ["triple"], "needs": []}'),
        ("names.json", b'{"defines": ["double"], "needs": ["function_of_nobody"]}'),
    ],
)
def test_code_that_fails_despite_its_checksum_is_rebuilt(root: Path, file: str, content: bytes) -> None:
    load("failing")
    folder = only_folder(root)
    (folder / file).write_bytes(content)
    cache._write_manifest(folder, folder.name)
    assert load("failing") == COMPILED
    assert load("failing") == []


POSIX = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows has no such permissions")


@POSIX
@pytest.mark.parametrize("name", ["", "code.o", "names.json", "checksums.json"])
def test_code_that_others_could_have_written_is_not_executed(root: Path, name: str) -> None:
    """With matching checksums, anybody's machine code used to be executed."""
    load("open")
    path = only_folder(root) / name
    path.chmod(path.stat().st_mode | 0o022)
    assert load("open") == COMPILED
    assert load("open") == []


@POSIX
def test_the_cache_is_closed_to_others_and_not_shared_with_them(
    root: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    before = os.umask(0)
    try:
        load("closed")
    finally:
        os.umask(before)
    assert not any(path.stat().st_mode & 0o022 for path in (root, *only_folder(root).rglob("*")))
    root.chmod(0o777)
    assert load("closed") == []
    assert root.stat().st_mode & 0o022 == 0
    if os.geteuid() == 0:
        os.chown(root, 65534, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 65534)
    with caplog.at_level(logging.WARNING):
        assert load("closed") == COMPILED
    assert "can be changed by other users" in caplog.text


def test_an_entry_in_the_place_of_another_is_not_used(root: Path) -> None:
    load("one")
    first = only_folder(root)
    aside = root.parent / "aside"
    first.rename(aside)
    load("other")
    second = only_folder(root)
    (root / second.name).rename(root.parent / "unused")
    aside.rename(second)
    assert load("other") == COMPILED


def test_an_unwritable_cache_only_warns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    blocked = tmp_path / "a-file"
    blocked.write_text("not a folder", encoding="utf-8")
    monkeypatch.setenv(CACHE_VARIABLE, str(blocked))
    with caplog.at_level(logging.WARNING):
        assert load("blocked") == COMPILED
    assert "cannot be used" in caplog.text


def test_a_read_only_cache_is_used(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load("shared")

    def refused(*_: object) -> None:
        raise PermissionError("read-only file system")

    monkeypatch.setattr(os, "utime", refused)
    monkeypatch.setattr(Path, "mkdir", refused)
    assert load("shared") == []


def test_a_race_with_another_process_is_harmless(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load("raced")
    found = cache._from_cache
    answers = iter([None, None])
    monkeypatch.setattr(cache, "_from_cache", lambda folder: next(answers, None))
    assert load("raced") == COMPILED
    monkeypatch.setattr(cache, "_from_cache", found)
    assert load("raced") == []
    only_folder(root)


def test_concurrent_processes_share_one_entry(root: Path) -> None:
    program = (
        "import ctypes\n"
        "from rigctl.engine.cache import load_compiled\n"
        "from rigctl.engine.machine_code import compiled\n"
        f"source = {SOURCE!r}\n"
        "found = load_compiled('many', source, lambda: compiled(source, ['double'], vectors=False))\n"
        "assert ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(found['double'])(2.0) == 4.0\n"
    )
    processes = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(3)]
    assert [process.wait(600) for process in processes] == [0, 0, 0]
    only_folder(root)


def test_a_process_with_cached_machine_code_does_not_load_the_compiler() -> None:
    program = (
        "import json, sys\n"
        "import numpy as np\n"
        "from rigctl.engine.compile import compile_system\n"
        "from rigctl.engine.simulate import simulate\n"
        "from rigctl.files.shipped import shipped\n"
        "from rigctl.model.load import load_model\n"
        "from rigctl.model.standard_record import standard_excitation\n"
        "model = load_model(shipped('models', 'heater-board.yaml'))\n"
        "system = model.system()\n"
        "record = standard_excitation(model.family, system, system.nominal, {})\n"
        "simulate(compile_system(system), [record]).require()\n"
        "print(json.dumps('numba' in sys.modules))\n"
    )
    loaded = [
        json.loads(subprocess.run([sys.executable, "-c", program], check=True, capture_output=True).stdout)
        for _ in range(2)  # the first one may have to compile
    ]
    assert loaded[1] is False


def test_old_entries_are_removed(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "_KEPT", 2)
    root.mkdir(parents=True)
    for age, name in enumerate(["pruning-newest", "pruning-newer", "pruning-old", "kernels-oldest"]):
        (root / name).mkdir()
        os.utime(root / name, (1e9 - age, 1e9 - age))
    (root / ".half-built").mkdir()
    os.utime(root / ".half-built", (2e9, 1e9))
    assert load("pruning") == COMPILED
    kept = {path.name for path in root.iterdir() if path.is_dir()}
    (built,) = kept - {"pruning-newest", "kernels-oldest"}
    assert built.startswith("pruning-")
    assert len(kept) == 3


def test_the_default_cache_is_in_the_users_cache_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    between = ("Cache",) if sys.platform == "win32" else ()  # in the folder of the user's local data
    assert cache.cache_root().parts[-2 - len(between) :] == ("rigctl", *between, "engine")
