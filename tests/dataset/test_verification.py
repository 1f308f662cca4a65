from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dataset.strokes import LAYOUT, measure_strokes
from rigctl.dataset import Condition, RunWriter, open_run, verify
from rigctl.dataset.annotations import append_annotations, say
from rigctl.dataset.recording.finalise import recovered_history
from rigctl.dataset.recording.journal import read_journal
from rigctl.errors import RigctlError

RunMaker = Callable[..., Path]
FILES = ("samples.parquet", "records.parquet", "events.parquet", "log.jsonl")


@pytest.mark.parametrize("name", FILES)
def test_a_changed_byte_is_detected_with_its_file(make_run: RunMaker, name: str) -> None:
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
def test_a_missing_file_is_reported(make_run: RunMaker, name: str) -> None:
    folder = make_run()
    (folder / name).unlink()
    verdict = verify(folder)
    assert verdict.condition is Condition.BROKEN
    assert verdict.problems == (f"{(folder / name).as_posix()}: the file is missing",)


def test_run_json_is_rebuilt_from_the_log(make_run: RunMaker) -> None:
    folder = make_run()
    before = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    (folder / "run.json").write_text("not json", encoding="utf-8")
    verdict = verify(folder)
    assert verdict.condition is Condition.RECOVERED
    assert "run.json was damaged" in verdict.problems[0]
    assert json.loads((folder / "run.json").read_text(encoding="utf-8")) == before


def left_by_a_kill(writer: RunWriter) -> Path:
    """Three complete records in the files that a killed program leaves."""
    measure_strokes(writer)
    writer.flush()
    writer._journal.close()
    writer._log.close()
    writer._lock.release()
    return writer.folder


def outcomes(folder: Path) -> list[str]:
    return list(open_run(folder).records["outcome"])


@pytest.mark.parametrize("bad", [3, 6])
def test_a_damaged_log_line_damages_the_open_record(writer: RunWriter, bad: int) -> None:
    """Line 4 is a command of the first record, line 7 the opening of the second."""
    folder = left_by_a_kill(writer)
    path = folder / "log.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    damaged = b"".join([*lines[:bad], b"@@@@\n", *lines[bad + 1 :]])
    path.write_bytes(damaged)
    verdict = verify(folder)
    assert verdict.condition is Condition.RECOVERED
    assert f"{path.as_posix()}: what line {bad + 1} said is lost" in verdict.problems[-1]
    assert path.read_bytes() == damaged, "the log is left as it is"
    wanted = ["complete"] * 3
    wanted[0 if bad == 3 else 1] = "damaged"
    assert outcomes(folder) == wanted
    assert len(open_run(folder).signals("time", 1)) == 20


def test_a_log_without_its_first_line_leaves_the_journal_untouched(writer: RunWriter) -> None:
    folder = left_by_a_kill(writer)
    path = folder / "log.jsonl"
    path.write_bytes(b"@" + path.read_bytes()[1:])
    verdict = verify(folder)
    assert verdict.condition is Condition.BROKEN
    assert f"{path.as_posix()}:1" in verdict.problems[0]
    assert (folder / "samples.journal").exists()


def test_a_flipped_bit_loses_one_frame_and_keeps_the_original(writer: RunWriter) -> None:
    folder = left_by_a_kill(writer)
    path = folder / "samples.journal"
    damaged = bytearray(path.read_bytes())
    frame = read_journal(path).frames[1]
    damaged[frame.start + 5] ^= 1
    path.write_bytes(damaged)
    verdict = verify(folder)
    assert verdict.condition is Condition.RECOVERED
    lost = frame.length // (8 * len(LAYOUT.columns))
    assert any(f"at least {lost} samples are lost" in said for said in verdict.problems)
    assert not path.exists()
    assert (folder / "samples.journal.damaged-0").read_bytes() == damaged
    run = open_run(folder)
    assert run.info["rows"] == 63 - lost
    assert run.info["lost_rows"] == lost
    assert run.info["lost_bytes"] > frame.length
    assert outcomes(folder).count("damaged") == 1
    append_annotations(folder, [say("note", "looked at")])
    verify(folder)
    assert outcomes(folder).count("damaged") == 1, "it stays so when the tables are made again"
    assert open_run(folder).info["lost_rows"] == lost


def test_records_with_missing_samples_are_classified_as_damaged(writer: RunWriter) -> None:
    folder = left_by_a_kill(writer)
    path = folder / "samples.journal"
    damaged = bytearray(path.read_bytes())
    damaged[read_journal(path).frames[1].start + 5] ^= 1
    path.write_bytes(damaged)
    found = [entry.outcome for entry in recovered_history(folder).records]
    assert found == outcomes(folder)
    assert found.count("damaged") == 1


