from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from dataset.strokes import measure_strokes
from rigctl.dataset import RunWriter, annotate, exclude, include, list_runs, open_run, verify
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
