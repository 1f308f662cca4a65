"""Atomic writing of files."""

from __future__ import annotations

import json
import math
import os
import stat
from datetime import UTC, date, datetime
from enum import Enum
from pathlib import Path, PurePosixPath

import numpy as np
import pytest

from rigctl.errors import ExitCode, RigctlError
from rigctl.files.write import move_folder, to_json, write_json, write_new, write_text
from systems import needs_posix


def test_text_is_utf_8_with_plain_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    write_text(path, "20 °C\nx\n")
    assert path.read_bytes() == b"20 \xc2\xb0C\nx\n"


def test_writing_replaces_and_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    write_text(path, "new")
    assert path.read_text(encoding="utf-8") == "new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def test_a_failure_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RigctlError, match="No space left") as caught:
        write_text(path, "new")
    assert caught.value.exit_code is ExitCode.FAILED
    assert caught.value.where.file == path
    assert path.read_text(encoding="utf-8") == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def test_an_impossible_folder_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(RigctlError, match="cannot write the file"):
        write_text(tmp_path / "file" / "a.txt", "x")


@needs_posix("permissions of POSIX")
def test_permissions_are_those_of_any_new_file_and_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    other = tmp_path / "b.txt"
    other.write_text("", encoding="utf-8")
    write_text(path, "x")
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(other.stat().st_mode)
    path.chmod(0o600)
    write_text(path, "y")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


class Colour(Enum):
    RED = "red"


def test_numpy_values_dates_and_sets_are_written_as_json(tmp_path: Path) -> None:
    value = {
        "nan": math.nan,
        "infinite": np.float64("inf"),
        "array": np.array([[1, 2], [3, 4]]),
        "number": np.float32(0.5),
        "date": date(2026, 3, 14),
        "time": datetime(2026, 3, 14, 9, 30, tzinfo=UTC),
        "path": PurePosixPath("a/b"),
        "enum": Colour.RED,
        "set": (1, 2),
        1: "°",
    }
    write_json(tmp_path / "a.json", value)
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {
        "nan": None,
        "infinite": None,
        "array": [[1, 2], [3, 4]],
        "number": 0.5,
        "date": "2026-03-14",
        "time": "2026-03-14T09:30:00+00:00",
        "path": "a/b",
        "enum": "red",
        "set": [1, 2],
        "1": "°",
    }


def test_a_value_without_a_json_form_is_a_type_error() -> None:
    with pytest.raises(TypeError, match="object"):
        to_json({"a": object()})


def test_json_can_be_written_on_one_line() -> None:
    assert to_json({"a": [1]}, indent=None) == '{"a": [1]}'


@pytest.mark.parametrize("links", [True, False], ids=["links", "no links"])
def test_a_new_file_is_written_whole_and_never_replaces_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    def refuse(self: Path, target: Path) -> None:
        raise OSError(95, "Operation not supported")

    if not links:
        monkeypatch.setattr(Path, "hardlink_to", refuse)
    path = tmp_path / "new" / "a.txt"
    write_new(path, b"one")
    with pytest.raises(FileExistsError):
        write_new(path, b"two")
    assert path.read_bytes() == b"one"
    assert not stat.S_IMODE(path.stat().st_mode) & 0o222
    assert [entry.name for entry in path.parent.iterdir()] == ["a.txt"]


def test_a_new_file_that_cannot_be_written_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RigctlError, match="No space left") as caught:
        write_new(tmp_path / "a.txt", b"one")
    assert caught.value.exit_code is ExitCode.FAILED
    assert list(tmp_path.iterdir()) == []


def held_open(
    monkeypatch: pytest.MonkeyPatch, times: int, winerror: int = 5, method: str = "replace"
) -> list[Path]:
    """Renaming is refused as Windows does while a reader has the file open; returns the attempts."""
    attempts: list[Path] = []
    rename = getattr(Path, method)

    def refused(draft: Path, path: Path) -> Path:
        attempts.append(path)
        if len(attempts) <= times:
            problem = PermissionError(13, "Access is denied")
            problem.winerror = winerror  # type: ignore[attr-defined, unused-ignore]
            raise problem
        renamed: Path = rename(draft, path)
        return renamed

    monkeypatch.setattr(Path, method, refused)
    return attempts


@pytest.mark.parametrize("winerror", [5, 32])
def test_a_file_held_open_by_a_reader_on_windows_is_replaced_afterwards(
    winerror: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    attempts = held_open(monkeypatch, 3, winerror)
    write_text(path, "new")
    assert len(attempts) == 4
    assert path.read_text(encoding="utf-8") == "new"


def test_replacing_a_file_held_open_for_good_fails_after_several_attempts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    monkeypatch.setattr("rigctl.files.in_use._PAUSE", 0.1)
    attempts = held_open(monkeypatch, 10**6)
    with pytest.raises(RigctlError, match=r"denied\. If another program has it open, as a sp"):
        write_text(path, "new")
    assert 1 < len(attempts) < 20
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_of_which_a_virus_scanner_has_a_file_open_is_moved_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "draft").mkdir()
    (tmp_path / "draft" / "run.json").write_text("{}", encoding="utf-8")
    attempts = held_open(monkeypatch, 3, method="rename")
    assert move_folder(tmp_path / "draft", tmp_path / "run") == tmp_path / "run"
    assert len(attempts) == 4
    assert [entry.name for entry in tmp_path.rglob("*")] == ["run", "run.json"]


def test_a_folder_is_not_moved_onto_another_one(tmp_path: Path) -> None:
    for name in ("draft", "run"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text(name, encoding="utf-8")
    with pytest.raises(OSError, match="run"):
        move_folder(tmp_path / "draft", tmp_path / "run")
    assert (tmp_path / "run" / "run.json").read_text(encoding="utf-8") == "run"


def test_a_refusal_for_another_reason_is_reported_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempts = held_open(monkeypatch, 10**6, winerror=19)  # the disk is write-protected
    with pytest.raises(RigctlError, match="denied"):
        write_text(tmp_path / "a.txt", "new")
    assert len(attempts) == 1
