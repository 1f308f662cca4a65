"""Folders that may not be read, among the runs of a shared disk."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dataset.strokes import LAYOUT, STARTED, measure_strokes
from rigctl.dataset import RunHeader, RunWriter, Source, list_runs
from rigctl.dataset.index import file as index_file


def _permissions_count(folder: Path) -> bool:
    """False for an administrator, and on Windows."""
    closed = folder / "closed"
    closed.mkdir()
    closed.chmod(0)
    try:
        os.listdir(closed)  # noqa: PTH208
    except PermissionError:
        return True
    finally:
        closed.chmod(0o700)
        closed.rmdir()
    return False


@pytest.mark.parametrize("indexed", [False, True])
def test_a_folder_that_may_not_be_read_does_not_hide_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, indexed: bool
) -> None:
    """No run was listed: it was enough that the runs had a disk of their own, with its 'lost+found'."""
    if not _permissions_count(tmp_path):
        pytest.skip("whoever runs this test may read every folder")
    if indexed:
        monkeypatch.setattr(index_file, "INDEX_FROM", 1)
    runs = tmp_path / "runs"
    names = ["20261121-093000-stroke", "20261122-093000-stroke"]
    for name in names:
        writer = RunWriter.create(runs, RunHeader(name, Source("stroke"), Source("bench"), LAYOUT, STARTED))
        measure_strokes(writer, 1, 20)
        writer.close("finished")
    closed = [runs / names[0], runs / "lost+found"]
    closed[1].mkdir()
    try:
        for folder in closed:
            folder.chmod(0)
        found = [(run.id, run.status) for run in list_runs(runs)]
    finally:
        for folder in closed:
            folder.chmod(0o700)
    assert found == [(names[0], "damaged"), (names[1], "finished")]
