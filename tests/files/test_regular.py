"""No command waits for a pipe, or fills the memory from a device, in place of a file."""

from __future__ import annotations

import ast
import errno
import os
import threading
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from commands import call
from rigctl.cli.commands.init import create_project
from rigctl.errors import RigctlError
from rigctl.files.regular import read_text, regular
from rigctl.files.write import write_text
from systems import needs_posix

SOURCE = Path(__file__).parents[2] / "src" / "rigctl"
COMMANDS = (
    "check {}.yaml",
    "simulate {}.yaml",
    "check procedures/quick-check.yaml --rig {}.yaml",
    "import {}.csv",
    "import {}.csv.gz",
    "import {}.xlsx",
    "import {}.tdms",
    "import {}.parquet",
    "import {}.mat",
    "import {}.mf4",
    "import data/hl32-viscosity.csv --rig {}.yaml",
    "model show {}.yaml",
    "model history {}.yaml",
    "calibrate position --points {}.csv --dry",
)


@needs_posix("pipes in folders, and /dev/zero")
def test_pipes_and_devices_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    create_project(tmp_path / "project")
    monkeypatch.chdir(tmp_path / "project")
    for ending in ("yaml", "csv", "csv.gz", "xlsx", "tdms", "parquet", "mat", "mf4"):
        os.mkfifo(f"pipe.{ending}")
        Path(f"device.{ending}").symlink_to("/dev/zero")
    for name, command in product(("pipe", "device"), COMMANDS):
        done = call(*command.format(name).split())
        assert isinstance(done.exception, RigctlError), command


@pytest.mark.parametrize("name", ["com1", "COM3.yaml", "aux", "nul.csv"])
def test_on_windows_a_device_is_refused_before_it_is_opened(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To open COM3 restarts the board there."""
    monkeypatch.setattr(os, "open", lambda *_: pytest.fail("it was opened"))
    with pytest.raises(OSError, match=f"'{name}' is a device on Windows, in every folder"):
        regular(str(tmp_path / name), os.O_RDONLY, windows=True)


def test_on_windows_a_file_that_is_just_being_replaced_is_opened_a_moment_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A list of runs showed one as damaged whose run.json was replaced at that moment."""
    path, opened, attempts = tmp_path / "run.json", os.open, [0]
    path.write_text("{}", encoding="utf-8")

    def refusing(*arguments: Any) -> int:
        attempts[0] += 1
        if attempts[0] < 4:
            raise PermissionError(errno.EACCES, "Permission denied")  # as the C library says it
        return opened(*arguments)

    monkeypatch.setattr(os, "open", refusing)
    os.close(regular(str(path), os.O_RDONLY, windows=True))
    assert attempts == [4]
    attempts[0] = 0
    with pytest.raises(PermissionError):
        regular(str(path), os.O_RDONLY, windows=False)
    attempts[0] = 0
    with pytest.raises(PermissionError):  # a folder is refused in the same words, and for good
        regular(str(tmp_path), os.O_RDONLY, windows=True)
    assert attempts == [1]


def test_a_file_is_read_whole_while_it_is_replaced(tmp_path: Path) -> None:
    """By another thread, as often as it can, with what a reader would notice half of."""
    path, texts = tmp_path / "run.json", [letter * 5000 for letter in "ab"]
    write_text(path, texts[0])
    over = threading.Event()

    def replace() -> None:
        while not over.is_set():
            for text in texts:
                with suppress(RigctlError):  # Windows refuses it for as long as the reader never lets go
                    write_text(path, text)

    writer = threading.Thread(target=replace)
    writer.start()
    try:
        assert {read_text(path) for _ in range(1000)} <= set(texts)
    finally:
        over.set()
        writer.join()


@pytest.mark.skipif(os.name == "nt", reason="a device there")
def test_elsewhere_a_file_may_be_named_like_a_device_of_windows(tmp_path: Path) -> None:
    (tmp_path / "con.yaml").write_text("text", encoding="utf-8")
    assert read_text(tmp_path / "con.yaml") == "text"


#: modules that read only files of rigctl itself, or its own folders of the user, or in a process with limits
OWN = {
    "backends/visa/client.py",  # of an instrument
    "cli/commands/demo.py",
    "cli/commands/init.py",
    "dataset/importing/formats/foreign.py",
    "dataset/storage/store.py",  # of an object
    "engine/cache.py",
    "engine/kernels/portable.py",
    "engine/result_cache/cached.py",
    "engine/result_cache/store.py",
    "model/fmu/export.py",
    "physics/oil/published.py",
    "report/page.py",
    "testing/bench.py",
    "web/app.py",
    "web/docs.py",
}


def reads_anything(text: str) -> bool:
    """Whether a module reads files by methods of paths or by `open`, which open anything."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    names = {node.func.attr for node in calls if isinstance(node.func, ast.Attribute)}
    return bool(names & {"read_text", "read_bytes"}) or any(opens_anything(call) for call in calls)


def opens_anything(call: ast.Call) -> bool:
    """Whether a call opens a file for reading, whatever it is: ``path.open("rb")``, ``open(path)``."""
    stated = {one.arg: one.value for one in call.keywords}
    if isinstance(call.func, ast.Name) and call.func.id == "open":
        modes = [*call.args[1:2], ast.Constant("r")]
    elif isinstance(call.func, ast.Attribute) and call.func.attr == "open":
        plain = not call.args and not {"mode", "encoding", "newline", "errors"} & set(stated)
        modes = [
            *call.args[:1],
            *([] if plain else [ast.Constant("r")]),
        ]  # not of a bench
    else:
        return False
    mode = stated.get("mode", modes[0] if modes else None)
    text = mode.value if isinstance(mode, ast.Constant) else None
    return isinstance(text, str) and "r" in text and set(text) <= set("rbt") and "opener" not in stated


@pytest.mark.parametrize(
    ("call", "found"),
    [
        ('path.open("rb")', True),
        ("path.open(encoding='utf-8')", True),
        ("path.open(mode='rt')", True),
        ("open(path)", True),
        ("open(path, 'rb')", True),
        ("open(path, 'rb', opener=regular)", False),
        ("path.open('wb')", False),
        ("os.open(path, flags)", False),
        ("backend.open()", False),
    ],
)
def test_every_way_to_open_a_file_is_seen(call: str, found: bool) -> None:
    assert reads_anything(call) is found


def test_files_of_users_are_opened_only_if_regular() -> None:
    """By `rigctl.files.regular`."""
    found = {
        path.relative_to(SOURCE).as_posix()
        for path in SOURCE.rglob("*.py")
        if reads_anything(path.read_text("utf-8"))
    }
    assert {name for name in found - OWN if not name.startswith("validation/")} == set()
