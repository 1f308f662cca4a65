"""Many runs: the index, folders of days, and recovery from a bad index."""

from __future__ import annotations

import logging
import os
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from rigctl.dataset import (
    RunHeader,
    RunWriter,
    annotate,
    day_folders,
    exclude,
    find_run,
    list_runs,
    open_run,
    query,
)
from rigctl.dataset.catalogue import page_of_runs
from rigctl.dataset.index import file as index_file
from rigctl.dataset.index.file import index_path, is_indexed
from rigctl.dataset.run_order import run_folders
from rigctl.errors import RigctlError
from systems import needs_posix

RunMaker = Callable[..., Path]
HeaderMaker = Callable[..., object]
NAMES = ("20261119-235959-heat", "20261120-080000-stroke", "20261120-080000-stroke-2", "20261121-093000-heat")


@pytest.fixture(autouse=True)
def many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs are many here."""
    monkeypatch.setenv("RIGCTL_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(index_file, "INDEX_FROM", 2)


@pytest.fixture
def four(make_run: RunMaker, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The first is stored directly in the runs folder; with the others there are many."""
    first = make_run(NAMES[0], records=1, rows=2)
    monkeypatch.setattr(day_folders, "SHARD_FROM", 1)
    return [first, *(make_run(name, records=1, rows=2 + number) for number, name in enumerate(NAMES[1:]))]


def settle(runs: Path) -> None:
    """As if the folder had not been used for some time."""
    for folder in (runs, *(each for each in runs.iterdir() if day_folders.is_shard(each.name))):
        os.utime(folder, (1e9, 1e9))


def rows_in(runs: Path) -> int:
    with sqlite3.connect(index_path(runs)) as index:
        count: int = index.execute("SELECT count(*) FROM run").fetchone()[0]
    index.close()
    return count


def ids(runs: Path, where: str | None = None) -> list[str]:
    return [run.id for run in list_runs(runs, where=where)]


def test_new_runs_of_a_large_folder_are_stored_by_day_and_found(four: list[Path], runs: Path) -> None:
    assert [folder.relative_to(runs).parent.as_posix() for folder in four] == [
        ".", "2026-11-20", "2026-11-20", "2026-11-21",
    ]  # fmt: skip
    assert run_folders(runs) == four == [run.folder for run in list_runs(runs)]
    assert is_indexed(runs)
    assert find_run("latest", runs) == four[3]
    assert [find_run(name, runs) for name in NAMES] == four
    assert find_run("20261119", runs) == four[0]
    assert open_run("20261121", runs).info["records"] == 1
    with pytest.raises(RigctlError, match="several runs"):
        find_run("20261120", runs)
    with pytest.raises(RigctlError) as caught:
        find_run("20261121-093000-haet", runs)
    assert caught.value.nearest == NAMES[3]
    counted = query("SELECT run, count(*) FROM samples GROUP BY run ORDER BY run", runs).rows
    assert counted == tuple(zip(NAMES, (3, 3, 4, 5), strict=True))


def test_the_index_agrees_with_the_folders(four: list[Path], runs: Path) -> None:
    from rigctl.dataset.catalogue import _summaries

    annotate(four[1], "new seals")
    exclude(four[2], [0], "air")
    (four[3] / "run.json").write_text("{", encoding="utf-8")
    assert list_runs(runs) == list(_summaries(run_folders(runs)))
    assert list_runs(runs, last=2) == list_runs(runs)[-2:]
    assert (list_runs(runs)[1].notes, list_runs(runs)[2].excluded) == (1, 1)


def test_runs_are_selected_by_metadata_and_channel_ranges(four: list[Path], runs: Path) -> None:
    assert ids(runs, "started < '2027' AND rows > 3") == list(NAMES[2:])
    hotter = "id IN (SELECT run FROM channels WHERE name = 'position' AND high >= 99 AND unit = 'mm')"
    assert ids(runs, hotter) == list(NAMES)
    assert ids(runs, hotter.replace("high >= 99", "high > 101")) == []
    # of the others no file is opened
    for folder in four[:3]:
        (folder / "samples.parquet").unlink()
    assert query("SELECT count(*) FROM samples", runs, where="rows = 5").rows == ((5,),)


