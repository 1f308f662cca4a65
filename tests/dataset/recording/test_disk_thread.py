"""A disk that is slow, hangs, is full or gone: measurement continues, and no data are lost."""

from __future__ import annotations

import errno
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from dataset.strokes import LAYOUT, STARTED, sample
from rigctl.dataset import RunHeader, RunWriter, Source, open_run, verify
from rigctl.dataset.recording import disk_thread
from rigctl.dataset.recording.disk_thread import BackgroundWriter
from rigctl.dataset.recording.journal import JournalWriter
from rigctl.errors import RigctlError
from systems import needs_posix

ID = "20261121-093000-stroke"


class Disk:
    """Hangs while it is held; the next flush waits for it."""

    def __init__(self) -> None:
        self.free = threading.Event()
        self.free.set()
        self.full = False
        self.reached = threading.Event()


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Disk]:
    made = Disk()
    flush = JournalWriter.flush

    def slow(journal: JournalWriter) -> None:
        if tmp_path / "runs" in journal.path.parents:
            made.reached.set()
            made.free.wait()
            if made.full and journal.waiting:
                raise OSError(errno.ENOSPC, "No space left on device")
        flush(journal)

    monkeypatch.setattr(JournalWriter, "flush", slow)
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    monkeypatch.setattr(disk_thread, "rescue_roots", lambda: [tmp_path / "file", tmp_path / "rescued"])
    yield made
    made.free.set()


@pytest.fixture
def writer(tmp_path: Path, disk: Disk) -> Iterator[BackgroundWriter]:
    header = RunHeader(ID, Source("stroke"), Source("bench"), LAYOUT, STARTED)
    made = BackgroundWriter(RunWriter.create(tmp_path / "runs", header))
    yield made
    disk.free.set()
    made._ended = True  # where a test has failed before it was closed
    made._thread.join(10.0)


def wait_for(condition: Callable[[], object]) -> None:
    give_up = time.monotonic() + 600.0
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.005)


def put(writer: BackgroundWriter, rows: range) -> None:
    for row in rows:
        writer.append(sample(float(row), writer.record))


def test_a_hanging_disk_blocks_nothing_and_loses_nothing(
    writer: BackgroundWriter, disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_thread, "SLOW", 0.05)
    disk.free.clear()
    assert writer.open_record(0.0, "stroke", {}, "1", 100.0) == 0
    put(writer, range(500))
    disk.reached.wait()
    put(writer, range(500, 1000))  # would never return in the thread of the disk
    writer.close_record(1000.0, "complete")
    assert writer.open_record(1000.0, "stroke", {}, "2", 100.0) == 1
    warned: list[str] = []
    wait_for(lambda: warned.extend(writer.warnings()) or warned)
    assert "the disk has not answered" in warned[0]
    disk.free.set()
    wait_for(lambda: warned.extend(writer.warnings()) or len(warned) > 1)
    assert "answers again" in warned[1]
    put(writer, range(1000, 1010))
    writer.close_record(1010.0, "complete")
    folder = writer.close("finished")
    run = open_run(folder)
    assert np.array_equal(run.record(0).time, np.arange(1000.0))
    assert np.array_equal(run.record(1).time, np.arange(1000.0, 1010.0))
    assert verify(folder).good


@needs_posix("open files that can be deleted")
def test_a_deleted_folder_is_reported_and_data_are_kept_elsewhere(
    writer: BackgroundWriter, tmp_path: Path
) -> None:
    writer.open_record(0.0, "stroke", {}, "1", 100.0)
    put(writer, range(100))
    wait_for(lambda: not writer._tasks)
    shutil.rmtree(tmp_path / "runs")
    row = 100
    with pytest.raises(RigctlError) as gone:
        while True:
            put(writer, range(row, row + 1))
            row += 1
            time.sleep(0.002)
    kept = tmp_path / "rescued" / ID
    assert "the run's folder is gone" in str(gone.value)
    assert kept.as_posix() in str(gone.value)
    writer.append(sample(float(row + 1), 0))  # reported once
    writer.close_record(float(row + 2), "lost")
    with pytest.raises(RigctlError, match="is gone"):
        writer.close("failed", "the run's folder is gone")
    assert writer.folder == kept
    assert np.array_equal(open_run(kept).record(0).time, np.arange(float(row + 2)))
    assert verify(kept).good
    assert str(kept) in open_run(kept).info["reason"]


