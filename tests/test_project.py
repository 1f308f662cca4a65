"""Finding the project of a folder, and resolving paths in it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.project import Project, find_project


def test_the_root_is_the_nearest_parent_folder_with_a_marker(tmp_path: Path) -> None:
    (tmp_path / "rigctl.toml").write_text('runs = "data/runs"\n', encoding="utf-8")
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    assert find_project(inner) == Project(tmp_path, tmp_path / "data" / "runs")


def test_without_a_marker_the_project_is_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_project() == Project(tmp_path, tmp_path / "runs")


def test_a_project_may_name_its_rig_file(tmp_path: Path) -> None:
    (tmp_path / "rigctl.toml").write_text('rig = "rigs/press.yaml"\n', encoding="utf-8")
    project = find_project(tmp_path)
    assert (project.runs, project.rig) == (tmp_path / "runs", tmp_path / "rigs" / "press.yaml")


def test_a_project_may_keep_its_runs_in_another_folder(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    (tmp_path / "rigctl.toml").write_text(f"runs = '{elsewhere}'\n", encoding="utf-8")
    assert find_project(tmp_path).runs == elsewhere


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"runs = ", "not valid TOML"),
        (b"rusn = 'x'", "unknown setting, got 'rusn'; did you mean 'runs'?"),
        (b"runs = 3", "runs: wrong kind of value, got '3'; expected a folder"),
        (b"rig = 3", "rig: wrong kind of value, got '3'; expected a rig file"),
        (b"runs = ''", "runs: wrong kind of value"),
        (b"runs = '\xff'", "not UTF-8"),
    ],
)
def test_an_invalid_project_file_is_reported_by_name(tmp_path: Path, content: bytes, message: str) -> None:
    marker = tmp_path / "rigctl.toml"
    marker.write_bytes(content)
    with pytest.raises(RigctlError) as caught:
        find_project(tmp_path)
    assert message in str(caught.value)
    assert caught.value.where.file == marker


def test_a_path_is_resolved_beside_the_file_then_in_the_root_then_among_shipped_files(tmp_path: Path) -> None:
    project = Project(tmp_path, tmp_path / "runs")
    procedure = tmp_path / "procedures" / "p.yaml"
    beside, root = tmp_path / "procedures" / "rigs" / "x.yaml", tmp_path / "rigs" / "x.yaml"
    assert project.resolve("rigs/hl32-bench.yaml", procedure) == shipped("rigs", "hl32-bench.yaml")
    for path in (root, beside):
        path.parent.mkdir(parents=True)
        path.write_text("", encoding="utf-8")
        assert project.resolve("rigs/x.yaml", procedure) == path
    assert project.resolve("rigs/x.yaml") == root
    assert project.resolve(root) == root


@pytest.mark.parametrize("written", ["rigs\\x.yaml", "rigs/x.yaml", "rigs\\hl32-bench.yaml"])
def test_both_slashes_are_read(tmp_path: Path, written: str) -> None:
    """A file that was written on Windows names the same file elsewhere."""
    project = Project(tmp_path, tmp_path / "runs")
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "x.yaml").write_text("", encoding="utf-8")
    found = project.resolve(written, tmp_path / "procedures" / "p.yaml")
    assert found.as_posix().endswith(written.replace("\\", "/"))
    assert found.exists()


@pytest.mark.parametrize("path", ["rigs/none.yaml", "a\0b", "~nobody-of-that-name/x", "x" * 5000])
def test_a_missing_file_is_reported_with_the_folders_searched(tmp_path: Path, path: str) -> None:
    project = Project(tmp_path, tmp_path / "runs")
    with pytest.raises(RigctlError, match="there is no such file") as caught:
        project.resolve(path, tmp_path / "p" / "p.yaml")
    assert caught.value.value == path
    assert caught.value.hint is not None
    # Windows knows a home for every name, beside the user's own
    of_user = os.name == "nt" and path.startswith("~")
    assert (Path("~x").expanduser().parent if of_user else tmp_path / "p").as_posix() in caught.value.hint


def test_a_null_character_in_a_setting_is_refused(tmp_path: Path) -> None:
    """It was a traceback of the first command that looked at the folder."""
    (tmp_path / "rigctl.toml").write_text('runs = "a\\u0000b"\n', encoding="utf-8")
    with pytest.raises(RigctlError, match="runs: wrong kind of value"):
        find_project(tmp_path)
