from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from threading import Barrier, Event
from time import sleep

import pytest

from dataset.strokes import measure_strokes
from rigctl.dataset import RunWriter, annotate, exclude, include, list_runs, open_run, verify
from rigctl.dataset.annotations import append_annotations, read_annotations, say
from rigctl.dataset.recording import finalise
from rigctl.dataset.recording.writer_lock import in_progress, lock_folder, try_lock
from rigctl.errors import RigctlError

RunMaker = Callable[..., Path]


def test_excluded_records_stay_with_their_reason(make_run: RunMaker) -> None:
    folder = make_run()
    before = (folder / "samples.parquet").read_bytes()
    exclude(folder, [0, 2], "air in the oil")
    run = open_run(folder)
    assert run.records["excluded"].fillna("").tolist() == ["air in the oil", "", "air in the oil"]
    assert run.usable == (1,)
    assert (run.record(0).excluded, run.record(0).usable) == ("air in the oil", False)
    assert (folder / "samples.parquet").read_bytes() == before
    assert verify(folder).condition.value == "whole"


def test_including_a_record_again_keeps_both_annotations(make_run: RunMaker, runs: Path) -> None:
    folder = make_run()
    exclude(folder, [0, 1], "doubtful")
    include(folder, [1], "it was fine")
    exclude(folder, [2], "late doubts")
    run = open_run(folder)
    assert run.usable == (1,)
    assert [said["kind"] for said in run.info["annotations"]] == ["exclude", "exclude", "include", "exclude"]
    assert list_runs(runs)[0].excluded == 2


def test_a_record_excluded_again_is_excluded(make_run: RunMaker, runs: Path) -> None:
    folder = make_run()
    for act in (exclude, include, exclude):
        act(folder, [1], "reason")
    assert open_run(folder).usable == (0, 2)
    assert list_runs(runs)[0].excluded == 1


def test_notes_are_kept_with_who_and_when(make_run: RunMaker) -> None:
    folder = make_run()
    annotate(folder, "new seals", record=1)
    annotate(folder, "hot day\nand loud")
    said = open_run(folder).info["annotations"]
    assert [(note["text"], note["record"]) for note in said] == [
        ("new seals", 1),
        ("hot day\nand loud", None),
    ]
    assert said[0]["when"].endswith("+00:00")


def test_a_missing_record_is_reported_and_none_is_excluded(make_run: RunMaker) -> None:
    folder = make_run()
    with pytest.raises(RigctlError, match="no such record") as caught:
        exclude(folder, [0, 3], "reason")
    assert (caught.value.value, caught.value.expected) == ("3", "0 to 2")
    assert open_run(folder).usable == (0, 1, 2)
    assert not (folder / "annotations.jsonl").exists()


def test_a_note_on_a_run_in_progress_appears_when_it_ends(writer: RunWriter) -> None:
    measure_strokes(writer)
    annotate(writer.folder, "watch the seal")
    exclude(writer.folder, [0], "door open")
    run = open_run(writer.close("finished"))
    assert [note["text"] for note in run.info["annotations"]] == ["watch the seal", "door open"]
    assert run.usable == (1, 2)


def test_annotations_of_several_programs_at_once_are_all_kept(make_run: RunMaker) -> None:
    folder = make_run()

    def note(program: int) -> None:
        for number in range(30):
            append_annotations(folder, [say("note", f"{program}, {number}")])

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(note, range(4)))
    assert len({said.text for said in read_annotations(folder)}) == 120
    assert not list(folder.glob("*.lock"))


def test_exclusions_of_several_programs_at_once_are_all_in_the_tables(make_run: RunMaker) -> None:
    for _ in range(5):
        folder = make_run()
        start = Barrier(3)

        def act(record: int, folder: Path = folder, start: Barrier = start) -> None:
            start.wait()
            exclude(folder, [record], "reason")

        with ThreadPoolExecutor(3) as pool:
            list(pool.map(act, range(3)))
        assert open_run(folder).usable == ()
        assert verify(folder).condition.value == "whole"


def test_an_exclusion_while_the_tables_are_made_is_in_them(
    make_run: RunMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_run()
    left = [say("exclude", "air in the oil", 1)]

    def write_table(path: Path, table: object) -> None:
        if path.name == "records.parquet" and left:
            append_annotations(folder, [left.pop()])
        write(path, table)  # type: ignore[arg-type]

    write = finalise.write_table
    monkeypatch.setattr(finalise, "write_table", write_table)
    exclude(folder, [0], "doubtful")
    assert open_run(folder).usable == (2,)


def test_a_lock_is_held_by_one_program_at_a_time(tmp_path: Path) -> None:
    holders: list[int] = []

    def hold(program: int) -> bool:
        alone, times = True, 0
        while times < 100:
            with try_lock(tmp_path) or nullcontext(None) as lock:
                if lock is not None:
                    times += 1
                    holders.append(program)
                    sleep(0.0002)
                    alone &= holders == [program]
                    holders.remove(program)
        return alone

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(hold, range(4)))


def test_a_look_at_the_status_does_not_keep_a_run_from_being_written(tmp_path: Path) -> None:
    done = Event()

    def look() -> None:
        while not done.is_set():
            in_progress(tmp_path)

    with ThreadPoolExecutor(3) as pool:
        looks = [pool.submit(look) for _ in range(3)]
        try:
            for _ in range(300):
                with lock_folder(tmp_path):
                    pass
        finally:
            done.set()
        for one in looks:
            one.result()