@pytest.mark.parametrize("moment", ["measuring", "closing"])
def test_a_permanently_hanging_disk_ends_the_run_without_loss(
    writer: BackgroundWriter, disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    writer.open_record(0.0, "stroke", {}, "1", 100.0)
    put(writer, range(50))
    writer.close_record(50.0, "complete")
    writer.open_record(50.0, "stroke", {}, "1", 100.0)
    wait_for(lambda: not writer._tasks)
    disk.free.clear()
    row = 50
    if moment == "measuring":
        monkeypatch.setattr(disk_thread, "STALLED", 0.3)
        with pytest.raises(RigctlError, match="the disk has not answered"):
            while True:
                put(writer, range(row, row + 1))
                row += 1
                time.sleep(0.002)
        row += 1  # the row that the error came with is kept as well
    put(writer, range(row, row + 100))
    writer.close_record(row + 100.0, "lost")
    monkeypatch.setattr(disk_thread, "STALLED", 0.3)
    with pytest.raises(RigctlError) as told:
        writer.close("failed", "the disk")
    kept = tmp_path / "rescued" / ID
    assert writer.folder == kept
    assert kept.as_posix() in str(told.value)
    assert np.array_equal(open_run(kept).signals("time"), np.arange(50.0, row + 100.0))
    assert (tmp_path / "runs" / ID / "samples.journal").exists()


def test_a_full_disk_at_the_end_leaves_a_complete_run_elsewhere(
    writer: BackgroundWriter, disk: Disk, tmp_path: Path
) -> None:
    writer.open_record(0.0, "stroke", {}, "1", 100.0)
    put(writer, range(100))
    wait_for(lambda: not writer._tasks)
    disk.full = True
    row = 100
    with pytest.raises(RigctlError, match="No space left"):
        while True:
            put(writer, range(row, row + 1))
            row += 1
            time.sleep(0.002)
    put(writer, range(row + 1, 400))
    writer.close_record(400.0, "lost")
    with pytest.raises(RigctlError, match="rescued"):
        writer.close("failed", "full")
    kept = open_run(tmp_path / "rescued" / ID)
    assert np.array_equal(kept.record(0).time, np.arange(400.0))
    assert verify(kept.folder).good


@pytest.mark.parametrize("first", ["record", "row"])
def test_a_disk_that_hangs_between_two_tasks_loses_no_task(
    writer: BackgroundWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: str
) -> None:
    """The check that the folder exists hangs as well, before the next task has begun."""
    free, reached = threading.Event(), threading.Event()

    def hanging(self: RunWriter) -> bool:
        reached.set()
        return free.wait()

    if first == "row":
        writer.open_record(0.0, "stroke", {}, "1", 100.0)
        wait_for(lambda: not writer._tasks)
    monkeypatch.setattr(RunWriter, "in_place", hanging)
    reached.wait()
    if first == "record":
        writer.open_record(0.0, "stroke", {}, "1", 100.0)
    put(writer, range(20))
    writer.append(())  # no row at all: what a single task raises
    writer.close_record(20.0, "complete")
    monkeypatch.setattr(disk_thread, "STALLED", 0.3)
    try:
        with pytest.raises(RigctlError, match="the disk does not answer"):
            writer.close("failed", "the disk")
    finally:
        free.set()
    kept = open_run(tmp_path / "rescued" / ID)
    assert np.array_equal(kept.record(0).time, np.arange(20.0))
    assert kept.info["status"] == "failed"
    writer._thread.join(10.0)
    assert not writer._thread.is_alive(), "who hung leaves the rest to its successor"