@pytest.mark.parametrize("content", [None, b"", bytes(4000), b"RIGJRNL2"])
def test_without_its_journal_no_record_is_complete(writer: RunWriter, content: bytes | None) -> None:
    folder = left_by_a_kill(writer)
    path = folder / "samples.journal"
    if content is None:
        path.unlink()
    else:
        path.write_bytes(content)
    verdict = verify(folder)
    assert verdict.condition is Condition.RECOVERED
    assert any("at least 60 samples are lost" in said for said in verdict.problems)
    assert outcomes(folder) == ["damaged"] * 3
    assert open_run(folder).usable == ()


def test_a_damaged_first_frame_is_replaced_by_facts_from_the_log(writer: RunWriter) -> None:
    folder = left_by_a_kill(writer)
    path = folder / "samples.journal"
    damaged = bytearray(path.read_bytes())
    damaged[60] ^= 1
    path.write_bytes(damaged)
    assert verify(folder).condition is Condition.RECOVERED
    assert outcomes(folder) == ["complete"] * 3
    assert open_run(folder).info["rows"] == 63


def test_an_empty_or_inconsistent_log_makes_a_run_broken(make_run: RunMaker) -> None:
    folder = make_run()
    (folder / "run.json").unlink()
    for content in (b"", b"{}\n", b'{"kind":"run","time":0}\n', b'{"header": {"layout": 3}}\n'):
        (folder / "log.jsonl").write_bytes(content)
        verdict = verify(folder)
        assert verdict.condition is Condition.BROKEN
        assert any("log.jsonl" in said for said in verdict.problems), verdict.problems


def test_a_run_in_progress_is_not_touched(writer: RunWriter) -> None:
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
def test_an_invalid_heartbeat_does_not_stop_verification(writer: RunWriter, content: str) -> None:
    writer._journal.close()
    writer._log.close()
    writer._lock.release()
    (writer.folder / "state.json").write_text(content, encoding="utf-8")
    verify(writer.folder)


def test_an_appended_annotation_is_added_to_the_tables(make_run: RunMaker) -> None:
    folder = make_run()
    append_annotations(folder, [say("exclude", "operator leant on the bench", 1)])
    assert verify(folder).condition is Condition.RECOVERED
    assert verify(folder).condition is Condition.WHOLE
    assert open_run(folder).usable == (0, 2)
    append_annotations(folder, [say("note", "later")])
    assert verify(folder).condition is Condition.RECOVERED
    assert len(open_run(folder).info["annotations"]) == 2


def test_changed_annotations_make_a_run_broken(make_run: RunMaker) -> None:
    folder = make_run()
    append_annotations(folder, [say("exclude", "bad", 1)])
    verify(folder)
    path = folder / "annotations.jsonl"
    path.write_bytes(path.read_bytes().replace(b"bad", b"sad"))
    assert verify(folder).condition is Condition.BROKEN


def test_an_empty_folder_is_broken(tmp_path: Path) -> None:
    assert verify(tmp_path).condition is Condition.BROKEN


def test_a_changed_run_json_is_refused_and_rebuilt(make_run: RunMaker) -> None:
    """A unit changed from mm to m would not be detected by the checksums of the samples."""
    folder = make_run()
    path = folder / "run.json"
    whole = path.read_bytes()
    changed = whole.replace(b'"mm"', b'"m"', 1)
    assert changed != whole
    path.write_bytes(changed)
    with pytest.raises(RigctlError, match="changed since it was written"):
        open_run(folder)
    verdict = verify(folder)
    assert verdict.condition is Condition.RECOVERED
    assert path.read_bytes() == whole
    assert (folder / "run.json.changed-1").read_bytes() == changed
    assert verify(folder).condition is Condition.WHOLE


def test_a_reformatted_run_json_is_valid(make_run: RunMaker) -> None:
    folder = make_run()
    path = folder / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")), indent=7), encoding="utf-8")
    assert verify(folder).condition is Condition.WHOLE


def test_a_run_that_names_another_folder_is_refused(make_run: RunMaker) -> None:
    folder = make_run()
    moved = folder.rename(folder.with_name("20270101-000000-other"))
    with pytest.raises(RigctlError, match="belongs to another run"):
        open_run(moved)
    before = {path.name: path.read_bytes() for path in moved.iterdir()}
    verdict = verify(moved)
    assert verdict.condition is Condition.BROKEN
    assert {name: content for name, content in before.items() if "changed" not in name} == {
        path.name: path.read_bytes() for path in moved.iterdir() if "changed" not in path.name
    }
