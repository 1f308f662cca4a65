from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dataset.strokes import measure_strokes
from rigctl.dataset import Condition, RunWriter, open_run, verify
from rigctl.dataset.annotations import append_annotations, say

RunMaker = Callable[..., Path]
FILES = ("samples.parquet", "records.parquet", "events.parquet", "log.jsonl")


@pytest.mark.parametrize("name", FILES)
def test_a_changed_byte_is_noticed_and_its_file_named(make_run: RunMaker, name: str) -> None:
    folder = make_run()
    content = bytearray((folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / name).write_bytes(content)
    verdict = verify(folder)
    assert verdict.condition is Condition.BROKEN
    assert not verdict.good
    (problem,) = verdict.problems
    assert name in problem
    assert "has changed" in problem


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(make_run: RunMaker, name: str) -> None:
    folder = make_run()
    (folder / name).unlink()
    verdict = verify(folder)
    assert verdict.condition is Condition.BROKEN
    assert verdict.problems == (f"{folder / name}: the file is missing",)


def test_run_json_is_made_again_from_the_log(make_run: RunMaker) -> None:
    folder = make_run()
    before = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    (folder / "run.json").write_text("not json", encoding="utf-8")
    verdict = verify(folder)
    assert verdict.condition is Condition.RECOVERED
    assert "run.json was damaged" in verdict.problems[0]
    assert json.loads((folder / "run.json").read_text(encoding="utf-8")) == before


def test_a_damaged_log_of_an_unclosed_run_is_named_with_its_line(writer: RunWriter) -> None:
    measure_strokes(writer)
    writer._journal.close()
    writer._log.close()
    writer._lock.release()
    path = writer.folder / "log.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:3], b"@@@@\n", *lines[4:]]))
    verdict = verify(writer.folder)
    assert verdict.condition is Condition.BROKEN
    assert f"{path}:4" in verdict.problems[0]
    assert (writer.folder / "samples.journal").exists()


def test_a_log_that_says_something_else_is_no_traceback(make_run: RunMaker) -> None:
    folder = make_run()
    (folder / "run.json").unlink()
    for content in (b"", b"{}\n", b'{"kind":"run","time":0}\n', b'{"header": {"layout": 3}}\n'):
        (folder / "log.jsonl").write_bytes(content)
        assert verify(folder).condition is Condition.BROKEN


def test_a_run_in_progress_is_left_alone(writer: RunWriter) -> None:
    measure_strokes(writer)
    before = (writer.folder / "samples.journal").stat().st_size
    assert verify(writer.folder).condition is Condition.IN_PROGRESS
    assert (writer.folder / "samples.journal").stat().st_size == before
    writer.close("finished")
    assert verify(writer.folder).condition is Condition.WHOLE


def test_a_fresh_heartbeat_of_another_computer_counts_as_in_progress(writer: RunWriter) -> None:
    writer._journal.close()
    writer._log.close()
    writer._lock.release()
    state = writer.folder / "state.json"
    state.write_text(json.dumps({"host": "another-computer", "pid": 1}), encoding="utf-8")
    assert verify(writer.folder).condition is Condition.IN_PROGRESS
    old = time.time() - 6.0
    os.utime(state, (old, old))
    assert verify(writer.folder).condition is Condition.RECOVERED


@pytest.mark.parametrize("content", ["", "[]", '{"pid": "x"}', '{"host": 3}'])
def test_a_nonsense_heartbeat_is_no_obstacle(writer: RunWriter, content: str) -> None:
    writer._journal.close()
    writer._log.close()
    writer._lock.release()
    (writer.folder / "state.json").write_text(content, encoding="utf-8")
    verify(writer.folder)


def test_an_annotation_that_was_appended_but_not_seen_is_taken_in(make_run: RunMaker) -> None:
    folder = make_run()
    append_annotations(folder, [say("exclude", "operator leant on the bench", 1)])
    assert verify(folder).condition is Condition.RECOVERED
    assert verify(folder).condition is Condition.WHOLE
    assert open_run(folder).usable == (0, 2)
    append_annotations(folder, [say("note", "later")])
    assert verify(folder).condition is Condition.RECOVERED
    assert len(open_run(folder).info["annotations"]) == 2


def test_changed_annotations_are_broken(make_run: RunMaker) -> None:
    folder = make_run()
    append_annotations(folder, [say("exclude", "bad", 1)])
    verify(folder)
    path = folder / "annotations.jsonl"
    path.write_bytes(path.read_bytes().replace(b"bad", b"sad"))
    assert verify(folder).condition is Condition.BROKEN


def test_a_folder_with_nothing_in_it_is_broken(tmp_path: Path) -> None:
    assert verify(tmp_path).condition is Condition.BROKEN