def test_conditions_queries_and_the_summary_state_the_same_of_a_run(
    four: list[Path], runs: Path, make_header: Callable[..., RunHeader]
) -> None:
    described = make_header("20261125-080000-x", device={"serial_number": "SN-1", "notes": "blue seal"})
    RunWriter.create(runs, described).close("finished")
    columns = query("SELECT * FROM runs LIMIT 0", runs).columns
    for column in columns:
        stated = query(f'SELECT id FROM runs WHERE "{column}" IS NOT NULL ORDER BY id', runs)
        assert ids(runs, f'"{column}" IS NOT NULL') == [run_id for (run_id,) in stated.rows], column
    assert ids(runs, "device_notes = 'blue seal'") == ["20261125-080000-x"]
    assert [run.serial_number for run in list_runs(runs)] == ["", "", "", "", "SN-1"]
    by_number = page_of_runs(runs, sort="serial_number", descending=False).runs
    assert by_number[0].serial_number == "SN-1"  # runs without a value are last


@pytest.mark.parametrize("busy", [-1.0, 2.0])
def test_reading_with_one_or_several_threads_gives_the_same_index(
    four: list[Path], runs: Path, busy: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rigctl.dataset.index import refresh as refreshing

    monkeypatch.setattr(refreshing, "_BUSY", busy)  # always a single thread, or never
    monkeypatch.setattr(refreshing, "_BATCH", 3)
    monkeypatch.setattr(refreshing, "_FEW", 1)
    monkeypatch.setattr(refreshing, "_TASK", 1)
    (four[1] / "samples.parquet").write_bytes(b"PAR1")
    (four[3] / "run.json").write_text("{", encoding="utf-8")
    assert ids(runs) == list(NAMES)
    assert [run.status for run in list_runs(runs)].index("damaged") == 3
    hotter = "id IN (SELECT run FROM channels WHERE name = 'position' AND high >= 99)"
    assert ids(runs, hotter) == [NAMES[0], NAMES[2]]


@pytest.mark.parametrize(
    ("where", "said", "nearest"),
    [
        ("statsu = 'x'", "column", "status"),
        ("id IN (SELECT run FROM channel_names)", "table", None),
        ("id IN (SELECT name FROM sqlite_master)", "condition", None),
        ("1); DROP TABLE run; --", "not one condition", None),
        ("load_extension('x')", "condition", None),
        ("rows >", "condition", None),
    ],
)
def test_a_wrong_condition_is_refused(
    four: list[Path], runs: Path, where: str, said: str, nearest: str | None
) -> None:
    with pytest.raises(RigctlError, match=said) as caught:
        list_runs(runs, where=where)
    if nearest:
        assert caught.value.nearest == nearest
    assert ids(runs) == list(NAMES)


def test_only_changed_runs_are_read_again(
    four: list[Path], runs: Path, make_run: RunMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rigctl.dataset.index import refresh as refreshing

    settle(runs)
    ids(runs)
    read: list[str] = []
    reading = refreshing.read_row
    monkeypatch.setattr(
        refreshing, "read_row", lambda folder, *a, **k: read.append(folder.name) or reading(folder, *a, **k)
    )
    assert ids(runs) == list(NAMES)
    assert read == []
    annotate(four[1], "a note")
    assert list_runs(runs)[1].notes == 1
    assert read == [NAMES[1]]
    new = make_run("20261122-000000-x", records=0)
    shutil.rmtree(four[3])
    settle(new.parent)
    assert ids(runs) == [*NAMES[:3], new.name]
    # another program, which marks no folder
    (four[0] / "run.json").write_text("{}", encoding="utf-8")
    settle(runs)
    assert list_runs(runs)[0].status == "damaged"


def test_the_status_of_a_run_is_updated_in_the_list_when_it_ends(
    four: list[Path], runs: Path, writer: RunWriter
) -> None:
    def status() -> str:
        return {run.id: run.status for run in list_runs(runs)}[writer.id]

    settle(runs)
    assert status() == "running"
    writer.close("finished")
    settle(runs)
    assert status() == "finished"


def test_an_abandoned_run_is_detected_without_a_file_change(
    four: list[Path], runs: Path, writer: RunWriter
) -> None:
    settle(runs)
    assert list_runs(runs, where="status = 'running'")[0].id == writer.id
    writer._lock.release()
    settle(runs)
    assert [run.id for run in list_runs(runs, where="status = 'unclosed'")] == [writer.id]


def spoil(runs: Path, how: str) -> None:
    path = index_path(runs)
    if how == "newer":
        with sqlite3.connect(path) as index:
            index.execute("PRAGMA user_version = 99")
            index.execute("DROP TABLE channel")
        index.close()
    elif how == "text":
        path.write_text("no database at all", encoding="utf-8")
    elif how == "cut":
        path.write_bytes(path.read_bytes()[:5000])
    elif how == "pages":
        content = path.read_bytes()
        path.write_bytes(content[:4096] + b"\x55" * (len(content) - 4096))
    elif how == "tables":
        with sqlite3.connect(path) as index:
            index.execute("DROP TABLE run")
        index.close()


@pytest.mark.parametrize("how", ["newer", "text", "cut", "pages", "tables"])
def test_a_bad_index_is_rebuilt_with_a_warning(
    four: list[Path], runs: Path, caplog: pytest.LogCaptureFixture, how: str
) -> None:
    assert ids(runs) == list(NAMES)
    spoil(runs, how)
    with caplog.at_level(logging.WARNING):
        assert ids(runs, "rows > 0") == list(NAMES)
    assert "made again" in caplog.text
    assert rows_in(runs) == 4


def test_without_a_writable_index_the_folders_are_read(
    four: list[Path], runs: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "cache").write_text("a file where a folder should be", encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        assert ids(runs) == list(NAMES)
        assert ids(runs, "rows > 3") == list(NAMES[2:])
    assert "no index of the runs can be kept" in caplog.text


@needs_posix("pipes in folders, and /dev/zero")
@pytest.mark.parametrize("how", ["pipe", "device", "folder"])
@pytest.mark.usefixtures("four")
def test_an_index_that_is_not_a_file_is_bypassed(
    runs: Path, caplog: pytest.LogCaptureFixture, how: str
) -> None:
    """A pipe in its place used to block the command, and Ctrl-C did not help."""
    path = index_path(runs)
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    {"pipe": os.mkfifo, "device": lambda to: Path(to).symlink_to("/dev/zero"), "folder": os.mkdir}[how](path)
    with caplog.at_level(logging.WARNING):
        assert ids(runs) == list(NAMES)
    assert "no index of the runs can be kept" in caplog.text


def test_a_locked_index_is_bypassed(
    four: list[Path], runs: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(index_file, "_PATIENCE", 0.05)
    ids(runs)
    with sqlite3.connect(index_path(runs), isolation_level=None) as other:
        other.execute("BEGIN EXCLUSIVE")
        assert ids(runs, "rows > 3") == list(NAMES[2:])
        other.execute("ROLLBACK")
    other.close()
    assert "cannot be used" in caplog.text
    assert rows_in(runs) == 4


OTHER = """
import sys
from pathlib import Path
from rigctl.dataset import list_runs
from rigctl.dataset.index import file
file.INDEX_FROM = 2
for _ in range(20):
    print(len(list_runs(Path(sys.argv[1]))), flush=True)
"""


def test_two_processes_can_list_while_runs_end(four: list[Path], runs: Path, make_run: RunMaker) -> None:
    lister = [sys.executable, "-c", OTHER, str(runs)]
    with subprocess.Popen(lister, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as other:
        for number in range(20):
            make_run(f"20261122-0000{number:02d}-x", records=0)
            assert len(ids(runs)) == 5 + number
        counted, said = other.communicate(timeout=600)
    seen = [int(line) for line in counted.split()]
    assert (len(seen), seen, said) == (20, sorted(seen), "")
    assert len(ids(runs)) == rows_in(runs) == 24


@pytest.mark.parametrize(
    "bomb",
    [
        "length(zeroblob(2000000000)) > 1",
        "length(randomblob(900000000)) > 1",
        "id LIKE '" + "%a" * 20_000 + "'",
        "(WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT count(*) FROM c) > 0",
        "(" * 5000 + "1" + ")" * 5000,
        "x" * 100_000,
        "id = '\ud800'",
    ],
)
def test_a_condition_that_needs_too_much_is_refused_in_one_message(
    make_run: RunMaker, runs: Path, bomb: str
) -> None:
    """A blob of two gigabytes used to be a traceback, and an endless condition to occupy the server."""
    make_run(records=1, rows=2)
    with pytest.raises(RigctlError) as caught:
        page_of_runs(runs, where=bomb, seconds=0.2)
    assert len(str(caught.value)) < 2000
    assert page_of_runs(runs, where="records = 1").found == 1


@needs_posix("permissions of POSIX")
def test_an_index_that_others_could_have_written_is_made_again(four: list[Path], runs: Path) -> None:
    def procedures() -> set[str]:
        return {run.procedure for run in list_runs(runs)}

    assert len(four) == len(list_runs(runs))
    with closing(sqlite3.connect(index_path(runs))) as index, index:
        index.execute("UPDATE run SET procedure = 'forged'")
    assert procedures() == {"forged"}
    index_path(runs).chmod(0o666)
    assert procedures() == {"stroke"}
    assert index_path(runs).stat().st_mode & 0o077 == 0
